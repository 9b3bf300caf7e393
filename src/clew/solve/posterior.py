"""How sure the solution is: covariances of the variables at the minimum."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.linalg import Factor, FactorStatus
from clew.solve.evaluate import System
from clew.solve.problem import Problem, Values

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NO_COVARIANCE = (
    "there is no covariance: the measurements leave some variables free to move; see Solution.diagnosis"
)


@dataclass(frozen=True, eq=False)
class Posterior:
    """The Gaussian around the minimum: inverse of the (robustly weighted) Hessian, factored when first asked.

    `system` holds the normal equations at `values`. Variables that are held constant have covariance zero.
    """

    problem: Problem
    values: Values
    system: System

    @cached_property
    def factor(self) -> Factor:
        """Cholesky factor of the Hessian, whatever its status."""
        return self.problem.symbolic.factorize(self.system.hessian)

    def _factor(self) -> Factor:
        if self.factor.status is not FactorStatus.OK:
            raise InputError(NO_COVARIANCE)
        return self.factor

    def marginals(self, table: int) -> Array:
        """Marginal covariances ``(N, dim, dim)`` of all variables of one kind."""
        columns, dim = self.problem.columns[table], self.problem.tables[table].kind.dim
        out = np.zeros((len(columns), dim, dim))
        free = columns >= 0
        if free.any():
            start = self.problem.pattern.marginal_offsets[columns[free]]
            out[free] = self._marginals[start[:, None] + np.arange(dim * dim)].reshape(-1, dim, dim)
        return out

    @cached_property
    def _marginals(self) -> Array:
        return self._factor().marginals()

    def joint(self, columns: Index, sizes: Index) -> Array:
        """Dense joint covariance of variables given by their columns (-1: constant) and tangent sizes."""
        starts = np.append(0, np.cumsum(sizes))
        free = columns >= 0
        scalars = np.concatenate(
            [np.arange(s, s + d) for s, d in zip(starts[:-1][free], sizes[free], strict=True)]
            or [np.empty(0, np.int64)]
        )
        out = np.zeros((int(starts[-1]), int(starts[-1])))
        if free.any():
            out[np.ix_(scalars, scalars)] = self._factor().joint_covariance(columns[free])
        return out
