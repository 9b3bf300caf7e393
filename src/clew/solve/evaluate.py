"""One block of factors at given values: cost, and its share of Hessian and gradient."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.geometry import SE2, SE3
from clew.graph import Factor
from clew.noise import Kernel

Array = NDArray[np.float64]
Rows = NDArray[np.int32]

#: Native kernel of the factors that have one, by `Factor.native` and the manifold of the first variable.
KERNELS = {
    ("between", SE2): "between_se2",
    ("between", SE3): "between_se3",
    ("prior", SE2): "between_se2",  # the relative pose seen from an identity that is constant
    ("prior", SE3): "between_se3",
    ("point", SE2): "point_observation_2d",
    ("point", SE3): "point_observation_3d",
    ("range_bearing", SE2): "range_bearing_2d",
}


@dataclass(frozen=True, eq=False)
class System:
    """The normal equations ``H step = -g``: values of the block Hessian and the gradient, without one
    half."""

    hessian: Array
    gradient: Array

    def clear(self) -> None:
        """Set to zero."""
        self.hessian.fill(0.0)
        self.gradient.fill(0.0)


@dataclass(frozen=True, eq=False)
class CompiledBlock:
    """A block of factors with everything that its evaluation needs and that does not depend on values.

    Attributes:
        factor: the block.
        tables: for each position the number of its kind in the list of values.
        rows: ``(M, arity)`` row of each variable in the array of its kind.
        gradient: ``(M, arity)`` offset of each variable in the gradient, -1 for constant ones.
        plan: see `scatter_plan`.
    """

    factor: Factor
    tables: tuple[int, ...]
    rows: Rows
    gradient: Rows
    plan: NDArray[np.int64]

    def evaluate(self, values: list[Array], kernel: Kernel | None, system: System | None) -> float:
        """Cost ``sum rho(e^T Omega e)``; with a system also adds ``J^T W J`` and ``J^T W e`` to it."""
        hessian, gradient = (None, None) if system is None else (system.hessian, system.gradient)
        robust, scale = (0, 1.0) if kernel is None else (int(kernel.native_id), float(kernel.scale))
        known = 0 <= robust <= 7
        name = KERNELS.get((self.factor.native or "", self.factor.kinds[0]))
        if name is not None and known:
            return self._native(name, values, robust, scale, hessian, gradient)
        arrays = [values[table][self.rows[:, p]] for p, table in enumerate(self.tables)]
        if system is None:
            residual = np.ascontiguousarray(
                self.factor.residual(*arrays, measurement=self.factor.measurement)
            )
            jacobians = [np.zeros((*residual.shape, kind.dim)) for kind in self.factor.kinds]
        else:
            error, derivatives = self.factor.linearise(*arrays)
            residual, jacobians = np.ascontiguousarray(error), [np.ascontiguousarray(j) for j in derivatives]
        information, cost = self.factor.information, 0.0
        if (
            kernel is not None and not known
        ):  # a loss written in Python: weigh here, accumulate without a loss
            s = np.einsum("mi,mij,mj->m", residual, information, residual)
            cost = float(kernel.rho(s).sum())
            information = kernel.weight(s)[:, None, None] * information
            robust, scale = 0, 1.0
        total = _native.solve.accumulate(
            residual, jacobians, information, self.gradient, self.plan, robust, scale, hessian, gradient
        )
        return cost if kernel is not None and not known else total

    def _native(
        self,
        name: str,
        values: list[Array],
        robust: int,
        scale: float,
        hessian: Array | None,
        gradient: Array | None,
    ) -> float:
        factor = self.factor
        sensor = None if factor.T_robot_sensor is None else np.ascontiguousarray(factor.T_robot_sensor)
        if len(factor.kinds) == 2:
            first, second = (values[table] for table in self.tables)
            return _native.solve.linearise(
                name,
                first,
                second,
                sensor,
                self.rows,
                factor.measurement,
                factor.information,
                self.gradient,
                self.plan,
                robust,
                scale,
                hessian,
                gradient,
            )
        count, kind = len(factor), factor.kinds[0]
        fixed = np.zeros((count, 1), np.int32)
        nowhere = np.full((count, 2), -1, np.int64)
        return _native.solve.linearise(
            name,
            kind.identity((1,)).array,
            values[self.tables[0]],
            None,
            np.hstack([fixed, self.rows]),
            factor.measurement,
            factor.information,
            np.hstack([fixed - 1, self.gradient]),
            np.hstack([nowhere, self.plan]),
            robust,
            scale,
            hessian,
            gradient,
        )
