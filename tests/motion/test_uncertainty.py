"""Every motion model's covariance against samples of its own noise, within the band that sampling has."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import se2
from clew.motion import (
    Ackermann,
    Gyro,
    OdometryNoise,
    VelocityNoise,
    WheelEncoders,
    increment_motion,
    preintegrate,
    velocity_motion,
)

Array = NDArray[np.float64]
SAMPLES = 20_000


def agrees(errors: Array, expected: Array) -> None:
    """Sample covariance of Gaussian errors ``(n, 3)``: each entry scatters by sqrt((C_ii C_jj + C_ij^2) / n)."""
    found = errors.T @ errors / len(errors)
    diagonal = np.diag(expected)
    scatter = np.sqrt((np.outer(diagonal, diagonal) + expected**2) / len(errors))
    assert (np.abs(found - expected) <= 4.5 * scatter + 1e-3 * np.sqrt(np.outer(diagonal, diagonal))).all()


def encoders(rng: np.random.Generator) -> tuple[Array, Array]:
    model = WheelEncoders(0.4, slip_per_metre=0.02, resolution=0.002, across_per_metre=0.01)
    left, right = 0.9, 1.1
    spread = 0.02 * np.sqrt([left, right])
    travel = np.array([left, right]) + spread * rng.standard_normal((SAMPLES, 2))
    ticks = rng.uniform(0.0, 0.002, (2, SAMPLES, 2))  # where in a tick each reading fell, before and after
    travel += ticks[1] - ticks[0]
    samples = model.motion(*travel.T).increment
    slip = np.zeros((SAMPLES, 3))
    slip[:, 1] = 0.01 * np.sqrt(1.0) * rng.standard_normal(SAMPLES)
    step = model.motion(left, right)
    return se2.local(step.increment, se2.retract(samples, slip)), step.covariance[0]


def ackermann(rng: np.random.Generator) -> tuple[Array, Array]:
    model = Ackermann(2.8, encoder_offset=0.76, speed_noise=0.02, steering_noise=0.01, across_per_metre=0.01)
    duration, speed, steering = 0.5, 3.0, 0.3
    controls = np.array([speed, steering]) + rng.standard_normal((SAMPLES, 2)) * [
        0.02 * np.sqrt(speed / duration), 0.01 / np.sqrt(duration)
    ]  # fmt: skip
    samples = model.motion(duration, *controls.T).increment
    step = model.motion(duration, speed, steering)
    way = np.hypot(*step.increment[0, :2]) / np.sinc(step.increment[0, 2] / (2 * np.pi))  # arc over chord
    slip = np.zeros((SAMPLES, 3))
    slip[:, 1] = 0.01 * np.sqrt(way) * rng.standard_normal(SAMPLES)
    return se2.local(step.increment, se2.retract(samples, slip)), step.covariance[0]


def velocity(rng: np.random.Generator) -> tuple[Array, Array]:
    """Many short readings, each with an error of its own, are as uncertain as one long reading says of its end."""
    noise = VelocityNoise(0.02, 0.01, 0.02, 0.03, 0.001, 0.002)
    count, duration, speed, rate = 40, 0.05, 0.6, 0.0
    steps = velocity_motion(np.full(count, duration), speed, rate, noise)
    end = np.zeros((SAMPLES, 3))
    for k in range(count):
        error = rng.standard_normal((SAMPLES, 3)) * np.sqrt(np.diag(steps.covariance[k]))
        end = se2.compose(end, se2.retract(steps.increment[k], error))
    whole = preintegrate(steps.increment, np.array([0]))
    return se2.local(whole.motion[0], end), whole.covariance(steps.covariance)[0]


def increments(rng: np.random.Generator) -> tuple[Array, Array]:
    noise = OdometryNoise(0.02, 0.01, 0.02, 0.03, 0.002, 0.001)
    step = increment_motion(np.array([[1.0, -2.0, 0.5], [1.4, -1.7, 0.9]]), noise)
    way, turn = np.hypot(0.4, 0.3), 0.4
    along = np.sqrt(0.02**2 * way + 0.01**2 * turn + 0.002**2)
    rotation = np.sqrt(0.02**2 * way + 0.03**2 * turn + 0.001**2)
    return rng.standard_normal((SAMPLES, 3)) * [along, along, rotation], step.covariance[0]


def gyro(rng: np.random.Generator) -> tuple[Array, Array]:
    sensor = Gyro(0.01, VelocityNoise(0.02, 0.01, 0.5, 0.5, 0.001, 0.5))
    stamps, speed = 0.02 * np.arange(50), 0.8
    rates = 0.5 * np.sin(3.0 * stamps)
    known = sensor.motion(stamps, rates, [0.0], [speed], [0.0, 1.0])
    steps = velocity_motion(np.full(50, 0.02), speed, rates, sensor.wheels)
    deviations = np.sqrt(np.einsum("nii->ni", steps.covariance))
    deviations[:, 2] = 0.01 * np.sqrt(0.02)  # the gyro's, whatever the wheels would say of turns
    end = np.zeros((SAMPLES, 3))
    for k in range(50):
        error = rng.standard_normal((SAMPLES, 3)) * deviations[k]
        end = se2.compose(end, se2.retract(steps.increment[k], error))
    return se2.local(known.motion[0], end), known.covariance[0]


@pytest.mark.parametrize("model", [encoders, ackermann, velocity, increments, gyro], ids=lambda m: m.__name__)
def test_covariances_are_those_of_samples(model: Callable[[np.random.Generator], tuple[Array, Array]]) -> None:
    agrees(*model(np.random.default_rng(8)))


@settings(max_examples=60, deadline=None)
@given(st.floats(-2.0, 2.0), st.floats(-4.0, 4.0), st.floats(0.0, 1.5))
def test_an_arc_is_the_limit_of_many_short_drives(speed: float, rate: float, duration: float) -> None:
    """Whatever the turn rate, zero included: midpoint steps of an independent integrator come to the same pose."""
    count = 2000
    middle = rate * duration * (np.arange(count) + 0.5) / count
    step = speed * duration / count
    expected = [step * np.cos(middle).sum(), step * np.sin(middle).sum()]
    found = velocity_motion(duration, speed, rate).increment[0]
    np.testing.assert_allclose(found[:2], expected, atol=1e-5)
    np.testing.assert_allclose(np.exp(1j * found[2]), np.exp(1j * rate * duration), atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-9.0, 0.0))
def test_jacobians_are_continuous_where_the_turn_vanishes(speed: float, exponent: float) -> None:
    near, straight = (velocity_motion(1.0, speed, rate) for rate in (10.0**exponent * 1e-2, 0.0))
    gap = 10.0**exponent * 1e-2
    assert np.abs(near.by_control - straight.by_control).max() <= 2.0 * gap + 1e-8
    assert np.abs(near.increment - straight.increment).max() <= 2.0 * gap


def test_increments_are_what_the_odometry_moved_and_their_jacobian() -> None:
    rng = np.random.default_rng(9)
    poses = se2.canonical(rng.uniform(-3.0, 3.0, (20, 3)))
    step = increment_motion(poses)
    np.testing.assert_allclose(step.predict(poses[:-1])[:, :2], poses[1:, :2], atol=1e-12)
    h = 1e-6
    for column in range(3):
        up, down = (step.increment + sign * h * np.eye(3)[column] for sign in (1.0, -1.0))
        numeric = (se2.local(step.increment, up) - se2.local(step.increment, down)) / (2 * h)
        np.testing.assert_allclose(step.by_control[:, :, column], numeric, atol=1e-8)


def test_a_gyro_at_its_bias_tells_the_true_motion_and_the_derivative_by_bias_and_scale() -> None:
    stamps = 0.01 * np.arange(300)
    true, bias, scale = 0.6 * np.cos(2.0 * stamps), 0.03, 0.02
    measured = (1.0 + scale) * true + bias
    speed_stamps, speeds = [0.0, 1.005, 2.0], [0.5, 0.8, 0.2]
    frames = [0.0, 1.0, 2.5]
    sensor = Gyro()
    right = sensor.motion(stamps, true, speed_stamps, speeds, frames)
    found = sensor.motion(stamps, measured, speed_stamps, speeds, frames, bias=bias, scale=scale)
    np.testing.assert_allclose(found.motion, right.motion, atol=1e-12)
    h = 1e-6
    for column, delta in enumerate(np.eye(2) * h):
        up, down = (
            sensor.motion(stamps, measured, speed_stamps, speeds, frames, bias=bias + s * delta[0],
                          scale=scale + s * delta[1]).motion for s in (1.0, -1.0)
        )  # fmt: skip
        numeric = (se2.local(found.motion, up) - se2.local(found.motion, down)) / (2 * h)
        np.testing.assert_allclose(found.by_parameter[:, :, column], numeric, atol=1e-7)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Gyro().motion([0.1, 0.2], [0.0, 0.0], [0.0], [1.0], [0.0, 1.0]), "no rate at the first keyframe"),
        (lambda: Gyro().motion([0.0, 0.2], [0.0, 0.0], [], [], [0.0, 1.0]), "no speed at the first keyframe"),
        (lambda: Gyro().motion([0.2, 0.0], [0.0, 0.0], [0.0], [1.0], [0.3, 1.0]), "in order"),
        (lambda: Gyro().motion([0.0], [np.nan], [0.0], [1.0], [0.0, 1.0]), "rate 0 is not finite"),
        (lambda: Gyro().motion([0.0], [0.1], [0.0], [1.0], [0.0, 1.0], scale=-1.0), "scale above -1"),
        (lambda: Gyro().motion([0.0], [0.1], [0.0], [1.0], [0.0, 1.0], bias=np.nan), "bias nan"),
        (lambda: increment_motion(np.zeros((1, 3))), "at least two poses"),
        (lambda: increment_motion([[0.0, 0.0, 0.0], [np.inf, 0.0, 0.0]]), "pose 1 is not finite"),
        (lambda: Ackermann(2.8, encoder_offset=0.76).motion(1.0, 1.0, [0.1, 1.4]), "steering 1"),
    ],
)
def test_bad_input_is_named(call: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()
