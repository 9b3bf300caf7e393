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

class GraphRecords(TypedDict):
    bad_line: int
    bad: bytes
    tables: dict[str, tuple[NDArray[np.int64], NDArray[np.float64]]]
    fixed: NDArray[np.int64]
    features: tuple[NDArray[np.int64], NDArray[np.float64]]
    unknown: list[tuple[int, bytes]]

def parse_carmen(text: bytes) -> CarmenRecords: ...
def parse_table(text: bytes, columns: int) -> tuple[NDArray[np.float64], NDArray[np.int64], int, int]: ...
def parse_graph(text: bytes, records: list[tuple[str, int, int, bool]]) -> GraphRecords: ...
def format_records(tag: str, ids: NDArray[np.int64], numbers: NDArray[np.float64]) -> bytes: ...
