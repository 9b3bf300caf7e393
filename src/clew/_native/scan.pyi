import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]

def sort_into_buckets(
    points: _F, normals: _F, along: _F, origin_x: float, origin_y: float, cell: float, width: int, height: int
) -> tuple[NDArray[np.int32], _F]: ...
def merge_surfels(points: _F, normals: _F, along: _F, weights: _F, voxel: float) -> tuple[_F, _F, _F]: ...
def deskew(ranges: _F, angles: _F, delays: _F, velocity: _F, T_robot_sensor: _F) -> tuple[_F, _F]: ...
def extract_returns(
    ranges: _F, angles: _F, T_robot_sensor: _F, nearest: float, farthest: float, window: int, radius: float,
    gap_base: float, gap_per_metre: float, blob: float, weight_per_metre: float,
) -> tuple[tuple[_F, _F, _F, _F], NDArray[np.int32]]: ...
def between_returns(
    points: _F, normals: _F, along: _F, weights: _F, step: float, gap_base: float, gap_per_metre: float, flat: float,
    weight: float,
) -> tuple[_F, _F, _F, _F]: ...
def build_pyramid(
    points: _F, sigma: float, levels: int, height: int, width: int, origin_x: float, origin_y: float, resolution: float
) -> NDArray[np.uint8]: ...
def correlate(
    cells: NDArray[np.uint8], origin_x: float, origin_y: float, resolution: float, points: _F, centre: _F, half: _F,
    step_theta: float, prior_sigmas: _F, prior_weight: float, minimum_score: float, excluded: _F,
    exclude_distance: float, exclude_angle: float,
) -> tuple[bool, _F, float, float, int]: ...
def align(
    entries: _F, target_offsets: NDArray[np.int64], starts: NDArray[np.int32], starts_offsets: NDArray[np.int64],
    origins: _F, shapes: NDArray[np.int32], cells: _F, points: _F, normals: _F, weights: _F, offsets: NDArray[np.int64],
    pairs: NDArray[np.int32], T_start: _F, T_prior: _F, prior_information: _F, radius_start: float,
    radius_end: float, sigma: float, robust: float, facing: float, iterations: int, correlated: float,
    threads: int,
) -> tuple[_F, _F, _F, _F, _F, _F, _F, _F, _F]: ...
