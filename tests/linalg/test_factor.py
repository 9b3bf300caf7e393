"""The native factorisation against dense NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clew.errors import InputError
from clew.linalg import BlockPattern, FactorStatus, analyse
from linalg.dense_twin import dense, grid, grid_information, patterns, random_information, scalars

ORDERINGS = ("amd", "natural")


def close(a: np.ndarray, b: np.ndarray, rtol: float = 1e-8) -> None:
    scale = np.abs(b).max() if b.size else 0.0
    np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol * scale)


@settings(max_examples=150, deadline=None)
@given(patterns(), st.sampled_from(ORDERINGS), st.integers(0, 2**31))
def test_everything_agrees_with_the_dense_inverse(pattern: BlockPattern, ordering: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = random_information(pattern, rng)
    damping = rng.uniform(0, 2, size=pattern.dim) if seed % 2 else None
    matrix = dense(pattern, values) + np.diag(np.zeros(pattern.dim) if damping is None else damping)
    inverse = np.linalg.inv(matrix)
    factor = analyse(pattern, ordering=ordering).factorize(values, damping=damping)

    assert factor.status is FactorStatus.OK
    assert factor.failed_variable == -1
    rhs = rng.normal(size=(pattern.dim, 5))
    close(factor.solve(rhs[:, 0]), inverse @ rhs[:, 0])
    close(factor.solve(rhs), inverse @ rhs)
    for right in (rhs[:, 0].copy(), rhs.copy()):
        solution = factor.solve(right)
        assert factor.solve(right, overwrite=True) is right
        assert right.tobytes() == solution.tobytes()
    expected = inverse @ rhs[:, 0]
    close(factor.solve(rhs[:, 0], overwrite=True), expected)  # a column need not be contiguous
    np.testing.assert_array_equal(pattern.diagonal(values), np.diag(dense(pattern, values)))
    assert factor.log_determinant() == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-10, abs=1e-10)
    marginals = factor.marginals()
    n = pattern.sizes.size
    for v in range(n):
        index = scalars(pattern, np.array([v]))
        close(pattern.diagonal_block(marginals, v), inverse[np.ix_(index, index)])
    lower = np.stack([pattern.rows, pattern.cols], axis=1)
    pairs = np.concatenate([lower, lower[:, ::-1]])
    blocks = [inverse[np.ix_(scalars(pattern, p[:1]), scalars(pattern, p[1:]))].ravel() for p in pairs]
    close(factor.marginal_blocks(pairs), np.concatenate(blocks) if blocks else np.zeros(0))
    chosen = rng.integers(0, n, size=min(n, 4)) if n else np.zeros(0, np.int64)
    index = scalars(pattern, chosen)
    close(factor.joint_covariance(chosen), inverse[np.ix_(index, index)])


@pytest.mark.parametrize("size", [1, 2, 3, 6, 7])
@pytest.mark.parametrize("ordering", ORDERINGS)
def test_a_grid_with_large_fronts(size: int, ordering: str) -> None:
    pattern = grid(18, size, diagonals=True)
    values = grid_information(pattern)
    inverse = np.linalg.inv(dense(pattern, values))
    factor = analyse(pattern, ordering=ordering).factorize(values)
    rhs = np.random.default_rng(0).normal(size=(pattern.dim, 3))
    close(factor.solve(rhs), inverse @ rhs, 1e-10)
    close(factor.solve(rhs[:, 1]), inverse @ rhs[:, 1], 1e-10)
    blocks = np.stack([inverse[k:k + size, k:k + size] for k in range(0, pattern.dim, size)])
    close(factor.marginals(), blocks.ravel(), 1e-10)
    chosen = np.arange(0, 18 * 18, 17)
    index = scalars(pattern, chosen)
    close(factor.joint_covariance(chosen), inverse[np.ix_(index, index)], 1e-10)


def test_storage_is_hardly_more_than_the_triangle() -> None:
    """Triangles of pivots have no gaps; update matrices share few places, panels that are not filled yet before all."""
    side = 40
    number = np.arange(side * side).reshape(side, side)
    pairs = np.concatenate([np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
                            np.stack([number[:-1].ravel(), number[1:].ravel()])], axis=1)
    symbolic = analyse(BlockPattern.from_pairs(np.full(side * side, 6), *pairs), ordering="amd")
    assert 8 * symbolic.factor_nonzeros <= symbolic.factor_bytes <= 1.05 * 8 * symbolic.factor_nonzeros
    assert symbolic.memory_bytes < 1.15 * symbolic.factor_bytes


def test_a_dense_matrix_is_cut_into_several_fronts() -> None:
    """Wide supernodes are eliminated in pieces; variables of many sizes do not end where pieces do."""
    sizes = np.resize([6, 3, 2, 1, 7], 160)
    first, second = np.tril_indices(len(sizes), -1)
    pattern = BlockPattern.from_pairs(sizes, first, second)
    symbolic = analyse(pattern, ordering="natural")
    assert symbolic._symbolic.fronts >= 3
    values = random_information(pattern, np.random.default_rng(3))
    inverse = np.linalg.inv(dense(pattern, values))
    factor = symbolic.factorize(values)
    close(factor.solve(np.ones(pattern.dim)), inverse.sum(axis=1))
    close(factor.marginal_blocks([[159, 0]]), inverse[-7:, :6].ravel())


@pytest.mark.parametrize("dim", [1, 8, 9, 63, 64, 65, 200, 521])
def test_one_dense_variable(dim: int) -> None:
    rng = np.random.default_rng(dim)
    jacobian = rng.normal(size=(dim, dim))
    matrix = jacobian @ jacobian.T + dim * np.eye(dim)
    pattern = BlockPattern.from_pairs([dim], [], [])
    factor = analyse(pattern).factorize(matrix.ravel())
    rhs = rng.normal(size=(dim, 9))
    close(factor.solve(rhs), np.linalg.solve(matrix, rhs), 1e-10)
    close(factor.marginals().reshape(dim, dim), np.linalg.inv(matrix), 1e-10)


def test_metis_orders_the_same_matrix() -> None:
    pytest.importorskip("pymetis", reason="needs pymetis")
    pattern = grid(12)
    values = grid_information(pattern)
    symbolic = analyse(pattern, ordering="metis")
    assert symbolic.ordering == "metis"
    assert sorted(symbolic.permutation.tolist()) == list(range(144))
    rhs = np.ones(pattern.dim)
    close(symbolic.factorize(values).solve(rhs), np.linalg.solve(dense(pattern, values), rhs), 1e-10)


def test_predicted_work_of_a_chain_is_exact() -> None:
    pattern = BlockPattern.from_pairs([3] * 4, [1, 2, 3], [0, 1, 2])
    symbolic = analyse(pattern, ordering="natural")
    assert symbolic.permutation.size == 4
    # So small a chain is one front: a dense triangle of 12 rows.
    assert symbolic.factor_nonzeros == 12 * 13 // 2
    assert symbolic.memory_bytes >= symbolic.factor_nonzeros * 8


@pytest.mark.parametrize(("side", "size"), [(60, 3), (45, 6)])  # many subtrees; fronts large enough to be shared
def test_results_do_not_depend_on_threads_or_repetition(side: int, size: int) -> None:
    pattern = grid(side, size, diagonals=True)
    values = grid_information(pattern)
    rhs = np.random.default_rng(1).normal(size=pattern.dim)
    answers = []
    for threads in (1, 1, 2, 3, 1_000_000):  # no more are started than there are processors
        symbolic = analyse(pattern, ordering="amd", threads=threads)
        factor = symbolic.factorize(values)
        again = symbolic.factorize(values, into=factor)
        answers.append((again.solve(rhs).tobytes(), again.marginals().tobytes(), again.log_determinant()))
    assert all(answer == answers[0] for answer in answers)


@pytest.mark.parametrize("ordering", ["amd", "natural"])
def test_threads_on_trees_that_are_hard_to_cut(ordering: str) -> None:
    """A chain of many fronts, a hub with many leaves, and variables wider than any front that is cut."""
    n = 100_000
    leaves = BlockPattern.from_pairs(np.full(n, 3), np.zeros(n - 1), np.arange(1, n))
    chain = BlockPattern.from_pairs(np.full(n, 3), np.arange(1, n), np.arange(n - 1))
    wide = BlockPattern.from_pairs([300, 250, 400, 3, 200], [1, 2, 3, 4, 2, 4], [0, 0, 2, 3, 1, 0])
    for pattern in (leaves, chain, wide) if ordering == "amd" else (chain, wide):
        values = grid_information(pattern)
        answers = [analyse(pattern, ordering=ordering, threads=threads).factorize(values).solve(np.ones(pattern.dim))
                   for threads in (1, 2, 5)]
        assert answers[1].tobytes() == answers[0].tobytes()
        assert answers[2].tobytes() == answers[0].tobytes()


def test_storage_is_reused() -> None:
    pattern = grid(5)
    symbolic = analyse(pattern)
    values = grid_information(pattern)
    factor = symbolic.factorize(values)
    before = factor.solve(np.ones(pattern.dim))
    again = symbolic.factorize(2 * values, into=factor)
    assert again is factor
    close(factor.solve(np.ones(pattern.dim)), before / 2, 1e-12)
    # Questions leave the factor as it was.
    factor.marginals()
    close(factor.solve(np.ones(pattern.dim)), before / 2, 1e-12)


@settings(max_examples=60, deadline=None)
@given(patterns(), st.integers(0, 2**31), st.integers(1, 3))
def test_partial_refactorisation_equals_a_full_one(pattern: BlockPattern, seed: int, threads: int) -> None:
    rng = np.random.default_rng(seed)
    values = random_information(pattern, rng)
    symbolic = analyse(pattern, threads=threads)
    factor = symbolic.factorize(values, keep_updates=True)
    factor.marginals()  # must not use up the kept updates
    n = pattern.sizes.size
    changed = np.unique(rng.integers(0, n, size=3)) if n else np.zeros(0, np.int64)
    new = values.copy()
    for b in np.flatnonzero(np.isin(pattern.rows, changed) & np.isin(pattern.cols, changed)):
        new[pattern.offsets[b]:pattern.offsets[b + 1]] *= 1.0 if pattern.rows[b] != pattern.cols[b] else 1.5
    symbolic.factorize(new, into=factor, changed_variables=changed)
    full = symbolic.factorize(new)
    rhs = rng.normal(size=pattern.dim)
    assert factor.solve(rhs).tobytes() == full.solve(rhs).tobytes()
    assert (factor.min_pivot, factor.min_pivot_variable) == (full.min_pivot, full.min_pivot_variable)


def test_partial_refactorisation_climbs_to_the_root_and_leaves_other_fronts_alone() -> None:
    pattern = grid(16)
    symbolic = analyse(pattern, ordering="amd")
    values = grid_information(pattern)
    factor = symbolic.factorize(values, keep_updates=True)
    first, last = symbolic.permutation[[0, -1]]
    rhs = np.random.default_rng(2).normal(size=pattern.dim)
    diagonal = pattern.offsets[pattern.block_index([first], [first])[0]]
    values[diagonal] += 1.0
    symbolic.factorize(values, into=factor, changed_variables=[first])
    np.testing.assert_array_equal(factor.solve(rhs), symbolic.factorize(values).solve(rhs))
    values[diagonal] = np.nan  # unseen, for the front of the first variable is not assembled again
    symbolic.factorize(values, into=factor, changed_variables=[last])
    assert factor.status is FactorStatus.OK


def test_partial_refactorisation_needs_kept_updates() -> None:
    pattern = grid(3)
    symbolic = analyse(pattern)
    values = grid_information(pattern)
    with pytest.raises(InputError, match="keep_updates"):
        symbolic.factorize(values, changed_variables=[0])
    with pytest.raises(InputError, match="keep_updates"):
        symbolic.factorize(values, into=symbolic.factorize(values), changed_variables=[0])


def test_wrong_shapes_are_refused() -> None:
    pattern = grid(3)
    symbolic = analyse(pattern)
    values = grid_information(pattern)
    factor = symbolic.factorize(values)
    with pytest.raises(InputError, match="values have shape"):
        symbolic.factorize(values[1:])
    with pytest.raises(InputError, match="damping has shape"):
        symbolic.factorize(values, damping=np.zeros(3))
    with pytest.raises(InputError, match="another pattern"):
        analyse(grid(3)).factorize(values, into=factor)
    for rhs in (np.zeros(3), np.zeros((3, 2)), np.zeros((pattern.dim, 1, 1))):
        with pytest.raises(InputError, match="right-hand side"):
            factor.solve(rhs)
    with pytest.raises(InputError, match="variable 9"):
        factor.joint_covariance([9])
    with pytest.raises(InputError, match="variable -1"):
        factor.marginal_blocks([[-1, 0]])
    with pytest.raises(InputError, match="choose one of"):
        analyse(pattern, ordering="best")
    with pytest.raises(InputError, match="at least 1"):
        analyse(pattern, threads=0)


def test_a_pair_outside_the_factor_is_refused() -> None:
    pattern = BlockPattern.from_pairs([6] * 40, np.arange(1, 40), np.arange(39))
    factor = analyse(pattern).factorize(random_information(pattern, np.random.default_rng(0)))
    with pytest.raises(InputError, match="variables 0 and 39"):
        factor.marginal_blocks([[0, 1], [0, 39]])


def test_arrays_that_are_no_pattern_are_refused() -> None:
    good = BlockPattern.from_pairs([3, 3], [0], [1])
    bad = [
        BlockPattern(good.sizes, good.rows[::-1].copy(), good.cols[::-1].copy(), good.offsets),
        BlockPattern(good.sizes, good.rows[1:], good.cols[1:], good.offsets[1:] - good.offsets[1]),
        BlockPattern(good.sizes, good.rows, good.cols, good.offsets[:-1]),
        BlockPattern(good.sizes[:1].copy(), good.rows, good.cols, good.offsets),
        BlockPattern(good.sizes, good.cols, good.rows, good.offsets),
    ]
    for pattern in bad:
        with pytest.raises(InputError, match="pattern"):
            analyse(pattern)
