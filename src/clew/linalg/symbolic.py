"""Symbolic analysis: what a factorisation needs to know of the pattern, computed once."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from clew import _native
from clew.errors import InputError
from clew.linalg.factor import Factor, FactorStatus
from clew.linalg.ordering import choose_order
from clew.linalg.pattern import BlockPattern, Indices

#: Bytes of a factor that are worth a tenth of a millisecond: freed memory that the allocator keeps is given back first.
_LARGE = 250_000


class SymbolicFactor:
    """The analysis of one pattern; made by `analyse`, reused as long as the structure stands."""

    def __init__(
        self, pattern: BlockPattern, symbolic: _native.linalg.Symbolic, ordering: str, threads: int
    ) -> None:
        self._pattern = pattern
        self._symbolic = symbolic
        self._ordering = ordering
        self._threads = threads

    @property
    def pattern(self) -> BlockPattern:
        """The pattern that was analysed."""
        return self._pattern

    @property
    def permutation(self) -> Indices:
        """``(n,)`` the variables in the order of their elimination."""
        return self._symbolic.order().astype(np.int64)

    @property
    def ordering(self) -> str:
        """The method that found the order: "amd", "metis" or "natural"."""
        return self._ordering

    @property
    def flops(self) -> float:
        """Floating-point operations of one factorisation."""
        return self._symbolic.flops

    @property
    def factor_nonzeros(self) -> int:
        """Stored entries of the factor, with the zeros that make its fronts dense."""
        return int(self._symbolic.nonzeros)

    @property
    def factor_bytes(self) -> int:
        """Bytes of a factor."""
        return self._symbolic.factor_bytes

    @property
    def memory_bytes(self) -> int:
        """Bytes of a factor and of the update matrices that live while it is computed."""
        return self._symbolic.bytes(self._threads, False)

    def factorize(
        self,
        values: ArrayLike,
        *,
        damping: ArrayLike | None = None,
        into: Factor | None = None,
        keep_updates: bool = False,
        changed_variables: ArrayLike | None = None,
    ) -> Factor:
        """Cholesky factor of the matrix of `values` with `damping` added to its diagonal.

        Args:
            values: ``(pattern.offsets[-1],)`` blocks as `BlockPattern` lays them out.
            damping: ``(dim,)`` addition to the diagonal, or None.
            into: a factor of the same analysis; it is overwritten and returned, and nothing large is
                allocated.
            keep_updates: keep what fronts hand to each other, which takes memory, so that a later call may
                name `changed_variables`. A factor given in `into` keeps its own choice.
            changed_variables: redo only what depends on these: every block of `values` that differs from the
                last call lies between two of them, or on the diagonal of one. Needs `into` with kept updates.

        Raises:
            InputError: a wrong shape, or `changed_variables` without a usable `into`.
        """
        v = np.ascontiguousarray(values, dtype=np.float64)
        if v.shape != (int(self._pattern.offsets[-1]),):
            needed = int(self._pattern.offsets[-1])
            raise InputError(f"values have shape {v.shape}; the pattern needs ({needed},)")
        d = None if damping is None else np.ascontiguousarray(damping, dtype=np.float64)
        if d is not None and d.shape != (self._pattern.dim,):
            raise InputError(f"damping has shape {d.shape}; it must be ({self._pattern.dim},)")
        changed = None
        if changed_variables is not None:
            changed = self._usable_changes(changed_variables, into)
        if into is None:
            if self.factor_bytes >= _LARGE:
                _native.linalg.release_memory()
            into = Factor(self._pattern, _native.linalg.Numeric(self._symbolic, self._threads, keep_updates))
        elif into.pattern is not self._pattern:
            raise InputError("the factor to overwrite belongs to another pattern")
        into._numeric.factorize(v, d, changed)
        return into

    def _usable_changes(self, changed_variables: ArrayLike, into: Factor | None) -> Indices:
        if into is None or not into._numeric.keeps_updates or into.status is not FactorStatus.OK:
            raise InputError("changed_variables needs a factor in `into` that is OK and has keep_updates")
        changed = np.ascontiguousarray(changed_variables, dtype=np.int64).reshape(-1)
        into._check_variables(changed)
        return changed


def analyse(
    pattern: BlockPattern, *, ordering: str = "auto", threads: int = 1, order: ArrayLike | None = None
) -> SymbolicFactor:
    """Symbolic analysis of a pattern: elimination order, fronts, and a plan for assembling them.

    Args:
        pattern: the blocks of the matrix.
        ordering: "amd" (approximate minimum degree), "metis" (nested dissection, needs pymetis), "natural"
            (the order of the variables), or "auto": the better of the first two by predicted work.
        threads: how many threads a factorisation may use; results do not depend on it.
        order: ``(n,)`` the variables in an order of elimination that is known already; `ordering` is its name.

    Raises:
        InputError: an unknown ordering, an order that is no permutation, fewer than one thread, or arrays that are no
            pattern.
        MissingDependencyError: "metis" without pymetis.
    """
    if threads < 1:
        raise InputError(f"threads is {threads}; it must be at least 1")
    try:
        analysis = _native.linalg.Analysis(pattern.sizes, pattern.rows, pattern.cols, pattern.offsets)
        if order is None:
            chosen, ordering = choose_order(analysis, pattern.sizes.size, ordering)
        else:
            chosen = np.ascontiguousarray(order, dtype=np.int32)
        symbolic = _native.linalg.Symbolic(analysis, chosen)
    except ValueError as error:
        raise InputError(str(error)) from None
    return SymbolicFactor(pattern, symbolic, ordering, threads)
