"""A factor at a solution: its residuals, and how sure the solution is of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from clew.graph import Factor
from clew.solve import Solution

Array = NDArray[np.float64]


class Linearised:
    """A factor at a solution, with the covariances of its variables.

    Attributes:
        factor: of ``M`` measurements with residuals of length ``d``.
        values: of the variables, ``(M, storage)`` a position.
        error: ``(M, d)`` residuals.
        jacobians: ``(M, d, dim)`` by each position.
    """

    def __init__(self, solution: Solution, factor: Factor) -> None:
        self.factor = factor
        problem, self._cholesky = solution.posterior.problem, solution.posterior.factor
        kinds = [table.kind for table in problem.tables]
        self.values: list[Array] = []
        self._columns = []
        for position, kind in enumerate(factor.kinds):
            table = kinds.index(kind)
            order = np.argsort(problem.tables[table].keys)
            rows = order[np.searchsorted(problem.tables[table].keys, factor.keys[:, position], sorter=order)]
            self.values.append(solution.posterior.values[table][rows])
            self._columns.append(problem.columns[table][rows].astype(np.int64))
        self.error, self.jacobians = factor.linearise(*self.values)

    @property
    def squares(self) -> Array:
        """Outer products ``(M, d, d)`` of the residuals."""
        outer: Array = self.error[:, :, None] * self.error[:, None, :]
        return outer

    def covariance(self, positions: Sequence[int] | None = None) -> Array:
        """Covariance ``(M, d, d)`` of the residual from the variables at some positions, or from all."""
        chosen = range(len(self.jacobians)) if positions is None else positions
        total = np.zeros((*self.error.shape, self.error.shape[1]))
        for place, i in enumerate(chosen):
            for j in chosen[: place + 1]:
                term = self.jacobians[i] @ self._pair(i, j) @ np.swapaxes(self.jacobians[j], 1, 2)
                total += term if i == j else term + np.swapaxes(term, 1, 2)
        return total

    def leverages(self, moved: Sequence[int], given: Sequence[int], *, lengths: bool = False) -> Array:
        """Share ``(M, d)`` of each residual that the variables at the positions `moved` take up.

        Half the derivative of the logarithm of the determinant of the information of all variables but those at the
        positions `given`, by the logarithm of what the Jacobians at `moved` are multiplied by; with `lengths` those by
        coordinates in metres only.
        """
        everything = [k for k in range(len(self.jacobians)) if k not in given]
        whole, part = (np.concatenate([self.jacobians[i] for i in rows], axis=2) for rows in (everything, moved))
        if lengths:
            metres = np.concatenate([np.arange(self.factor.kinds[i].dim) < 2 for i in moved])
            part = part * metres
        of_part = np.swapaxes(part @ self._block(moved, given), 1, 2)
        known = whole @ self._block(everything, given) @ np.linalg.solve(self._block(given, given), of_part)
        spread = whole @ self._block(everything, moved) @ np.swapaxes(part, 1, 2) - known
        shares: Array = np.einsum("nij,nji->ni", self.factor.information, spread)
        return shares

    def _block(self, rows: Sequence[int], columns: Sequence[int]) -> Array:
        """Covariance ``(M, p, q)`` of the variables at some positions with those at others."""
        return np.concatenate([
            np.concatenate([self._pair(i, j) for j in columns], axis=2) for i in rows
        ], axis=1)  # fmt: skip

    def _pair(self, i: int, j: int) -> Array:
        if j > i:
            return np.swapaxes(self._pair(j, i), 1, 2)
        return self._pairs[i, j]

    @cached_property
    def _pairs(self) -> dict[tuple[int, int], Array]:
        """Covariances ``(M, p, q)`` of the variables at two positions, all in one pass through the engine's inverse."""
        count = len(self._columns)
        places = [(i, j) for i in range(count) for j in range(i + 1)]
        free = {(i, j): np.flatnonzero((self._columns[i] >= 0) & (self._columns[j] >= 0)) for i, j in places}
        wanted = np.concatenate([
            np.stack([self._columns[i][rows], self._columns[j][rows]], axis=1) for (i, j), rows in free.items()
        ])  # fmt: skip
        flat, start, out = self._cholesky.marginal_blocks(wanted), 0, {}
        for (i, j), rows in free.items():
            dims = self.factor.kinds[i].dim, self.factor.kinds[j].dim
            end = start + len(rows) * dims[0] * dims[1]
            block = np.zeros((len(self._columns[i]), *dims))
            block[rows] = flat[start:end].reshape(len(rows), *dims)
            out[i, j], start = block, end
        return out


def expected_squares(solution: Solution, factor: Factor) -> tuple[Array, Array]:
    """Residuals ``(M, d)`` at the solution, and their expected outer products ``(M, d, d)`` under its covariance."""
    at = Linearised(solution, factor)
    return at.error, at.squares + at.covariance()
