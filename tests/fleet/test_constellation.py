"""Rigid fits and constellations of points: exact answers, honest covariance, chance told from agreement."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2

from clew.fleet.constellation import PointMap, find_agreement, share_in_common_area
from clew.fleet.rigid_fit import fit_rigid
from clew.geometry import se2

Array = NDArray[np.float64]
GATE = float(chi2.ppf(0.997, 2))


def spd(rng: np.random.Generator, n: int, sigma: float) -> Array:
    root = sigma * (np.eye(2) + 0.5 * rng.standard_normal((n, 2, 2)))
    return root @ np.swapaxes(root, 1, 2) + 1e-3 * sigma**2 * np.eye(2)


@given(st.integers(0, 10_000), st.integers(2, 9))
@settings(max_examples=50, deadline=None)
def test_fit_of_exact_points_is_exact(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    b, pose = 20 * rng.random((n, 2)), np.array([*(50 * rng.standard_normal(2)), rng.uniform(-np.pi, np.pi)])
    fit = fit_rigid(se2.act(pose, b), b, spd(rng, n, 0.1), spd(rng, n, 0.1))
    np.testing.assert_allclose(se2.between(pose, fit.T_a_b), 0, atol=1e-9)
    np.testing.assert_allclose(fit.distances, 0, atol=1e-12)


def test_covariance_of_the_fit_is_that_of_its_errors() -> None:
    rng = np.random.default_rng(1)
    b, pose = 10 * rng.random((6, 2)), np.array([3.0, -2.0, 2.5])
    cov_a, cov_b = spd(rng, 6, 0.05), spd(rng, 6, 0.08)
    root_a, root_b = np.linalg.cholesky(cov_a), np.linalg.cholesky(cov_b)
    nees = []
    for _ in range(600):
        noisy_a = se2.act(pose, b) + (root_a @ rng.standard_normal((6, 2, 1)))[..., 0]
        noisy_b = b + (root_b @ rng.standard_normal((6, 2, 1)))[..., 0]
        fit = fit_rigid(noisy_a, noisy_b, cov_a, cov_b)
        error = se2.local(fit.T_a_b, pose)
        nees.append(error @ np.linalg.solve(fit.covariance, error))
    low, high = chi2.ppf([0.005, 0.995], 3 * 600) / 600
    assert low < np.mean(nees) < high


def maps(rng: np.random.Generator, common: int, rest: int, pose: Array) -> tuple[PointMap, PointMap]:
    """Two maps with their first `common` points the same."""
    shared = 30 * rng.random((common, 2))
    a = np.concatenate([shared, 30 * rng.random((rest, 2))])
    b = np.concatenate([shared, 30 * rng.random((rest, 2))])
    b = se2.act(se2.inverse(pose), b + 0.03 * rng.standard_normal(b.shape))
    cov = np.broadcast_to(0.05**2 * np.eye(2), (common + rest, 2, 2))
    return PointMap(a, cov), PointMap(b, cov)


@given(st.integers(0, 10_000))
@settings(max_examples=8, deadline=None)
def test_common_points_are_found_among_others(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = np.array([*(80 * rng.standard_normal(2)), rng.uniform(-np.pi, np.pi)])
    a, b = maps(rng, 12, 12, pose)
    found = find_agreement(a, b, np.ones((24, 24), dtype=bool), gate=GATE)
    assert found is not None
    same = found.pairs[found.pairs[:, 0] == found.pairs[:, 1]]
    apart = np.concatenate([
        np.linalg.norm(a.points[:12, None] - others[None], axis=2) + np.where(np.eye(12, 24), np.inf, 0.0)
        for others in (a.points, se2.act(pose, b.points))
    ], axis=1)  # fmt: skip
    alone = np.flatnonzero(apart.min(axis=1) > 0.5)  # of two that stand nearer, one may be taken for the other
    assert len(alone) >= 6
    assert set(alone) <= set(same[:, 0])
    error = se2.between(pose, found.fit.T_a_b)
    assert abs(error[2]) < 0.01
    assert found.log10_false_alarms < -6


def test_chance_agreement_is_told_as_such() -> None:
    rng = np.random.default_rng(5)
    for _ in range(10):
        a, b = maps(rng, 0, 20, np.zeros(3))
        found = find_agreement(a, b, np.ones((20, 20), dtype=bool), gate=GATE)
        assert found is not None
        assert len(found.pairs) >= 3  # chance brings some together ...
        assert found.log10_false_alarms > -3  # ... and that is what it is called


def test_a_grid_fits_itself_in_many_ways() -> None:
    grid = np.stack(np.meshgrid(np.arange(5), np.arange(4)), axis=-1).reshape(-1, 2) * 3.0
    points = PointMap(grid, np.broadcast_to(0.05**2 * np.eye(2), (20, 2, 2)))
    found = find_agreement(points, points, np.ones((20, 20), dtype=bool), gate=GATE)
    assert found is not None
    assert len(found.pairs) == 20
    assert found.runner_up >= 15  # half a turn brings all together again; a step aside, fifteen or sixteen


def test_incompatible_points_are_never_paired() -> None:
    rng = np.random.default_rng(6)
    a, b = maps(rng, 8, 0, np.array([1.0, 2.0, 0.5]))
    only = np.eye(8, dtype=bool)
    only[0, 0] = False
    found = find_agreement(a, b, only, gate=GATE)
    assert found is not None
    assert sorted(map(tuple, found.pairs.tolist())) == [(k, k) for k in range(1, 8)]


def test_nothing_fits_nothing() -> None:
    rng = np.random.default_rng(7)
    a, b = maps(rng, 4, 0, np.zeros(3))
    assert find_agreement(a, b, np.zeros((4, 4), dtype=bool), gate=GATE) is None
    far = PointMap(b.points * 10, b.covariances)
    assert find_agreement(a, far, np.eye(4, dtype=bool), gate=GATE) is None


def test_share_in_the_common_area() -> None:
    corners = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
    cov = np.broadcast_to(1e-4 * np.eye(2), (6, 2, 2))
    a = PointMap(np.concatenate([corners, [[1.0, 2], [9, 9]]]), cov)  # one more inside, one outside
    b = PointMap(np.concatenate([corners, [[2.0, 1], [3, 3]]]), cov)  # two more inside
    pairs = np.stack([np.arange(4)] * 2, axis=1)
    assert share_in_common_area(a, b, np.zeros(3), pairs) == pytest.approx(8 / 11)
    assert share_in_common_area(a, b, np.zeros(3), pairs[:2]) == 1.0
