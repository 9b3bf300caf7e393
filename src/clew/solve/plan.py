"""Where the contributions of each factor go in the block Hessian: worked out once a structure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.linalg import BlockPattern

Columns = NDArray[np.int32]
Plan = NDArray[np.int64]


def pattern_of(sizes: NDArray[np.int32], columns: list[Columns]) -> BlockPattern:
    """Pattern of the Hessian of blocks whose factors touch these columns.

    Args:
        sizes: ``(n,)`` tangent dimension of each column.
        columns: for each block ``(M, arity)`` column of each variable, -1 for a constant one.
    """
    first, second = [], []
    for block in columns:
        for p in range(1, block.shape[1]):
            for q in range(p):
                both = (block[:, p] >= 0) & (block[:, q] >= 0)
                first.append(block[both, p])
                second.append(block[both, q])
    none = np.empty(0, np.int32)
    return BlockPattern.from_pairs(sizes, np.concatenate([none, *first]), np.concatenate([none, *second]))


def scatter_plan(pattern: BlockPattern, columns: Columns) -> Plan:
    """Targets ``(M, arity (arity + 1) / 2)`` of ``J_p^T W J_q`` for positions ``p >= q``, as native/solve
    reads them.

    A target is -1 (a constant variable) or ``4 * offset + flag``; flag 0 adds the product as it is, 1 its
    transpose, 2 both (two positions that hold one variable).
    """
    count, arity = columns.shape
    plan = np.full((count, arity * (arity + 1) // 2), -1, np.int64)
    for p in range(arity):
        for q in range(p + 1):
            row, col = columns[:, p], columns[:, q]
            both = (row >= 0) & (col >= 0)
            block = pattern.block_index(row[both], col[both])
            flag = np.where(row[both] == col[both], 0 if p == q else 2, row[both] < col[both])
            plan[both, p * (p + 1) // 2 + q] = 4 * pattern.offsets[block] + flag
    return plan
