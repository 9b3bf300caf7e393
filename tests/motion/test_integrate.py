"""Integration between keyframes: composition, covariance by sampling, bias, gyro."""

from __future__ import annotations

import numpy as np
import pytest

from clew.errors import InputError
from clew.factors import PreintegratedMotion, Prior
from clew.geometry import SE2, Point2, se2
from clew.graph import FactorGraph
from clew.motion import VelocityNoise, cut, preintegrate, velocity_motion
from clew.solve import optimize


def drive(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    stamps = np.cumsum(rng.uniform(0.005, 0.03, count))
    return stamps, rng.uniform(0.0, 0.5, count), rng.uniform(-1.0, 1.0, count)


def test_stretches_compose_what_a_loop_composes() -> None:
    rng = np.random.default_rng(1)
    stamps, speed, turn = drive(rng, 400)
    frames = np.linspace(stamps[0] - 0.1, stamps[-1] + 0.1, 7)
    pieces = cut(stamps, frames)
    assert np.isclose(pieces.duration.sum(), frames[-1] - frames[0])
    known = pieces.reading >= 0
    steps = velocity_motion(pieces.duration, speed[pieces.reading] * known, turn[pieces.reading] * known)
    whole = preintegrate(steps.increment, pieces.first)
    bounds = np.append(pieces.first, len(pieces.duration))
    for s in range(6):
        pose, covariance = np.zeros(3), np.zeros((3, 3))
        for k in range(bounds[s], bounds[s + 1]):
            pose = se2.compose(pose, steps.increment[k])
            back = se2.adjoint(se2.inverse(steps.increment[k]))
            covariance = back @ covariance @ back.T + steps.covariance[k]
        np.testing.assert_allclose(whole.motion[s], pose, atol=1e-12)
        np.testing.assert_allclose(whole.covariance(steps.covariance)[s], covariance, atol=1e-15)
    variances = np.stack([rng.uniform(size=(len(steps), 3)) for _ in range(2)])
    dense = np.stack([whole.covariance(each[:, :, None] * np.eye(3)) for each in variances])
    np.testing.assert_allclose(whole.diagonal_covariance(variances), dense, atol=1e-12)


def test_covariance_by_sampling() -> None:
    rng = np.random.default_rng(2)
    noise = VelocityNoise(0.05, 0.02, 0.05, 0.05, 0.0, 0.0)
    steps = velocity_motion(np.full(60, 0.05), np.full(60, 0.6), np.linspace(-1.0, 1.5, 60), noise)
    whole = preintegrate(steps.increment, np.array([0]))
    error = rng.standard_normal((4000, 60, 3)) * np.sqrt(np.einsum("nii->ni", steps.covariance))
    samples = se2.retract(steps.increment, error)
    ends = np.array([preintegrate(sample, np.array([0])).motion[0] for sample in samples])
    found = np.cov(se2.local(whole.motion[0], ends).T)
    expected = whole.covariance(steps.covariance)[0]
    np.testing.assert_allclose(found, expected, atol=0.08 * expected.max())


def test_a_gyro_finds_its_bias_in_the_graph() -> None:
    rng = np.random.default_rng(4)
    bias, count = 0.05, 3000
    stamps = 0.01 * np.arange(count)
    speed, rate = np.full(count, 0.5), 0.8 * np.sin(0.3 * stamps)
    frames = np.append(stamps[::100], stamps[-1] + 0.01)
    pieces = cut(stamps, frames)
    truth = velocity_motion(pieces.duration, speed[pieces.reading], rate[pieces.reading])
    measured = rate + bias + 0.01 * rng.standard_normal(count)
    steps = velocity_motion(pieces.duration, speed[pieces.reading], measured[pieces.reading])
    whole = preintegrate(steps.increment, pieces.first)
    by_bias = whole.jacobian(np.stack([-steps.by_control[:, :, 1], np.zeros((len(steps), 3))], axis=2))
    true_poses = np.zeros((len(frames), 3))
    for k, motion in enumerate(preintegrate(truth.increment, pieces.first).motion):
        true_poses[k + 1] = se2.compose(true_poses[k], motion)
    graph = FactorGraph()
    keys = graph.add_pose(SE2.from_array(true_poses))
    graph.set_constant(keys[[0, -1]])
    parameters = graph.add_point(Point2(0.0, 0.0))
    graph.add(PreintegratedMotion(keys[:-1], keys[1:], [np.full(len(keys) - 1, parameters)], whole.motion, by_bias,
                                  np.zeros(2), sigmas=[0.01, 0.01, 0.002]))
    graph.add(Prior(parameters, Point2(0.0, 0.0), sigmas=1.0))
    solution = optimize(graph, init="file")
    assert solution.status.ok
    assert abs(solution.value(parameters).array[0] - bias) < 0.002
    assert np.linalg.norm(solution.values(SE2).array[:, :2] - true_poses[:, :2], axis=1).max() < 0.02


@pytest.mark.parametrize(
    ("stamps", "frames", "words"),
    [([0.0, 2.0, 1.0], [0.0, 1.0], "in order"), ([0.0, 1.0], [0.0], "two keyframes"), ([0.0], [1.0, 1.0], "increase")],
)
def test_bad_times_are_named(stamps: list[float], frames: list[float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        cut(stamps, frames)
    with pytest.raises(InputError, match="increment"):
        preintegrate(np.zeros((0, 3)), np.array([0]))
