import numpy as np
from numpy.typing import NDArray

def cast_rays(
    cells: NDArray[np.uint16],
    first_row: int,
    first_col: int,
    resolution: float,
    T_world_sensor: NDArray[np.float64],
    offsets: NDArray[np.int64],
    endpoints: NDArray[np.float64],
    hit: NDArray[np.bool_],
    margin: float,
    stamp: int,
) -> int: ...
def ray_bounds(
    T_world_sensor: NDArray[np.float64],
    offsets: NDArray[np.int64],
    endpoints: NDArray[np.float64],
    hit: NDArray[np.bool_],
) -> tuple[float, float, float, float]: ...
def count_looks(
    T_world_sensor: NDArray[np.float64],
    offsets: NDArray[np.int64],
    first_angle: NDArray[np.float64],
    increment: NDArray[np.float64],
    range: NDArray[np.float64],
    moment: NDArray[np.int32],
    resolution: float,
    reach: float,
    free_range: float,
    width: float,
    margin: float,
    sure: float,
) -> tuple[
    NDArray[np.float64], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.uint8], NDArray[np.uint8]
]: ...
def clear_lengths(
    T_world_sensor: NDArray[np.float64],
    offsets: NDArray[np.int64],
    first_angle: NDArray[np.float64],
    increment: NDArray[np.float64],
    range: NDArray[np.float64],
    moment: NDArray[np.int32],
    reach: float,
    free_range: float,
    width: float,
    margin: float,
) -> NDArray[np.float64]: ...
def see(
    T_sensor_points: NDArray[np.float64],
    offsets: NDArray[np.int64],
    first_angle: NDArray[np.float64],
    increment: NDArray[np.float64],
    range: NDArray[np.float64],
    clear: NDArray[np.float64],
    points: NDArray[np.float64],
    slack: float,
) -> tuple[NDArray[np.int32], NDArray[np.int32]]: ...
