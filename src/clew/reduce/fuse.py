"""Parallel measurements of one relative pose put together."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between
from clew.graph import Factor, FactorGraph, Role

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def fuse_parallel(graph: FactorGraph, role: Role = Role.MARGINAL) -> int:
    """Replace measurements of the same relative pose by their weighted mean; returns how many fewer there are.

    Of the relative poses of one role those without a robust kernel, each from one pose to another in the same
    direction. The mean is that of one Gauss-Newton step, exact up to second order in their disagreement. Marginals of
    one place after the other add such measurements for ever; with this their number is bounded by that of the pairs.

    Args:
        graph: is changed.
        role: which factors.
    """
    before = graph.factor_count
    # As lists: the graph changes on the way.
    for block, ids in list(zip(graph.blocks(role), graph.block_ids(role), strict=True)):
        if isinstance(block, Between) and block.kernel is None:
            _fuse_block(graph, block, ids)
    return before - graph.factor_count


def _fuse_block(graph: FactorGraph, block: Factor, ids: Index) -> None:
    pairs, group, count = np.unique(block.keys, axis=0, return_inverse=True, return_counts=True)
    several = count > 1
    if not several.any():
        return
    rows = np.flatnonzero(several[group.ravel()])
    number = np.cumsum(several) - 1
    member = number[group.ravel()[rows]]
    size = int(several.sum())
    first = np.full(size, -1, dtype=np.int64)
    first[member[::-1]] = rows[::-1]
    functions = block.kinds[0].functions
    z, information = block.measurement[rows], block.information[rows]
    start = block.measurement[first]
    error = functions.local(z, start[member])
    by_start = functions.local_jacobians(z, start[member])[1]
    weighted = by_start.transpose(0, 2, 1) @ information
    hessian = np.zeros((size, *information.shape[1:]))
    gradient = np.zeros((size, information.shape[1]))
    np.add.at(hessian, member, weighted @ by_start)
    np.add.at(gradient, member, np.einsum("mij,mj->mi", weighted, error))
    mean = functions.retract(start, -np.linalg.solve(hessian, gradient[..., None])[..., 0])
    turn = functions.local_jacobians(start, mean)[1]  # from the tangent at the mean to that at the start
    graph.remove(ids[rows])
    fused = turn.transpose(0, 2, 1) @ hessian @ turn
    keys = pairs[several]
    graph.add(Between(
        keys[:, 0], keys[:, 1], mean, information=0.5 * (fused + fused.transpose(0, 2, 1)), role=block.role
    ))  # fmt: skip
