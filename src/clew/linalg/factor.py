"""A numeric Cholesky factor and what can be asked of it."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from clew import _native
from clew.errors import InputError
from clew.linalg.pattern import BlockPattern, Floats, Indices


class FactorStatus(Enum):
    """How a factorisation ended; the value is a sentence for the user."""

    OK = "the matrix is positive definite"
    NOT_POSITIVE_DEFINITE = "a pivot is zero or negative: measurements do not determine the variable"
    NOT_FINITE = "the matrix or its damping holds NaN or infinity, or numbers that overflow"


_STATUSES = (FactorStatus.OK, FactorStatus.NOT_POSITIVE_DEFINITE, FactorStatus.NOT_FINITE)


class Factor:
    """The Cholesky factor of one matrix; made, and overwritten, by `SymbolicFactor.factorize`.

    Everything but the properties raises `InputError` unless `status` is OK. A factor serves one thread at
    a time.
    """

    def __init__(self, pattern: BlockPattern, numeric: _native.linalg.Numeric) -> None:
        self._pattern = pattern
        self._numeric = numeric

    @property
    def pattern(self) -> BlockPattern:
        """The pattern of the matrix."""
        return self._pattern

    @property
    def status(self) -> FactorStatus:
        """Whether the factor can be used, and if not, why."""
        return _STATUSES[self._numeric.status]

    @property
    def failed_variable(self) -> int:
        """The variable whose pivot is not positive and finite, or -1."""
        return self._numeric.failed_variable

    @property
    def min_pivot(self) -> float:
        """Smallest ratio of a pivot to its diagonal entry (with damping) before elimination.

        It is in ``(0, 1]``, 0 after a failure and infinity for an empty matrix; near ``dim * 1e-16`` the
        matrix is singular to working precision.
        """
        return self._numeric.weakest_ratio

    @property
    def min_pivot_variable(self) -> int:
        """The variable with that pivot, or -1 for an empty matrix."""
        return self._numeric.weakest_variable

    def solve(self, rhs: ArrayLike, *, overwrite: bool = False) -> Floats:
        """Solution of ``H x = rhs``, in the shape of the right-hand side.

        Args:
            rhs: ``(dim,)`` or ``(dim, k)``, in the order of the variables.
            overwrite: the right-hand side is not needed any more; if it is a contiguous array of doubles, the
                solution takes its place.
        """
        self._require_ok()
        x: Floats
        x = np.require(rhs, np.float64, ["C", "W"]) if overwrite else np.array(rhs, np.float64, order="C")
        if x.ndim not in (1, 2) or x.shape[0] != self._pattern.dim:
            dim = self._pattern.dim
            raise InputError(f"the right-hand side has shape {x.shape}; it must be ({dim},) or ({dim}, k)")
        if x.ndim == 1:
            self._numeric.solve(x)
        elif x.size:
            self._numeric.solve_many(x)
        return x

    def log_determinant(self) -> float:
        """Natural logarithm of the determinant."""
        self._require_ok()
        return self._numeric.log_determinant()

    def marginals(self) -> Floats:
        """Marginal covariances of all variables, flat: the diagonal blocks of the inverse.

        The row-major ``(d, d)`` block of variable ``i`` starts at ``pattern.marginal_offsets[i]``;
        `BlockPattern.diagonal_block` picks one.
        """
        everyone = np.arange(self._pattern.sizes.size, dtype=np.int64)
        return self._inverse_blocks(everyone, everyone)

    def marginal_blocks(self, pairs: ArrayLike) -> Floats:
        """Blocks of the inverse, flat: row-major ``(sizes[i], sizes[j])``, one pair after the other.

        Args:
            pairs: ``(m, 2)`` variables, each pair within the factor's pattern; all pairs of the matrix's own
                pattern are. For others use `joint_covariance`.

        Raises:
            InputError: a pair outside the pattern, or a variable that does not exist.
        """
        ij = np.ascontiguousarray(np.asarray(pairs, dtype=np.int64).reshape(-1, 2).T)
        self._check_variables(ij)
        return self._inverse_blocks(ij[0], ij[1])

    def joint_covariance(self, variables: ArrayLike) -> Floats:
        """Dense joint covariance ``(d, d)`` of any variables, in their given order.

        Args:
            variables: ``(m,)`` indices.

        Raises:
            InputError: a variable that does not exist.
        """
        self._require_ok()
        chosen = np.ascontiguousarray(variables, dtype=np.int64).reshape(-1)
        self._check_variables(chosen)
        d = int(self._pattern.sizes[chosen].sum())
        out = np.empty(d * d)
        self._numeric.joint_covariance(chosen, out)
        return out.reshape(d, d)

    def _inverse_blocks(self, i: Indices, j: Indices) -> Floats:
        self._require_ok()
        sizes = self._pattern.sizes.astype(np.int64)
        out = np.empty(int(sizes[i] @ sizes[j]))
        missing = self._numeric.inverse_blocks(i, j, out)
        if missing >= 0:
            raise InputError(f"variables {i[missing]} and {j[missing]} are not in the factor's pattern; "
                             "joint_covariance has their block")
        return out

    def _check_variables(self, variables: Indices) -> None:
        n = self._pattern.sizes.size
        wrong = variables[(variables < 0) | (variables >= n)]
        if wrong.size:
            raise InputError(f"variable {int(wrong[0])} does not exist; there are {n}")

    def _require_ok(self) -> None:
        if self.status is not FactorStatus.OK:
            reason = self.status.value
            raise InputError(f"the factorisation failed at variable {self.failed_variable}: {reason}")
