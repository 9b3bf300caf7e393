"""Matrices that have no factor end in a status that names the variable."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clew.errors import InputError
from clew.linalg import BlockPattern, FactorStatus, analyse
from linalg.dense_twin import dense, grid, grid_information, patterns, random_information, values_of


def test_an_indefinite_diagonal_names_its_variable() -> None:
    pattern = grid(6)
    values = grid_information(pattern)
    values[pattern.offsets[pattern.block_index([17], [17])[0]] + 4] = -1.0
    factor = analyse(pattern).factorize(values)
    assert factor.status is FactorStatus.NOT_POSITIVE_DEFINITE
    assert factor.failed_variable == 17
    assert factor.min_pivot == 0.0
    for question in (factor.marginals, factor.log_determinant, lambda: factor.solve(np.zeros(pattern.dim)),
                     lambda: factor.joint_covariance([0]), lambda: factor.marginal_blocks([[0, 0]])):
        with pytest.raises(InputError, match="variable 17"):
            question()


def test_a_variable_without_information_is_named() -> None:
    pattern = BlockPattern.from_pairs([3, 3, 2], [0], [1])
    values = random_information(pattern, np.random.default_rng(0))
    values[pattern.offsets[-2]:] = 0.0
    factor = analyse(pattern).factorize(values)
    assert (factor.status, factor.failed_variable) == (FactorStatus.NOT_POSITIVE_DEFINITE, 2)
    damping = np.zeros(pattern.dim)
    damping[6:] = 1e-6
    assert analyse(pattern).factorize(values, damping=damping).status is FactorStatus.OK


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
@settings(max_examples=40, deadline=None)
@given(patterns(max_size=4), st.integers(0, 2**31))
def test_poison_anywhere_that_is_read_is_not_finite(poison: float, pattern: BlockPattern, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = random_information(pattern, rng)
    damping = np.ones(pattern.dim)
    read = np.flatnonzero(values != 1e300)
    if read.size == 0:
        return
    symbolic = analyse(pattern)
    poisoned = values.copy()
    poisoned[rng.choice(read)] = poison
    factor = symbolic.factorize(poisoned)
    assert factor.status is FactorStatus.NOT_FINITE
    damping[rng.integers(pattern.dim)] = poison
    assert symbolic.factorize(values, damping=damping).status is FactorStatus.NOT_FINITE
    # The same storage recovers.
    assert symbolic.factorize(values, into=factor).status is FactorStatus.OK
    assert np.isfinite(factor.marginals()).all()


def test_numbers_that_overflow_are_not_ok() -> None:
    pattern = BlockPattern.from_pairs([1, 1], [0], [1])
    for values in ([1e-300, 1e300, 1.0], [1e308, 0.0, 1e308]):
        factor = analyse(pattern).factorize(np.array(values), damping=np.array([0.0, 1e308]))
        assert factor.status is not FactorStatus.OK


def test_the_weakest_pivot_shows_a_nearly_free_variable() -> None:
    # Relative measurements fix everything but the common offset; a faint prior on one variable fixes that.
    n = 30
    pattern = BlockPattern.from_pairs([1] * n, np.arange(1, n), np.arange(n - 1))
    difference = np.diff(np.eye(n), axis=0)
    for prior in (1.0, 1e-6, 1e-12):
        matrix = difference.T @ difference
        matrix[12, 12] += prior
        values = values_of(pattern, matrix)
        np.testing.assert_allclose(dense(pattern, values), matrix)
        factor = analyse(pattern).factorize(values)
        assert factor.status is FactorStatus.OK
        assert 0 <= factor.min_pivot_variable < n
        assert prior / 10 < factor.min_pivot * n < 10 * n * prior


def test_min_pivot_of_a_hand_worked_matrix() -> None:
    # [[4, 2], [2, 3]]: pivots 4 and 3 - 1 = 2, so the ratios to the diagonal are 1 and 2/3.
    pattern = BlockPattern.from_pairs([1, 1], [0], [1])
    factor = analyse(pattern, ordering="natural").factorize(np.array([4.0, 2.0, 3.0]))
    assert factor.min_pivot == pytest.approx(2 / 3)
    assert factor.min_pivot_variable == 1


def test_threads_do_not_change_the_variable_that_is_named() -> None:
    pattern = grid(50, 3, diagonals=True)
    values = grid_information(pattern)
    for variable in (3, 700, 1500, 2499):
        values[pattern.offsets[pattern.block_index([variable], [variable])[0]]] = -1.0
    named = {analyse(pattern, ordering="amd", threads=t).factorize(values).failed_variable for t in (1, 2, 3)}
    assert len(named) == 1


def test_threads_do_not_change_the_variable_that_is_named_where_several_fail_at_once() -> None:
    """A front of the top of the tree and one of a thread's own both fail: the first in the order is named."""
    pattern = grid(50, 4, diagonals=True)
    good = grid_information(pattern)
    symbolic = [analyse(pattern, ordering="amd", threads=t) for t in (1, 2, 4, 8)]
    order = symbolic[0].permutation
    for first in range(len(order) // 4, len(order), 60):
        values = good.copy()
        for variable in order[first:].tolist():
            values[pattern.offsets[pattern.block_index([variable], [variable])[0]]] = -50.0
        assert len({s.factorize(values).failed_variable for s in symbolic}) == 1
