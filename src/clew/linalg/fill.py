"""Which blocks of the Cholesky factor are not zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from clew.errors import InputError
from clew.linalg.pattern import BlockPattern, Indices


def factor_blocks(pattern: BlockPattern, order: ArrayLike) -> tuple[Indices, Indices]:
    """Rows and columns ``(b,)`` of the blocks of the factor, both as places in the order of elimination.

    Column by column: what the matrix has below the diagonal, and what the columns hand on whose first entry
    below the diagonal lies here (Davis, Direct Methods for Sparse Linear Systems, 2006, section 4.1). The
    engine itself works on whole fronts; this is for pictures of the fill, for counting it, and for tests.

    Args:
        pattern: of the matrix.
        order: ``(n,)`` the variables in the order of their elimination, as `SymbolicFactor.permutation`.

    Raises:
        InputError: an order that is no permutation of the variables.
    """
    variables = np.asarray(order, dtype=np.int64).reshape(-1)
    n = pattern.sizes.size
    if not np.array_equal(np.sort(variables), np.arange(n)):
        raise InputError(f"the order must hold each of the {n} variables once")
    place = np.empty(n, dtype=np.int64)
    place[variables] = np.arange(n)
    i, j = place[pattern.rows], place[pattern.cols]
    low, high = np.minimum(i, j), np.maximum(i, j)
    by_column = np.lexsort((high, low))
    below = np.split(high[by_column], np.searchsorted(low[by_column], np.arange(1, n))) if n else []
    handed_on: list[list[Indices]] = [[] for _ in range(n)]
    columns = []
    for column, own in enumerate(below):
        rows = np.unique(np.concatenate([own, *handed_on[column]]))
        handed_on[column] = []
        if rows.size > 1:
            handed_on[rows[1]].append(rows[1:])
        columns.append(rows)
    counts = [len(rows) for rows in columns]
    return np.concatenate([*columns, np.empty(0, np.int64)]), np.repeat(np.arange(n), counts)
