"""What pairs of scans are worth, and how honest the refined poses are about themselves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from clew.geometry import SE2, se2
from clew.motion import Odometry
from clew.scan import LaserScan
from clew.slam import Slam
from clew.slam.pair_noise import pair_variance, with_variance
from slam.drives import mapped, outing, round_trip, truth_of

Array = NDArray[np.float64]


def _information(rng: np.random.Generator, count: int) -> Array:
    """Well conditioned ones of about a millimetre and a hundredth of a degree."""
    half = rng.normal(0.0, 200.0, (count, 3, 3)) + 1000.0 * np.eye(3)
    return np.asarray(half @ half.transpose(0, 2, 1))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.05, 20.0))
def test_variance_is_that_of_the_errors(seed: int, variance: float) -> None:
    rng = np.random.default_rng(seed)
    information = _information(rng, 2000)
    noise = rng.standard_normal((2000, 3, 1)) * np.sqrt(variance)
    error = np.linalg.solve(np.linalg.cholesky(information).transpose(0, 2, 1), noise)[..., 0]
    assert pair_variance(error, information, 1) == pytest.approx(variance, rel=0.15, abs=0.02)
    few_wrong = error.copy()
    few_wrong[:20] *= 30.0
    assert pair_variance(few_wrong, information, 1) < 1.4 * variance + 0.02


def test_residuals_that_the_poses_were_fitted_to_count_for_more() -> None:
    """Poses about a ring of pairs whose errors are of known size: what the fit took away is given back."""
    rng = np.random.default_rng(3)
    keyframes, steps = 60, (1, 2, 3)
    first = np.concatenate([np.arange(keyframes)] * len(steps))
    second = np.concatenate([(np.arange(keyframes) + step) % keyframes for step in steps])
    design = np.zeros((len(first), keyframes))
    design[np.arange(len(first)), first], design[np.arange(len(first)), second] = -1.0, 1.0
    measured = rng.standard_normal((len(first), 3))
    residual = measured - design @ np.linalg.lstsq(design, measured, rcond=None)[0]
    information = np.tile(np.eye(3), (len(first), 1, 1))
    assert np.mean(residual**2) < 0.75
    assert pair_variance(residual, information, keyframes) == pytest.approx(1.0, abs=0.12)


def test_pairs_that_hold_nothing_twice_are_believed_as_they_are() -> None:
    assert pair_variance(np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)), 4) == 1.0


def test_a_pair_is_worth_two_scans_but_not_more_along_a_corridor() -> None:
    room, corridor = np.diag([4e4, 5e4, 9e5]), np.diag([40.0, 5e4, 9e5])
    turned = se2.adjoint(np.array([0.0, 0.0, 0.6]))
    for information in (room, turned.T @ room @ turned):
        np.testing.assert_allclose(with_variance(information[None], 0.5)[0], 4.0 * information, rtol=1e-9)
    found = with_variance(corridor[None], 0.5)[0]
    np.testing.assert_allclose(np.diag(found), [40.0, 2e5, 3.6e6], rtol=0.02)
    everything = with_variance((turned.T @ corridor @ turned)[None], 0.5)[0]
    np.testing.assert_allclose(np.linalg.eigvalsh(everything), np.linalg.eigvalsh(found), rtol=1e-6)


@pytest.mark.parametrize("which", ["ring", "office", "hall"])
def test_stated_uncertainty_of_refined_poses_is_that_of_their_errors(which: str) -> None:
    log = round_trip() if which == "ring" else outing(which)
    slam = mapped(log, refine=True)
    keyframes = slam.keyframes
    truth = truth_of(log)[np.searchsorted(log.timestamps, keyframes.timestamps)]
    covariance = slam.covariances()
    assert covariance.shape == (len(keyframes), 3, 3)
    np.testing.assert_array_equal(covariance[0], 0.0)
    error = se2.between(keyframes.T_world_robot, truth)[1:]
    squared = np.einsum("mi,mij,mj->m", error, np.linalg.inv(covariance[1:]), error)
    assert 0.15 < squared.mean() / 3 < 3.0
    assert np.mean(squared < 7.81) > 0.8
    row = len(keyframes) // 2
    np.testing.assert_allclose(slam.solution().covariances(SE2)[row], covariance[row])


def test_what_rests_on_odometry_alone_is_worth_what_it_was() -> None:
    """Pairs of scans that agree well say nothing of a step without returns, known to centimetres in every direction."""
    step = np.linalg.inv(np.diag([0.03, 0.04, 0.02]) ** 2)
    np.testing.assert_allclose(with_variance(step[None], 0.25)[0], step, rtol=0.1)


def test_refining_without_returns_leaves_the_uncertainty_as_it_is() -> None:
    slam = Slam()
    for k in range(40):
        slam.add(Odometry(0.25 * k, np.array([0.2 * k, 0.0, 0.0])))
        slam.add(LaserScan(0.25 * k, np.full(181, np.inf), -np.pi / 2, np.pi / 180, 0.1, 30.0))
    slam.optimise()
    last = int(slam.graph.keys(SE2)[-1])
    before = slam.solution().covariance(last)
    slam.refine()
    np.testing.assert_allclose(np.diag(slam.solution().covariance(last)), np.diag(before), rtol=0.05)
