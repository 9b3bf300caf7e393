"""Odometry at any moment."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.geometry import se2
from clew.motion import Odometry, OdometryBuffer
from clew.motion.buffer import EXTRAPOLATION_LIMIT, HISTORY

Array = NDArray[np.float64]
TWIST = np.array([0.8, 0.1, 0.6])  # constant body velocity, metres and radians a second
START = np.array([2.0, -1.0, 2.9])


def true_pose(time: float) -> Array:
    return se2.compose(START, se2.exp(TWIST * time))


def filled(times: list[float]) -> OdometryBuffer:
    buffer = OdometryBuffer()
    for time in times:
        buffer.add(Odometry(time, true_pose(time)))
    return buffer


def assert_pose(actual: Array | None, expected: Array) -> None:
    assert actual is not None
    np.testing.assert_allclose(se2.between(expected, actual), np.zeros(3), atol=1e-12)


@pytest.mark.parametrize("time", [0.0, 0.1, 0.5, 0.75, 1.99, 2.0, 2.3, 2.5])
def test_constant_velocity_is_met_exactly_between_and_after_readings(time: float) -> None:
    """On an arc that crosses the border of angles at pi."""
    assert_pose(filled([0.0, 0.5, 2.0]).at(time), true_pose(time))


def test_last_velocity_is_trusted_for_a_moment_only() -> None:
    buffer = filled([0.0, 1.0])
    assert_pose(buffer.at(1.0 + EXTRAPOLATION_LIMIT), true_pose(1.0 + EXTRAPOLATION_LIMIT))
    assert_pose(buffer.at(100.0), true_pose(1.0 + EXTRAPOLATION_LIMIT))


def test_nothing_is_known_before_a_reading_and_little_after_one() -> None:
    buffer = OdometryBuffer()
    assert buffer.at(0.0) is None
    buffer.add(Odometry(5.0, START))
    for time in (0.0, 5.0, 6.0):
        assert_pose(buffer.at(time), START)
    assert len(buffer) == 1


def test_before_the_first_reading_its_pose_counts() -> None:
    assert_pose(filled([3.0, 4.0]).at(1.0), true_pose(3.0))


def test_late_readings_are_left_out_and_repeated_ones_replace() -> None:
    buffer = filled([0.0, 1.0])
    buffer.add(Odometry(0.5, np.array([99.0, 0.0, 0.0])))
    assert len(buffer) == 2
    assert_pose(buffer.at(0.5), true_pose(0.5))
    buffer.add(Odometry(1.0, START))
    assert len(buffer) == 2
    assert_pose(buffer.at(1.0), START)


def test_memory_is_bounded_and_keeps_the_latest() -> None:
    buffer = filled([0.01 * k for k in range(HISTORY + 50)])
    assert len(buffer) == HISTORY
    assert_pose(buffer.at(0.01 * (HISTORY + 49)), true_pose(0.01 * (HISTORY + 49)))
    assert_pose(buffer.at(0.0), true_pose(0.5))  # the oldest that is left
