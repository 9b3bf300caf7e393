"""Branch and bound against brute force over the whole window."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.geometry import se2
from clew.scan import build_pyramid, correlate
from scan import twins
from scan.clouds import ROOM, cloud_of

Array = NDArray[np.float64]
CENTRE = np.array([0.15, -0.1, 0.05])
HALF = np.array([0.6, 0.4, 0.12])
STEP = 0.03


def problem(seed: int, levels: int = 4) -> tuple[object, Array, tuple[Array, Array, Array]]:
    """A pyramid, a source that lies near its target, and the scores of the whole window."""
    rng = np.random.default_rng(seed)
    target = cloud_of(ROOM, np.zeros(3), sigma=0.01, seed=seed).points[::7]
    source = se2.act(se2.inverse(CENTRE + rng.uniform(-0.08, 0.08, 3)), target) + rng.normal(0, 0.02, target.shape)
    pyramid = build_pyramid(target, resolution=0.1, sigma=0.08, levels=levels)
    return pyramid, source, twins.scores(pyramid.cells, pyramid.origin, 0.1, source, CENTRE, HALF, STEP)


@pytest.mark.parametrize(("seed", "levels", "sigma"), [(0, 1, 0.1), (1, 3, 0.05), (2, 4, 0.2)])
def test_pyramid_agrees_with_the_twin(seed: int, levels: int, sigma: float) -> None:
    points = np.random.default_rng(seed).uniform(-1, 1, (12, 2))
    pyramid = build_pyramid(points, resolution=0.1, sigma=sigma, levels=levels)
    expected = twins.pyramid(points, sigma, levels, pyramid.cells.shape[1:], pyramid.origin, 0.1)
    np.testing.assert_array_equal(pyramid.cells, expected)
    assert expected[0].max() > 200
    # the searched squares of a coarse level may begin outside of the grid: what they miss there must be empty
    margin = 1 << (levels - 1)
    assert not pyramid.cells[0, :margin].any()
    assert not pyramid.cells[0, -margin:].any()
    assert not pyramid.cells[0, :, :margin].any()
    assert not pyramid.cells[0, :, -margin:].any()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("levels", [1, 2, 5])
def test_best_score_is_that_of_brute_force(seed: int, levels: int) -> None:
    pyramid, source, (poses, likelihoods, _) = problem(seed, levels)
    match = correlate(pyramid, source, CENTRE, HALF, step_theta=STEP)
    assert match is not None
    assert match.score == match.likelihood == pytest.approx(likelihoods.max(), abs=1e-12)
    at = np.argmin(np.linalg.norm(poses - match.T_target_source, axis=1))
    np.testing.assert_allclose(poses[at], match.T_target_source, atol=1e-9)
    assert likelihoods[at] == pytest.approx(match.likelihood, abs=1e-12)
    assert match.likelihood > 0.5


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("weight", [0.01, 0.2, 2.0])
def test_prior_costs_what_its_formula_says(seed: int, weight: float) -> None:
    pyramid, source, _ = problem(seed)
    sigmas = np.array([0.1, 0.3, 0.05])
    _, _, scores = twins.scores(pyramid.cells, pyramid.origin, 0.1, source, CENTRE, HALF, STEP, sigmas, weight)
    match = correlate(pyramid, source, CENTRE, HALF, step_theta=STEP, prior_sigmas=sigmas, prior_weight=weight)
    assert match is not None
    assert match.score == pytest.approx(scores.max(), abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_excluded_neighbourhood_leaves_the_best_of_the_rest(seed: int) -> None:
    pyramid, source, (poses, likelihoods, _) = problem(seed)
    best = poses[np.argmax(likelihoods)]
    for distance, angle in ((0.25, 0.07), (0.25, 9.0), (9.0, 0.07)):
        error = np.abs(poses - best)
        rest = (np.hypot(error[:, 0], error[:, 1]) >= distance - 1e-9) | (error[:, 2] >= angle - 1e-9)
        match = correlate(pyramid, source, CENTRE, HALF, step_theta=STEP, exclude=(best, distance, angle))
        assert match is not None
        assert match.likelihood == pytest.approx(likelihoods[rest].max(), abs=1e-12)
    assert correlate(pyramid, source, CENTRE, HALF, step_theta=STEP, exclude=(best, 9.0, 9.0)) is None


def test_minimum_score_changes_nothing_but_whether_there_is_an_answer() -> None:
    pyramid, source, (_, likelihoods, _) = problem(0)
    free = correlate(pyramid, source, CENTRE, HALF, step_theta=STEP)
    assert free is not None
    limited = correlate(pyramid, source, CENTRE, HALF, step_theta=STEP, minimum_score=likelihoods.max() - 1e-6)
    assert limited is not None
    np.testing.assert_array_equal(limited.T_target_source, free.T_target_source)
    assert correlate(pyramid, source, CENTRE, HALF, step_theta=STEP, minimum_score=likelihoods.max() + 1e-6) is None


@pytest.mark.parametrize("offset", [(-3.9, 0.0), (4.2, -3.0), (0.0, 4.3), (1000.0, 0.0), (1e12, -1e12)])
def test_points_that_leave_the_grid_count_nothing(offset: tuple[float, float]) -> None:
    target = cloud_of(ROOM, np.zeros(3)).points[::9]
    pyramid = build_pyramid(target, resolution=0.1, sigma=0.08, levels=5)
    centre = np.array([*offset, 0.0])
    half = np.array([0.5, 0.5, 0.06])
    _, likelihoods, _ = twins.scores(pyramid.cells, pyramid.origin, 0.1, target, centre, half, STEP)
    match = correlate(pyramid, target, centre, half, step_theta=STEP)
    if likelihoods.max() == 0.0:
        assert match is None
    else:
        assert match is not None
        assert match.likelihood == pytest.approx(likelihoods.max(), abs=1e-12)


def test_window_of_one_pose_and_clouds_of_none() -> None:
    points = np.array([[1.0, 0.03], [0.0, 2.0]])
    pyramid = build_pyramid(points, resolution=0.1, sigma=0.1, levels=6)
    match = correlate(pyramid, points, np.zeros(3), np.zeros(3))
    assert match is not None
    assert match.likelihood > 0.85
    np.testing.assert_array_equal(match.T_target_source, np.zeros(3))
    nothing = np.zeros((0, 2))
    assert correlate(pyramid, nothing, np.zeros(3), HALF) is None
    assert correlate(build_pyramid(nothing, resolution=0.1, sigma=0.1, levels=6), points, np.zeros(3), HALF) is None


def test_finds_a_turn_by_half_a_circle() -> None:
    target = cloud_of(ROOM, np.zeros(3)).points
    truth = np.array([0.4, -0.3, -3.0])
    source = se2.act(se2.inverse(truth), target)
    pyramid = build_pyramid(target, resolution=0.05, sigma=0.05, levels=5)
    match = correlate(pyramid, source[::4], np.array([0.0, 0.0, 3.1]), np.array([0.6, 0.6, 0.3]))
    assert match is not None
    error = se2.between(truth, match.T_target_source)
    assert np.hypot(error[0], error[1]) < 0.05
    assert abs(error[2]) < 0.02
    assert -np.pi < match.T_target_source[2] <= np.pi
