"""Elimination orders and the predicted work, against elimination on a dense pattern."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from clew import _native
from clew.errors import InputError, MissingDependencyError
from clew.linalg import BlockPattern, analyse
from linalg.dense_twin import grid, patterns


def analysis_of(pattern: BlockPattern) -> _native.linalg.Analysis:
    return _native.linalg.Analysis(pattern.sizes, pattern.rows, pattern.cols, pattern.offsets)


def eliminated(pattern: BlockPattern, order: NDArray[np.int32]) -> tuple[float, int]:
    """Sum of squared column lengths of the factor and number of filled blocks, by the definition."""
    n = pattern.sizes.size
    joined = np.zeros((n, n), dtype=bool)
    joined[pattern.rows, pattern.cols] = joined[pattern.cols, pattern.rows] = True
    before = joined.sum()
    flops, done = 0.0, np.zeros(n, dtype=bool)
    for v in order:
        done[v] = True
        below = np.flatnonzero(joined[v] & ~done)
        joined[np.ix_(below, below)] = True
        rows = pattern.sizes[below].sum() + pattern.sizes[v]
        flops += float((np.arange(rows, rows - pattern.sizes[v], -1.0) ** 2).sum())
    return flops, int(joined.sum() - before) // 2


@settings(max_examples=80, deadline=None)
@given(patterns(), st.integers(0, 2**31))
def test_predicted_work_is_that_of_the_elimination(pattern: BlockPattern, seed: int) -> None:
    order = np.random.default_rng(seed).permutation(pattern.sizes.size).astype(np.int32)
    assert analysis_of(pattern).flops(order) == eliminated(pattern, order)[0]


@settings(max_examples=80, deadline=None)
@given(st.integers(1, 60), st.integers(1, 6), st.integers(0, 2**31))
def test_minimum_degree_fills_no_tree_of_equal_variables(n: int, size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    up = (rng.random(n - 1) * np.arange(1, n)).astype(np.int64)
    pattern = BlockPattern.from_pairs(np.full(n, size), np.arange(1, n), up)
    order = analysis_of(pattern).amd()
    assert sorted(order.tolist()) == list(range(n))
    assert eliminated(pattern, order)[1] == 0


@settings(max_examples=40, deadline=None)
@given(patterns(max_size=1))
def test_minimum_degree_is_close_to_the_greedy_rule(pattern: BlockPattern) -> None:
    """Exact minimum degree, recomputed from scratch for every pivot."""
    n = pattern.sizes.size
    joined = np.zeros((n, n), dtype=bool)
    joined[pattern.rows, pattern.cols] = joined[pattern.cols, pattern.rows] = True
    left, exact = set(range(n)), []
    while left:
        v = min(left, key=lambda k: (joined[k, sorted(left)].sum(), k))
        left.remove(v)
        exact.append(v)
        below = [u for u in left if joined[v, u]]
        joined[np.ix_(below, below)] = True
    greedy = eliminated(pattern, np.array(exact, dtype=np.int32))[0]
    assert eliminated(pattern, analysis_of(pattern).amd())[0] <= 1.4 * greedy + 50


def test_minimum_degree_on_a_grid_beats_the_band() -> None:
    pattern = grid(40)
    analysis = analysis_of(pattern)
    natural = np.arange(1600, dtype=np.int32)
    assert analysis.flops(analysis.amd()) < 0.25 * analysis.flops(natural)


def test_dissection_is_chosen_where_it_saves_work() -> None:
    pytest.importorskip("pymetis", reason="needs pymetis")
    pattern = grid(60, 6, diagonals=True)
    chosen = analyse(pattern, ordering="auto")
    analysis = analysis_of(pattern)
    work = {name: analysis.flops(analyse(pattern, ordering=name).permutation.astype(np.int32))
            for name in ("amd", "metis")}
    assert chosen.ordering == min(work, key=lambda name: work[name])


def test_without_pymetis_auto_goes_on_and_metis_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pymetis", None)
    pattern = grid(60, 6, diagonals=True)
    assert analyse(pattern, ordering="auto").ordering == "amd"
    with pytest.raises(MissingDependencyError, match=r"clew\[metis\]"):
        analyse(pattern, ordering="metis")


def test_an_order_that_is_no_permutation_is_refused() -> None:
    analysis = analysis_of(grid(2))
    for order in ([0, 1, 2], [0, 1, 2, 2], [0, 1, 2, 4], [0, 1, 2, -1]):
        with pytest.raises(ValueError, match="permutation"):
            _native.linalg.Symbolic(analysis, np.array(order, dtype=np.int32))


def test_an_order_that_is_known_already_is_used() -> None:
    pattern = grid(5)
    known = analyse(pattern, ordering="amd")
    again = analyse(pattern, ordering="amd", order=known.permutation)
    assert (again.flops, again.ordering) == (known.flops, "amd")
    shuffled = np.random.default_rng(1).permutation(25)
    other = analyse(pattern, ordering="mine", order=shuffled)
    assert other.ordering == "mine"
    assert analysis_of(pattern).flops(other.permutation.astype(np.int32)) == pytest.approx(
        eliminated(pattern, shuffled.astype(np.int32))[0]
    )
    with pytest.raises(InputError, match="permutation"):
        analyse(pattern, order=np.zeros(25))
