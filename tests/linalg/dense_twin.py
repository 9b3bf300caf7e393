"""Dense NumPy answers for block patterns, and random patterns to ask about."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from clew.linalg import BlockPattern

Floats = NDArray[np.float64]


def dense(pattern: BlockPattern, values: Floats) -> Floats:
    """The whole symmetric matrix, from the lower triangle of the values."""
    out = np.zeros((pattern.dim, pattern.dim))
    s = pattern.starts
    for b, (r, c) in enumerate(zip(pattern.rows, pattern.cols, strict=True)):
        block = values[pattern.offsets[b]:pattern.offsets[b + 1]]
        out[s[r]:s[r + 1], s[c]:s[c + 1]] = block.reshape(pattern.sizes[r], pattern.sizes[c])
    return np.tril(out) + np.tril(out, -1).T


def values_of(pattern: BlockPattern, matrix: Floats) -> Floats:
    """Block values of a dense matrix; what nobody may read, above the diagonal, is poisoned."""
    s = pattern.starts
    out = []
    for r, c in zip(pattern.rows, pattern.cols, strict=True):
        block = matrix[s[r]:s[r + 1], s[c]:s[c + 1]].copy()
        if r == c:
            block[np.triu_indices(block.shape[0], 1)] = 1e300
        out.append(block.ravel())
    return np.concatenate(out) if out else np.zeros(0)


def scalars(pattern: BlockPattern, variables: NDArray[np.int64]) -> NDArray[np.int64]:
    """Scalar indices of variables."""
    s = pattern.starts
    return np.concatenate([np.zeros(0, np.int64), *(np.arange(s[v], s[v + 1]) for v in variables)])


def random_information(pattern: BlockPattern, rng: np.random.Generator, weight: float = 0.3) -> Floats:
    """Values of a well-conditioned positive definite matrix: a sum of J^T J over all blocks, and a prior."""
    out = np.zeros((pattern.dim, pattern.dim))
    for r, c in zip(pattern.rows, pattern.cols, strict=True):
        index = scalars(pattern, np.unique([r, c]))
        jacobian = rng.normal(size=(index.size, index.size))
        out[np.ix_(index, index)] += jacobian.T @ jacobian
    out += weight * np.eye(pattern.dim)
    return values_of(pattern, out)


@st.composite
def patterns(draw: st.DrawFn, max_variables: int = 60, max_size: int = 6) -> BlockPattern:
    """Random graphs with variables of mixed sizes: empty, disconnected, chains with closures, tangles.

    The upper half of the range gives trees of many fronts, the lower half single ones.
    """
    n = draw(st.integers(0, max_variables))
    sizes = draw(st.lists(st.integers(1, max_size), min_size=n, max_size=n))
    vertex = st.integers(0, max(n - 1, 0))
    most = draw(st.sampled_from([0, 3, n])) if n else 0
    closures = draw(st.lists(st.tuples(vertex, vertex), max_size=most))
    gaps = draw(st.sets(vertex, max_size=5)) if draw(st.booleans()) else set(range(n))
    pairs = closures + [(k, k - 1) for k in range(1, n) if k not in gaps]
    return BlockPattern.from_pairs(sizes, [a for a, _ in pairs], [b for _, b in pairs])


def grid(side: int, size: int = 3, diagonals: bool = False) -> BlockPattern:
    """A square grid of equal variables: fronts of many shapes."""
    index = np.arange(side * side).reshape(side, side)
    pairs = [(index[1:].ravel(), index[:-1].ravel()), (index[:, 1:].ravel(), index[:, :-1].ravel())]
    if diagonals:
        pairs.append((index[1:, 1:].ravel(), index[:-1, :-1].ravel()))
    i, j = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return BlockPattern.from_pairs(np.full(side * side, size), i, j)


def grid_information(pattern: BlockPattern, seed: int = 0) -> Floats:
    """Values that are positive definite by diagonal dominance; fast for large patterns."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(-1, 1, size=int(pattern.offsets[-1]))
    size = pattern.sizes.max()
    degree = np.bincount(np.concatenate([pattern.rows, pattern.cols]), minlength=pattern.sizes.size)
    for block in np.flatnonzero(pattern.rows == pattern.cols):
        d = pattern.sizes[pattern.rows[block]]
        place = pattern.offsets[block] + np.arange(d) * (d + 1)
        values[place] = size * (degree[pattern.rows[block]] + 1.0)
    return values
