"""Drives keep to their way points and within the limits of the robot."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.sim import DriveModel, drive

Array = NDArray[np.float64]
RATE = 50.0


def speeds(poses: Array) -> tuple[Array, Array]:
    """Speed in m/s and turn rate in rad/s between samples."""
    turns = np.angle(np.exp(1j * np.diff(poses[:, 2])))
    return np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) * RATE, turns * RATE


def test_straight_line_by_hand() -> None:
    """10 m at 1 m/s with 0.5 m/s^2: 2 s up, 8 s along, 2 s down."""
    model = DriveModel(speed=1.0, acceleration=0.5)
    driven = drive(np.array([[0.0, 0.0], [10.0, 0.0]]), rate=RATE, model=model, start_time=100.0)
    assert driven.timestamps[0] == 100.0
    assert driven.timestamps[-1] - 100.0 == pytest.approx(12.0, abs=0.03)
    at = np.interp([1.0, 2.0, 6.0, 10.0], driven.timestamps - 100.0, driven.T_world_robot[:, 0])
    np.testing.assert_allclose(at, [0.25, 1.0, 5.0, 9.0], atol=0.01)
    np.testing.assert_allclose(driven.T_world_robot[:, 1:], 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_limits_are_kept(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = DriveModel()
    poses = drive(rng.uniform(-8, 8, (12, 2)), rate=RATE, model=model).T_world_robot
    speed, turn = speeds(poses)
    assert speed.max() <= model.speed * 1.001
    assert np.abs(turn).max() <= model.turn_rate * 1.05
    assert np.abs(np.diff(speed)).max() * RATE <= model.acceleration * 1.5
    # The robot drives forwards: it looks where it goes.
    moving = speed > 0.1
    going = np.arctan2(*np.diff(poses[:, :2], axis=0)[moving].T[::-1])
    assert np.abs(np.angle(np.exp(1j * (going - poses[:-1][moving, 2])))).max() < 0.15


def test_way_back_turns_on_the_spot_and_returns() -> None:
    poses = drive(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 0.0]]), rate=RATE).T_world_robot
    np.testing.assert_allclose(poses[:, 1], 0.0, atol=1e-9)
    assert poses[:, 0].max() == pytest.approx(4.0, abs=1e-3)
    np.testing.assert_allclose(poses[-1, :2], 0.0, atol=0.02)
    assert abs(poses[-1, 2]) == pytest.approx(np.pi)
    standing = np.abs(poses[:, 0] - 4.0) < 1e-9
    assert standing.sum() > np.pi * RATE  # half a turn at 1 rad/s or less


def test_corners_are_rounded_by_little() -> None:
    poses = drive(np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]]), rate=RATE).T_world_robot
    nearest = np.linalg.norm(poses[:, :2] - [5.0, 0.0], axis=1).min()
    assert 0.05 < nearest < 0.3
    np.testing.assert_allclose(poses[[0, -1], :2], [[0, 0], [5, 5]], atol=0.02)


def test_duration_cuts_the_drive_off() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0]])
    short, whole = drive(line, rate=5.0, duration=4.0), drive(line, rate=5.0)
    assert len(short.timestamps) == 21
    np.testing.assert_array_equal(short.T_world_robot, whole.T_world_robot[:21])


@pytest.mark.parametrize(("points", "rate"), [
    (np.zeros((1, 2)), 5.0), (np.zeros((3, 2)), 5.0), (np.zeros((2, 3)), 5.0),
    (np.array([[0, 0], [np.nan, 1]]), 5.0), (np.array([[0.0, 0.0], [1.0, 0.0]]), 0.0),
])
def test_bad_way_points_are_refused(points: Array, rate: float) -> None:
    with pytest.raises(InputError, match="drive"):
        drive(points, rate=rate)
