"""When the beams of a scan are measured, found from scans of a robot that turns."""

from __future__ import annotations

import sys
import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from clew.motion import body_velocities
from clew.scan import BeamTimes, LaserScan, find_beam_times
from clew.sim import Drive, LaserModel, OdometryModel, SimulatedLog, World, drive, office_building, simulate, tour
from clew.sim.world import box

WORLD = office_building(3)
PERIOD = 0.2
#: A SICK LMS at half a degree: 75 turns a second, each of which sees half of the beams over half of the turn.
INTERLACED = LaserModel(360, np.radians(179.5), resolution=0.001, sweep=1 / 150, interlace=1 / 75)
SWEEPING = replace(INTERLACED, sweep=0.1, interlace=0.0)
AT_ONCE = replace(INTERLACED, sweep=0.0, interlace=0.0)
SLOW = LaserModel(360, np.radians(359.0), resolution=0.001, sweep=0.18)
ROOM = World("room", np.concatenate([box(-12.0, -10.0, 12.0, 10.0), box(4.0, 4.0, 5.0, 5.0), box(-7.0, 3.0, -6.0, 4.0),
                                     box(-3.0, -6.0, -2.0, -5.0), box(7.0, -3.5, 8.0, -3.0)]),
             np.zeros((1, 2)), np.zeros((0, 2), dtype=np.int64))


@cache
def driven(laser: LaserModel) -> SimulatedLog:
    return simulate(WORLD, drive(tour(WORLD, 3, 200.0), rate=1 / PERIOD, duration=150.0), laser,
                    OdometryModel.medium(), 3)


def found(scans: list[LaserScan], log: SimulatedLog, share: float = 1.0) -> BeamTimes:
    moved = body_velocities(log.timestamps, log.T_world_robot)
    return find_beam_times(scans, log.T_world_robot, moved.velocity, moved.steady, PERIOD, share=share)


def recorded(log: SimulatedLog) -> list[LaserScan]:
    """Scans as most logs have them: nothing tells when a beam was measured."""
    return [replace(log.scan(k), time_increment=0.0, moments=None) for k in range(log.scan_count)]


def test_moments_are_about_the_middle() -> None:
    times = BeamTimes(sweep=0.04, interlace=0.01)
    np.testing.assert_allclose(times.moments(5), [-0.025, -0.005, -0.005, 0.015, 0.015], atol=1e-15)
    scan = LaserScan(1.0, np.ones(5), 0.0, 0.1, 0.0, 9.0)
    assert not scan.is_sweep
    assert times.of(scan).span == pytest.approx((-0.025, 0.015))
    assert BeamTimes().of(times.of(scan)).moments is None
    assert BeamTimes().of(scan) is scan
    assert not BeamTimes()
    np.testing.assert_array_equal(BeamTimes(sweep=0.04).moments(1), 0.0)


def test_two_turns_of_a_mirror_are_told_apart_and_timed() -> None:
    log = driven(INTERLACED)
    times = found(recorded(log), log)
    assert times.interlace == pytest.approx(INTERLACED.interlace, rel=0.06)
    assert times.sweep == pytest.approx(INTERLACED.sweep, abs=4 * times.sweep_deviation + 5e-4)
    assert times.sweep_deviation < 0.001


def test_every_second_beam_of_an_interlaced_scan_is_of_one_turn() -> None:
    log = driven(INTERLACED)
    half = [replace(s, ranges=s.ranges[::2], angle_increment=2 * s.angle_increment) for s in recorded(log)]
    times = found(half, log)
    assert times.interlace == 0.0
    assert times.sweep == pytest.approx(INTERLACED.sweep, abs=4 * times.sweep_deviation + 5e-4)


def test_a_mirror_that_turns_the_other_way_has_a_negative_sweep() -> None:
    log = driven(SWEEPING)
    times = found(recorded(log), log, share=0.5)
    assert times.sweep == pytest.approx(0.1, rel=0.1)
    backwards = [replace(s, ranges=s.ranges[::-1], angle_min=-s.angle_min, angle_increment=-s.angle_increment)
                 for s in recorded(log)]
    again = found(backwards, log, share=0.5)
    assert again.sweep == pytest.approx(-times.sweep, rel=0.02)
    assert again.interlace == times.interlace == 0.0


@pytest.mark.parametrize("seconds", [60.0, 180.0])
def test_a_slow_laser_is_found_out_however_much_there_is(seconds: float) -> None:
    """Scans taken in the sharpest turns are too bent to lie on each other; more scans have more of these."""
    t = np.arange(0.0, seconds, SLOW.sweep)
    heading = np.cumsum(SLOW.sweep * (0.9 * np.sin(0.7 * t) + 0.1))
    steps = SLOW.sweep * (0.4 + 0.1 * np.sin(t)) * np.stack([np.cos(heading), np.sin(heading)])
    way = np.cumsum(steps, axis=1)
    log = simulate(ROOM, Drive(t, np.column_stack([*way, heading])), SLOW, OdometryModel.medium(), 3)
    moved = body_velocities(log.timestamps, log.T_world_robot)
    times = find_beam_times(recorded(log), log.T_world_robot, moved.velocity, moved.steady, SLOW.sweep)
    assert times.sweep == pytest.approx(0.18, rel=0.03)


def test_what_does_not_settle_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["clew.scan.find_beam_times"], "ROUNDS", 1)
    log = driven(INTERLACED)
    assert not found(recorded(log), log, share=0.5)


def test_memory_does_not_grow_with_the_square_of_scans_in_one_place() -> None:
    def peak(count: int) -> int:
        rng = np.random.default_rng(1)
        poses, turning = rng.uniform(-1.0, 1.0, (count, 3)), rng.uniform(0.3, 0.6, (count, 3))
        nothing = [LaserScan(0.1 * k, np.full(9, np.inf), 0.0, 0.01, 0.0, 9.0) for k in range(count)]
        tracemalloc.start()
        find_beam_times(nothing, poses, turning, np.ones(count, np.bool_), 0.1)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    assert peak(3000) < 1.5 * peak(1500)


def test_of_scans_that_are_measured_at_once_nothing_is_found() -> None:
    log = driven(AT_ONCE)
    times = found(recorded(log), log)
    assert not times
    assert times.interlace_deviation < 1e-3  # it was looked for
    assert times.sweep_deviation < 1e-3


def test_a_robot_that_stands_tells_nothing() -> None:
    log = driven(AT_ONCE)
    still = np.zeros((log.scan_count, 3))
    times = find_beam_times(recorded(log), log.T_world_robot, still, np.ones(log.scan_count, np.bool_), PERIOD)
    assert times == BeamTimes()


@pytest.mark.parametrize("returns", [0, 4])
def test_scans_without_returns_tell_nothing(returns: int) -> None:
    log = driven(INTERLACED)
    bare = [replace(s, ranges=np.where(np.arange(360) < returns, s.ranges, np.inf)) for s in recorded(log)]
    times = found(bare, log, share=0.5)
    assert not times
    started = find_beam_times(bare, log.T_world_robot, np.ones((log.scan_count, 3)), np.ones(log.scan_count, np.bool_),
                              PERIOD, start=BeamTimes(0.01, 0.01))
    assert not started


def test_what_would_take_longer_than_a_scan_is_not_believed() -> None:
    log = driven(SWEEPING)
    moved = body_velocities(log.timestamps, log.T_world_robot)
    times = find_beam_times(recorded(log), log.T_world_robot, moved.velocity, moved.steady, 0.05, share=0.5)
    assert times.sweep == 0.0
