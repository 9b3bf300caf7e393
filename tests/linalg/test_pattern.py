"""Laws of BlockPattern."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clew.errors import InputError
from clew.linalg import BlockPattern


@given(st.data())
def test_from_pairs_holds_the_pairs_and_the_diagonal_sorted_and_once(data: st.DataObject) -> None:
    n = data.draw(st.integers(1, 12))
    sizes = data.draw(st.lists(st.integers(1, 6), min_size=n, max_size=n))
    vertex = st.integers(0, n - 1)
    pairs = data.draw(st.lists(st.tuples(vertex, vertex), max_size=40))
    pattern = BlockPattern.from_pairs(sizes, [a for a, _ in pairs], [b for _, b in pairs])

    expected = {(max(p), min(p)) for p in pairs} | {(k, k) for k in range(n)}
    blocks = list(zip(pattern.rows.tolist(), pattern.cols.tolist(), strict=True))
    assert blocks == sorted(expected, key=lambda rc: (rc[1], rc[0]))
    lengths = [sizes[r] * sizes[c] for r, c in blocks]
    assert pattern.offsets.tolist() == [0, *np.cumsum(lengths)]
    assert pattern.dim == sum(sizes)
    for a, b in pairs:
        for index in (pattern.block_index([a], [b]), pattern.block_index([b], [a])):
            assert blocks[index[0]] == (max(a, b), min(a, b))


def test_types_are_those_of_the_contract() -> None:
    pattern = BlockPattern.from_pairs([3, 2], [0], [1])
    assert [a.dtype.name for a in (pattern.sizes, pattern.rows, pattern.cols)] == ["int32"] * 3
    assert [a.dtype.name for a in (pattern.offsets, pattern.starts, pattern.column_starts)] == ["int64"] * 3
    assert pattern.starts.tolist() == [0, 3, 5]
    assert pattern.column_starts.tolist() == [0, 2, 3]
    assert pattern.marginal_offsets.tolist() == [0, 9, 13]


def test_an_empty_pattern() -> None:
    pattern = BlockPattern.from_pairs([], [], [])
    assert pattern.dim == 0
    assert pattern.offsets.tolist() == [0]
    assert pattern.block_index([], []).size == 0


@pytest.mark.parametrize(("sizes", "i", "j", "says"), [
    ([3, 0], [0], [1], "size 0"),
    ([3, 3], [0], [2], "variable 2"),
    ([3, 3], [-1], [1], "variable -1"),
    ([3, 3], [0, 1], [1], "as many"),
])
def test_bad_pairs_are_refused(sizes: list[int], i: list[int], j: list[int], says: str) -> None:
    with pytest.raises(InputError, match=says):
        BlockPattern.from_pairs(sizes, i, j)


def test_a_pair_outside_the_pattern_is_named() -> None:
    pattern = BlockPattern.from_pairs([3, 3, 3], [0], [1])
    with pytest.raises(InputError, match="variables 2 and 0"):
        pattern.block_index([1, 2], [0, 0])


def test_native_code_checks_that_values_fit_the_pattern() -> None:
    pattern = BlockPattern.from_pairs([2, 3], [1], [0])
    with pytest.raises(ValueError, match="do not fit the pattern"):
        pattern.diagonal(np.zeros(int(pattern.offsets[-1]) - 1))


def test_diagonal_block_is_a_view_of_the_right_place() -> None:
    pattern = BlockPattern.from_pairs([2, 1, 3], [], [])
    flat = np.arange(14.0)
    assert pattern.diagonal_block(flat, 2).tolist() == [[5, 6, 7], [8, 9, 10], [11, 12, 13]]
    with pytest.raises(InputError, match="variable 3"):
        pattern.diagonal_block(flat, 3)
