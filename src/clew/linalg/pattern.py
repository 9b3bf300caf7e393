"""The layout of a block-sparse symmetric matrix: lower-triangular blocks in one flat array."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew import _native
from clew.errors import InputError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Ints = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class BlockPattern:
    """Which blocks of a symmetric matrix are stored, and where in one flat array of values.

    Blocks are those on and below the diagonal, sorted by column, then row; every diagonal block is present.
    A block is row-major ``(sizes[row], sizes[col])``; a diagonal block is stored whole and only its lower
    triangle is read. Build it with `from_pairs`.

    Attributes:
        sizes: ``(n,)`` scalar dimension of each variable.
        rows: ``(nb,)`` block row of each block.
        cols: ``(nb,)`` block column of each block, ``cols <= rows``.
        offsets: ``(nb + 1,)`` start of each block in the array of values; the last is its length.
    """

    sizes: Ints
    rows: Ints
    cols: Ints
    offsets: Indices

    @classmethod
    def from_pairs(cls, sizes: ArrayLike, i: ArrayLike, j: ArrayLike) -> BlockPattern:
        """The pattern that holds the blocks of all pairs and the whole diagonal.

        Args:
            sizes: ``(n,)`` dimension of each variable, at least 1.
            i: ``(m,)`` first variable of each pair.
            j: ``(m,)`` second variable; order, repeats and either triangle make no difference.

        Raises:
            InputError: a size below 1, or a variable that does not exist.
        """
        sizes_ = np.ascontiguousarray(sizes, dtype=np.int32).reshape(-1)
        n = sizes_.size
        if n and sizes_.min() < 1:
            worst = int(sizes_.argmin())
            raise InputError(f"variable {worst} has size {sizes_[worst]}; sizes are at least 1")
        i_, j_ = _pairs(i, j, n)
        rows, cols = _native.linalg.blocks_of_pairs(n, i_, j_)
        return cls(sizes_, rows, cols, _cumulative(sizes_[rows].astype(np.int64) * sizes_[cols]))

    @property
    def dim(self) -> int:
        """Scalar dimension of the matrix."""
        return int(self.starts[-1])

    @cached_property
    def starts(self) -> Indices:
        """``(n + 1,)`` first scalar row of each variable."""
        return _cumulative(self.sizes)

    @cached_property
    def column_starts(self) -> Indices:
        """``(n + 1,)`` first block of each block column; it is the diagonal block."""
        return np.searchsorted(self.cols, np.arange(self.sizes.size + 1)).astype(np.int64)

    @cached_property
    def marginal_offsets(self) -> Indices:
        """``(n + 1,)`` start of each variable's block in the array that `Factor.marginals` returns."""
        return _cumulative(self.sizes.astype(np.int64) ** 2)

    def block_index(self, i: ArrayLike, j: ArrayLike) -> Indices:
        """Index of the block that holds each pair, ``(m,)``; the pair may name either triangle.

        Raises:
            InputError: a pair whose block is not stored.
        """
        i_, j_ = _pairs(i, j, self.sizes.size)
        found = _native.linalg.find_blocks(self.column_starts, self.rows, i_, j_)
        missing = np.flatnonzero(found < 0)
        if missing.size:
            k = missing[0]
            raise InputError(f"the pattern has no block of variables {i_[k]} and {j_[k]}; add the pair to it")
        return found

    def diagonal(self, values: Floats) -> Floats:
        """Diagonal ``(dim,)`` of the matrix with these values ``(offsets[-1],)``."""
        out = np.empty(self.dim)
        _native.linalg.diagonal(self.sizes, self.column_starts, self.offsets, values, out)
        return out

    def diagonal_block(self, marginals: Floats, variable: int) -> Floats:
        """The ``(d, d)`` block of one variable in what `Factor.marginals` returned (a view)."""
        if not 0 <= variable < self.sizes.size:
            raise InputError(f"variable {variable} does not exist; there are {self.sizes.size}")
        d = int(self.sizes[variable])
        start = int(self.marginal_offsets[variable])
        return marginals[start:start + d * d].reshape(d, d)


def _cumulative(sizes: NDArray[np.integer]) -> Indices:
    out = np.zeros(sizes.size + 1, dtype=np.int64)
    np.cumsum(sizes, out=out[1:])
    return out


def _pairs(i: ArrayLike, j: ArrayLike, n: int) -> tuple[Indices, Indices]:
    i_ = np.ascontiguousarray(i, dtype=np.int64).reshape(-1)
    j_ = np.ascontiguousarray(j, dtype=np.int64).reshape(-1)
    if i_.size != j_.size:
        raise InputError(f"pairs need as many first as second variables, not {i_.size} and {j_.size}")
    for k in (i_, j_):
        if k.size and (k.min() < 0 or k.max() >= n):
            wrong = int(k.min()) if k.min() < 0 else int(k.max())
            raise InputError(f"a pair names variable {wrong}; there are {n}")
    return i_, j_
