"""Directions in which the cost does not change, to second order, at given values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.linalg import Factor, FactorStatus
from clew.solve.evaluate import System
from clew.solve.problem import Problem
from clew.solve.search import multiply, raised_diagonal

Array = NDArray[np.float64]

#: Most directions that are looked for.
WIDTH = 8
_SHIFT = 1e-9  # of the diagonal, to make a singular Hessian invertible
_ROUNDING = 1e-13  # of a diagonal entry, left in a pivot that should be zero
_FLAT = 1e-12  # eigenvalue relative to the diagonal that counts as zero


def scale_of(problem: Problem, system: System) -> Array:
    """Square roots of the Hessian's diagonal ``(dim,)``, never zero."""
    scale = raised_diagonal(problem, system)
    return np.sqrt(scale, out=scale)


def looks_singular(problem: Problem, system: System, factor: Factor | None, damping: float) -> bool:
    """Whether a factor of the Hessian plus `damping` times its diagonal leaves room for a singular Hessian.

    Along a direction that nothing constrains, a pivot shrinks to the damping, or to rounding; unless the
    diagonal itself is zero there, to rounding.
    """
    if factor is None or factor.status is not FactorStatus.OK:
        return True
    diagonal = problem.pattern.diagonal(system.hessian)
    empty = diagonal.min(initial=np.inf) < _ROUNDING * diagonal.max(initial=0.0)
    return bool(empty) or factor.min_pivot < max(_ROUNDING, 100.0 * damping)


def flat_directions(problem: Problem, system: System) -> Array:
    """Null space of the Hessian, ``(dim, k)`` with k up to `WIDTH`, orthonormal in units of the diagonal.

    Inverse subspace iteration on the scaled Hessian with a small shift, then Rayleigh-Ritz (Golub and Van
    Loan, "Matrix Computations", 2013, sections 8.2 and 8.3).
    """
    scale = scale_of(problem, system)
    factor = problem.symbolic.factorize(system.hessian, damping=_SHIFT * scale**2)
    if factor.status is not FactorStatus.OK:
        return np.empty((problem.pattern.dim, 0))
    width = min(WIDTH, problem.pattern.dim)
    vectors = np.random.default_rng(0).standard_normal((problem.pattern.dim, width))
    for _ in range(4):
        vectors, _ = np.linalg.qr(vectors)
        vectors = scale[:, None] * factor.solve(scale[:, None] * vectors)
    vectors, _ = np.linalg.qr(vectors)
    image = np.stack([multiply(problem, system, column / scale) / scale for column in vectors.T], axis=1)
    values, turn = np.linalg.eigh(vectors.T @ image)
    flat = vectors @ turn[:, values <= _FLAT]
    return np.asarray(flat)


def local_directions(problem: Problem, flat: Array) -> list[tuple[int, Array]]:
    """Columns of the variables that flat directions move, with orthonormal directions ``(r, dim)`` in each.

    Sorted by how much they move; a variable is left out if it moves less than a hundredth of the most mobile.
    """
    starts = problem.pattern.starts
    reach = np.sqrt(np.add.reduceat((flat**2).sum(axis=1), starts[:-1]))
    found = []
    for column in np.argsort(-reach, kind="stable"):
        if reach[column] < 1e-2 * reach.max():
            break
        directions, sizes, _ = np.linalg.svd(flat[starts[column] : starts[column + 1]])
        sizes = np.pad(sizes, (0, len(directions) - len(sizes)))
        found.append((int(column), directions[:, sizes > 1e-2 * reach.max()].T))
    return found
