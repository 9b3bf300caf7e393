"""Motion models: exact arcs, Jacobians by differences, covariances by sampling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import se2
from clew.motion import Ackermann, MotionStep, VelocityNoise, WheelEncoders, velocity_motion

Array = NDArray[np.float64]


def encoders(left: Array, right: Array) -> MotionStep:
    return WheelEncoders(0.4).motion(left, right)


def velocity(speed: Array, turn_rate: Array) -> MotionStep:
    return velocity_motion(0.7, speed, turn_rate)


def ackermann(speed: Array, steering: Array) -> MotionStep:
    return Ackermann(2.8, encoder_offset=0.76).motion(0.7, speed, steering)


MODELS: list[Callable[[Array, Array], MotionStep]] = [encoders, velocity, ackermann]


def test_a_quarter_circle_is_exact() -> None:
    step = velocity_motion(1.0, np.pi / 2, np.pi / 2)
    np.testing.assert_allclose(step.increment, [[1.0, 1.0, np.pi / 2]], atol=1e-14)
    euler = np.array([np.pi / 2, 0.0, np.pi / 2])
    assert np.abs(step.increment - euler).max() > 0.5


def test_many_short_steps_are_one_long_one() -> None:
    pose = np.zeros(3)
    for _ in range(50):
        pose = velocity_motion(0.02, 0.8, -1.3).predict(pose)[0]
    np.testing.assert_allclose(pose, velocity_motion(1.0, 0.8, -1.3).increment[0], atol=1e-12)


def test_wheels_that_turn_against_each_other_turn_on_the_spot() -> None:
    np.testing.assert_allclose(encoders(np.array([-0.1]), np.array([0.1])).increment, [[0.0, 0.0, 0.5]], atol=1e-15)


def test_ackermann_drives_on_the_circle_of_its_steering() -> None:
    steering = 0.3
    radius = 2.0 / np.tan(steering)
    step = Ackermann(2.0).motion(1.0, 0.5 * np.pi * radius, steering)
    np.testing.assert_allclose(step.increment, [[radius, radius, np.pi / 2]], atol=1e-12)


def test_the_inner_wheel_of_a_left_turn_is_slower_than_the_axle() -> None:
    plain, inner = (Ackermann(2.0, encoder_offset=d).motion(1.0, 1.0, 0.2).increment[0] for d in (0.0, 0.5))
    assert inner[2] > plain[2] * 1.02


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.__name__)
def test_jacobians_agree_with_differences(model: Callable[[Array, Array], MotionStep]) -> None:
    rng = np.random.default_rng(3)
    controls = np.concatenate([rng.uniform(-1.2, 1.2, (40, 2)), [[1.0, 0.0], [1.0, 1e-7], [0.0, 0.0]]])
    step = model(controls[:, 0], controls[:, 1])
    h = 1e-6
    for column in (0, 1):
        shift = np.eye(2)[column] * h
        up, down = (model(*(controls + sign * shift).T).increment for sign in (1.0, -1.0))
        numeric = (se2.local(step.increment, up) - se2.local(step.increment, down)) / (2 * h)
        np.testing.assert_allclose(step.by_control[:, :, column], numeric, atol=1e-7)


def test_the_derivative_by_the_pose_before() -> None:
    step = velocity_motion(0.5, 1.2, 2.0)
    start, h = np.array([1.0, -2.0, 0.7]), 1e-6
    for column in range(3):
        delta = np.eye(3)[column] * h
        moved = [step.predict(se2.retract(start, sign * delta))[0] for sign in (1.0, -1.0)]
        numeric = (se2.local(step.predict(start)[0], moved[0]) - se2.local(step.predict(start)[0], moved[1])) / (2 * h)
        np.testing.assert_allclose(step.by_pose[0][:, column], numeric, atol=1e-8)


def test_covariance_of_encoders_by_sampling() -> None:
    rng = np.random.default_rng(5)
    model = WheelEncoders(0.4, slip_per_metre=0.05, across_per_metre=0.0)
    left, right = 0.9, 1.3
    noise = rng.standard_normal((40_000, 2)) * 0.05 * np.sqrt([left, right])
    samples = model.motion(left + noise[:, 0], right + noise[:, 1]).increment
    error = se2.local(model.motion(left, right).increment, samples)
    expected = model.motion(left, right).covariance[0]
    np.testing.assert_allclose(np.cov(error.T), expected, atol=0.05 * expected.max())


def test_components_add_up_and_scale_with_the_square() -> None:
    duration, speed, turn = (np.array([x]) for x in (0.1, 0.4, -0.3))
    noise, twice = VelocityNoise(), VelocityNoise(*[2.0 * x for x in vars(VelocityNoise()).values()])
    np.testing.assert_allclose(4.0 * noise.covariance(duration, speed, turn), twice.covariance(duration, speed, turn))
    half = noise.covariance(duration / 2, speed, turn)
    np.testing.assert_allclose(2.0 * half, noise.covariance(duration, speed, turn))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: velocity_motion(-1.0, 1.0, 0.0), "negative"),
        (lambda: velocity_motion(1.0, [1.0, np.nan], 0.0), "speed 1 is not finite"),
        (lambda: velocity_motion([1.0, 2.0], [1.0, 2.0, 3.0], 0.0), "equal length"),
        (lambda: WheelEncoders(0.0).motion(1.0, 1.0), "track"),
        (lambda: Ackermann(2.0).motion(1.0, 1.0, 1.6), "below pi / 2"),
    ],
)
def test_bad_input_is_named(call: Callable[[], MotionStep], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()
