from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = NDArray[np.int32]
Indices = NDArray[np.int64]

def linearise(
    kind: str, first: Array, second: Array, sensor: Array | None, rows: Rows, measurement: Array,
    information: Array, gradient: Rows, plan: Indices, robust: int, scale: float, hessian: Array | None,
    gradient_values: Array | None,
) -> float: ...
def accumulate(
    residual: Array, jacobians: Sequence[Array], information: Array, gradient: Rows, plan: Indices, robust: int,
    scale: float, hessian: Array | None, gradient_values: Array | None,
) -> float: ...
def retract(values: Array, offsets: Rows, delta: Array, out: Array) -> None: ...
def nearest_rotations(matrices: Array, out: Array) -> None: ...
def spanning_forest(
    node_count: int, i: Indices, j: Indices, seeds: Indices,
) -> tuple[Indices, Indices, Indices, NDArray[np.uint8], Indices]: ...
def compose_tree(
    node: Indices, parent: Indices, edge: Indices, forward: NDArray[np.uint8], measurement: Array, values: Array,
) -> None: ...
