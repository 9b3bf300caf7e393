"""How well each measurement of a graph is met: squared residuals, robust weights, surprise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from clew.graph import Factor, FactorGraph, Role

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Numbers of the roles in `FactorResiduals.role`, in the order of `clew.graph.Role`.
ROLES = tuple(Role)


class Loss(Protocol):
    """A robust kernel (`clew.noise.Kernel`)."""

    def rho(self, s: Array) -> Array: ...
    def weight(self, s: Array) -> Array: ...


@dataclass(frozen=True, eq=False)
class FactorResiduals:
    """One row for each factor of a graph, at the values that the graph holds, in the order of their ids.

    Attributes:
        ids: ``(F,)`` factor ids.
        keys: ``(F, 2)`` keys of the first two variables; -1 where there is only one.
        role: ``(F,)`` what each stands for, as a number in `ROLES`.
        dim: ``(F,)`` numbers that its residual consists of.
        squared: ``(F,)`` ``e^T Omega e``, without any robust kernel; about `dim` where the noise is as stated.
        cost: ``(F,)`` ``rho(e^T Omega e)``, what it adds to the cost; `squared` without a kernel.
        weight: ``(F,)`` ``rho'(e^T Omega e)``, by which a robust kernel scales its information; 1 without one.
    """

    ids: Index
    keys: Index
    role: NDArray[np.int8]
    dim: Index
    squared: Array
    cost: Array
    weight: Array

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def chance(self) -> Array:
        """``(F,)`` probability that noise as stated leaves a residual at least as large as each."""
        from scipy.special import chdtrc  # slow to import

        return np.asarray(chdtrc(np.maximum(self.dim, 1), self.squared), dtype=np.float64)

    def of_role(self, role: Role) -> NDArray[np.bool_]:
        """``(F,)`` which factors stand for this."""
        return np.asarray(self.role == ROLES.index(role))

    def largest(self, count: int) -> Index:
        """Rows of the factors that fit worst, worst first: the largest ``squared / dim``."""
        share = self.squared / np.maximum(self.dim, 1)
        return np.argsort(-share, kind="stable")[:count]


def factor_residuals(graph: FactorGraph, robust: Loss | None = None) -> FactorResiduals:
    """Residuals of all factors at the values of the graph (for a solution: of ``solution.graph``).

    Args:
        graph: with values.
        robust: kernel of all factors without one of their own, priors excepted, as in `clew.solve.optimize`.
    """
    parts = [_of_block(graph, block, ids, robust)
             for block, ids in zip(graph.blocks(), graph.block_ids(), strict=True)]
    if not parts:
        none = np.zeros(0, np.int64)
        return FactorResiduals(none, none.reshape(0, 2), none.astype(np.int8), none, *(np.zeros((3, 0))))
    order = np.argsort(np.concatenate([part.ids for part in parts]))
    names = ("ids", "keys", "role", "dim", "squared", "cost", "weight")
    return FactorResiduals(*(np.concatenate([getattr(part, name) for part in parts])[order] for name in names))


def _of_block(graph: FactorGraph, block: Factor, ids: Index, robust: Loss | None) -> FactorResiduals:
    count = len(block)
    values = [np.asarray(graph.values(keys).array) for keys in block.keys.T]
    error = block.residual(*values, measurement=block.measurement)
    squared = np.einsum("mi,mij,mj->m", error, block.information, error)
    kernel: Loss | None = robust if block.kernel is None and block.role is not Role.PRIOR else block.kernel
    keys = np.full((count, 2), -1, np.int64)
    keys[:, : block.keys.shape[1]] = block.keys[:, :2]
    return FactorResiduals(
        ids, keys, np.full(count, ROLES.index(block.role), np.int8), np.full(count, block.residual_dim),
        squared,
        squared if kernel is None else np.asarray(kernel.rho(squared)),
        np.ones(count) if kernel is None else np.asarray(kernel.weight(squared)),
    )  # fmt: skip
