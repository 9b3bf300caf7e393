"""Initial guess by composing measurements along a spanning tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.solve.relations import Relations

Array = NDArray[np.float64]


def tree_guess(relations: Relations, suspicious: bool) -> Array:
    """Poses ``(N, storage)`` along a breadth-first tree: few measurements between any pose and a known one.

    Args:
        relations: the measurements.
        suspicious: closures may be false; use odometry alone where that reaches as many poses.
    """
    count = len(relations.start)
    edges = np.arange(len(relations.i))
    forest = _native.solve.spanning_forest(count, relations.i, relations.j, relations.known)
    if suspicious:
        odometry = np.flatnonzero(relations.odometry)
        careful = _native.solve.spanning_forest(
            count, relations.i[odometry], relations.j[odometry], relations.known
        )
        if careful[4].max(initial=-1) == forest[4].max(initial=-1):
            forest, edges = careful, odometry
    values: Array = relations.start.copy()
    node, parent, edge, forward, _ = forest
    _native.solve.compose_tree(
        node, parent, edge, forward, np.ascontiguousarray(relations.measurement[edges]), values
    )
    return values
