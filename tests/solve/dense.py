"""NumPy twins: normal equations of a graph, one factor at a time, by formula and numeric differentiation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.graph import FactorGraph
from clew.noise import Kernel

Array = NDArray[np.float64]


def numeric_jacobian(factor: Any, row: int, position: int, values: list[Array]) -> Array:
    """Central differences along the tangent of `retract`."""
    kind = factor.kinds[position]
    measurement = factor.measurement[row : row + 1]
    columns = []
    for k in range(kind.dim):
        sides = []
        for sign in (1.0, -1.0):
            moved = list(values)
            delta = np.zeros((1, kind.dim))
            delta[0, k] = sign * 1e-6
            moved[position] = kind.functions.retract(values[position], delta)
            sides.append(factor.residual(*moved, measurement=measurement)[0])
        columns.append((sides[0] - sides[1]) / 2e-6)
    return np.stack(columns, axis=1)


def normal_equations(
    graph: FactorGraph, free: list[int], robust: Kernel | None = None
) -> tuple[float, Array, Array]:
    """Cost, dense Hessian and gradient over the keys in `free`, in that order."""
    dims = [graph.kind(key).dim for key in free]
    starts = dict(zip(free, np.cumsum([0, *dims])[:-1], strict=True))
    hessian, gradient, cost = np.zeros((sum(dims), sum(dims))), np.zeros(sum(dims)), 0.0
    for block in graph.blocks():
        kernel = block.kernel or (robust if block.role != "prior" else None)
        for row, keys in enumerate(block.keys.tolist()):
            values = [graph.value(key).array[None] for key in keys]
            error = block.residual(*values, measurement=block.measurement[row : row + 1])[0]
            information = block.information[row]
            s = np.array([error @ information @ error])
            cost += float(s[0] if kernel is None else kernel.rho(s)[0])
            information = information * (1.0 if kernel is None else kernel.weight(s)[0])
            jacobian = np.zeros((len(error), len(gradient)))
            for position, key in enumerate(keys):
                if key in starts:
                    span = slice(starts[key], starts[key] + graph.kind(key).dim)
                    jacobian[:, span] += numeric_jacobian(block, row, position, values)
            hessian += jacobian.T @ information @ jacobian
            gradient += jacobian.T @ information @ error
    return cost, hessian, gradient


def dense_hessian(problem: Any, system: Any) -> Array:
    """The block Hessian as a full symmetric matrix."""
    pattern = problem.pattern
    out = np.zeros((pattern.dim, pattern.dim))
    for block, (row, col) in enumerate(zip(pattern.rows, pattern.cols, strict=True)):
        rows = slice(pattern.starts[row], pattern.starts[row + 1])
        cols = slice(pattern.starts[col], pattern.starts[col + 1])
        values = system.hessian[pattern.offsets[block] : pattern.offsets[block + 1]]
        out[rows, cols] = values.reshape(rows.stop - rows.start, cols.stop - cols.start)
        out[cols, rows] = out[rows, cols].T
    return out
