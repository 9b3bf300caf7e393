"""Pairs of revisits, errors against measured pairs, and the spread of returns, on cases worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate import pair_errors, revisiting_pairs, wall_spread
from clew.geometry import se2, wrap

Array = NDArray[np.float64]


def laps(count: int = 3, shift: float = 0.05) -> tuple[Array, Array]:
    """Times and poses of laps on a circle of 20 m, each lap a little further out; 0.1 m from pose to pose."""
    angle = 2.0 * np.pi * np.arange(200 * count) / 200
    radius = 10.0 / np.pi + shift * np.floor(np.arange(200 * count) / 200)
    poses = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), wrap(angle + np.pi / 2)])
    return np.arange(200.0 * count), poses


def test_pairs_join_visits_and_never_one_visit() -> None:
    times, poses = laps()
    pairs = revisiting_pairs(times, poses, max_distance=0.3, min_travelled=10.0)
    assert len(pairs) > 500
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert ((pairs[:, 1] - pairs[:, 0]) > 90).all()
    first, second = poses[pairs[:, 0]], poses[pairs[:, 1]]
    assert np.hypot(*(first - second)[:, :2].T).max() <= 0.3
    third_lap = pairs[pairs[:, 1] > 420]
    assert {0, 1} == set((third_lap[:, 0] // 200).tolist())  # both earlier laps
    assert np.unique(pairs, axis=0).shape == pairs.shape


def test_a_robot_that_stands_still_or_turns_its_back_makes_no_pairs() -> None:
    times, poses = laps(2, 0.0)
    still = np.concatenate([poses[:200], np.repeat(poses[:1], 200, axis=0)])
    assert len(revisiting_pairs(times, still)) <= 12
    poses[200:, 2] += np.pi
    lap = revisiting_pairs(times, poses, max_distance=0.3) // 200
    assert (lap[:, 0] == lap[:, 1]).all()  # where a lap closes, and none between laps


def test_no_more_pairs_than_the_limit_spread_over_the_drive() -> None:
    times, poses = laps()
    every, some = revisiting_pairs(times, poses), revisiting_pairs(times, poses, limit=50)
    assert len(some) == 50
    assert {tuple(row) for row in some.tolist()} <= {tuple(row) for row in every.tolist()}
    assert np.ptp(some[:, 1]) > 0.9 * np.ptp(every[:, 1])


def test_errors_of_pairs_are_those_put_in() -> None:
    _, poses = laps(2)
    pairs = np.stack([np.arange(100), 200 + np.arange(100)], axis=1)
    truth = se2.between(poses[pairs[:, 0]], poses[pairs[:, 1]])
    measured = se2.compose(truth, np.array([0.03, -0.04, 0.02]))
    known = np.arange(100) % 4 != 0
    measured[~known] = 99.0
    errors = pair_errors(poses, pairs, measured, known)
    assert (errors.used, errors.unused) == (75, 25)
    assert errors.translation.mean == pytest.approx(0.05)
    assert errors.rotation.max == pytest.approx(0.02)
    assert errors.to_dict()["rotation_deg"]["mean"] == pytest.approx(np.degrees(0.02))  # type: ignore[index]  # a dict


def test_pairs_that_do_not_fit_are_refused() -> None:
    times, poses = laps(1)
    with pytest.raises(InputError, match="increase"):
        revisiting_pairs(times[::-1], poses)
    with pytest.raises(InputError, match="one pose and one flag"):
        pair_errors(poses, np.zeros((2, 2), np.int64), np.zeros((2, 3)), np.ones(3, np.bool_))


def wall(count: int, scans: int, rng: np.random.Generator, shift: float = 0.0) -> tuple[Array, Array, Array]:
    """Returns of a wall along a slanted line, each scan with its own error, and single ones with none."""
    along = rng.uniform(0.0, 5.0, count)
    scan = rng.integers(0, scans, count)
    across = shift * rng.standard_normal(scans)[scan]
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    return np.stack([along, across], axis=1) @ turn, np.tile([-0.6, 0.8], (count, 1)), scan


def test_spread_is_the_error_of_scans() -> None:
    for shift in (0.004, 0.02):
        points, normals, scans = wall(8000, 400, np.random.default_rng(1), shift)
        spread = wall_spread(points, normals, scans)
        assert spread.used > 7500  # where scans err much, the ends of the wall look like clutter
        assert spread.rms == pytest.approx(shift, rel=0.1)
        assert spread.median == pytest.approx(0.6745 * shift, rel=0.1)  # of a normal distribution


def test_own_scan_and_other_side_of_a_thin_wall_make_no_wall() -> None:
    points, normals, scans = wall(1500, 2, np.random.default_rng(1))
    points = points + np.where(scans == 0, 0.0, 0.05)[:, None] * normals  # of two walls, each seen by one scan
    assert wall_spread(points, normals, np.zeros_like(scans)).used == 0
    facing = np.where((scans == 0)[:, None], -normals, normals)
    assert wall_spread(points, facing, scans).used == 0
    thin = np.concatenate([points, points + 1e-4]), np.concatenate([facing, facing]), np.concatenate([scans, scans + 2])
    again = np.concatenate([points, points + 1e-4, points + 2e-4])
    three = wall_spread(again, np.concatenate([facing] * 3), np.concatenate([scans, scans + 2, scans + 4]))
    assert wall_spread(*thin).used == 0  # one other scan is no wall
    assert three.used > 4000
    assert three.rms < 0.001  # not the 5 cm to the other side


def test_clutter_has_no_wall() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, 2.0, (4000, 2))
    spread = wall_spread(points, np.tile([1.0, 0.0], (4000, 1)), rng.integers(0, 50, 4000))
    assert spread.used < 40
    assert spread.used + spread.unused == 4000


def test_no_returns_no_spread() -> None:
    spread = wall_spread(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0, np.int64))
    assert spread.used == 0
    assert spread.to_dict()["median_m"] is None
    with pytest.raises(InputError, match="finite"):
        wall_spread(np.full((1, 2), np.nan), np.ones((1, 2)), np.zeros(1, np.int64))
