"""Doors that open and close: geometry, motion, labels."""

from __future__ import annotations

import numpy as np
import pytest

from clew.geometry import se2
from clew.sim import LaserModel, SimulatedLog, cast_rays, simulate_demo, simulate_kind
from clew.sim.doors import OPEN_SHARE, WAY, cover, leaves, swing


@pytest.fixture(scope="module")
def log() -> SimulatedLog:
    return simulate_demo(2, duration=120.0, people=4, doors=True)


def test_a_leaf_swings_a_quarter_of_a_turn() -> None:
    door = np.array([[[1.0, 2.0], [2.0, 2.0], [1.0, 3.0]]])
    segments = leaves(door, np.array([[0.0], [0.5], [1.0]]))[:, 0]
    np.testing.assert_allclose(segments[:, 0], np.tile([1.0, 2.0], (3, 1)))
    half = np.sqrt(0.5)
    np.testing.assert_allclose(segments[:, 1], [[2.0, 2.0], [1.0 + half, 2.0 + half], [1.0, 3.0]], atol=1e-12)


def test_beams_meet_leaves_where_the_ray_caster_says() -> None:
    rng = np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(-3, 3, (20, 2)), rng.uniform(-np.pi, np.pi, 20)])
    segments = rng.uniform(-4, 4, (5, 2, 2))
    angles = np.linspace(-2, 2, 50)
    far = np.full((20, 50), np.inf)
    distances, met = cover(far, poses, angles, np.broadcast_to(segments, (20, 5, 2, 2)))
    np.testing.assert_allclose(distances, cast_rays(segments, poses, angles), atol=1e-9)
    np.testing.assert_array_equal(met, np.isfinite(distances))
    assert 0.1 < met.mean() < 0.9


def test_doors_of_an_office_fill_their_openings_and_move(log: SimulatedLog) -> None:
    doors = log.world.doors
    assert len(doors) == len(log.world.rooms) > 3
    closed, opened = doors[:, 1] - doors[:, 0], doors[:, 2] - doors[:, 0]
    np.testing.assert_allclose(np.linalg.norm(closed, axis=1), 1.0)
    np.testing.assert_allclose(np.sum(closed * opened, axis=1), 0.0, atol=1e-12)
    assert log.door_share.shape == (log.scan_count, len(doors))
    assert ((log.door_share >= 0.0) & (log.door_share <= 1.0)).all()
    assert 0.5 < log.door_share.mean() < 0.95
    assert (np.ptp(log.door_share, axis=0) == 1.0).sum() > len(doors) / 2  # most open and close within two minutes
    assert np.abs(np.diff(log.door_share, axis=0)).max() <= 0.2 / 1.2 + 1e-9  # none jumps


def test_doors_stand_open_as_long_as_they_should_when_nobody_comes(log: SimulatedLog) -> None:
    share = swing(log.world, np.arange(0.0, 4000.0, 0.5), np.full((8000, 1, 2), 1e6), 3)
    assert share.mean() == pytest.approx(OPEN_SHARE, abs=0.05)


def test_doors_are_open_for_the_robot(log: SimulatedLog) -> None:
    middle = log.world.doors[:, :2].mean(axis=1)
    distance = np.linalg.norm(log.T_world_robot[:, None, :2] - middle, axis=2)
    assert (distance < 0.6).any()
    assert (log.door_share[distance < 1.0] > 0.95).all()
    assert (log.door_share[distance > WAY] < 0.05).any()


def test_labelled_returns_lie_on_leaves(log: SimulatedLog) -> None:
    scan, beam = np.nonzero(log.door)
    assert len(scan) > 1000
    assert log.moving[log.door].all()
    T_world_sensor = se2.compose(log.T_world_robot[scan], np.array(log.laser.T_robot_sensor))
    heading = T_world_sensor[:, 2] + log.laser.angles[beam]
    points = T_world_sensor[:, :2] + log.ranges[scan, beam][:, None] * np.stack([np.cos(heading), np.sin(heading)], 1)
    segments = leaves(log.world.doors, log.door_share)[scan]
    along = segments[:, :, 1] - segments[:, :, 0]
    share = np.clip(np.sum((points[:, None] - segments[:, :, 0]) * along, axis=2) / np.sum(along**2, axis=2), 0.0, 1.0)
    gap = np.linalg.norm(points[:, None] - segments[:, :, 0] - share[..., None] * along, axis=2).min(axis=1)
    assert gap.max() < 0.08  # five sigma of a range


def test_without_doors_nothing_changes() -> None:
    plain, with_doors = (simulate_kind("office", 1, duration=20.0, doors=doors) for doors in (False, True))
    assert plain.door_share.shape == (plain.scan_count, 0)
    assert not plain.moving.any()
    elsewhere = ~with_doors.door & np.isfinite(with_doors.ranges)
    np.testing.assert_array_equal(plain.ranges[elsewhere], with_doors.ranges[elsewhere])
    assert not simulate_kind("hall", 1, duration=5.0, doors=True, laser=LaserModel(beams=91)).door.any()
