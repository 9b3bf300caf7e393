from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

class CarmenRecords(TypedDict):
    scan_numbers: NDArray[np.float64]
    scan_integers: NDArray[np.int64]
    ranges: NDArray[np.float64]
    odometry: NDArray[np.float64]
    parameters: list[tuple[bytes, bytes]]
    skipped: dict[str, int]
    damaged: int

def parse_carmen(text: bytes) -> CarmenRecords: ...
def parse_table(text: bytes, columns: int) -> tuple[NDArray[np.float64], NDArray[np.int64], int, int]: ...
