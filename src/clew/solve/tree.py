"""Initial guess by composing measurements along a spanning tree."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.solve.relations import Relations

Array = NDArray[np.float64]


def span(relations: Relations, suspicious: bool) -> tuple[Any, Array]:
    """A breadth-first forest as native/solve/tree.hpp describes it, and the measurements of its edges.

    Args:
        relations: the measurements.
        suspicious: closures may be false; use odometry alone where that reaches as many poses.
    """
    count = len(relations.start)
    forest = _native.solve.spanning_forest(count, relations.i, relations.j, relations.known)
    if suspicious:
        odometry = relations.odometry()
        careful = _native.solve.spanning_forest(
            count, relations.i[odometry], relations.j[odometry], relations.known
        )
        if careful[4].max(initial=-1) == forest[4].max(initial=-1):
            return careful, relations.measurement(odometry=True)
    return forest, relations.measurement()


def tree_guess(relations: Relations, suspicious: bool) -> Array:
    """Poses ``(N, storage)`` along the tree of `span`: few measurements between any pose and a known one."""
    (node, parent, edge, forward, _), measurement = span(relations, suspicious)
    values: Array = relations.start.copy()
    _native.solve.compose_tree(node, parent, edge, forward, measurement, values)
    return values
