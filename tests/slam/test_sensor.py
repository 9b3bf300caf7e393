"""Sensors that are learnt from the log: noise, broken odometry, sweeps, honest covariances."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.evaluate import absolute_trajectory_error
from clew.geometry import se2
from clew.motion import Odometry
from clew.scan import LaserScan, extract_points, without_normal_noise
from clew.sim import (
    LaserModel,
    OdometryModel,
    SimulatedLog,
    Slips,
    disturbed,
    drive,
    hall,
    long_corridor,
    office_building,
    simulate,
    simulate_kind,
    tour,
)
from clew.slam import Slam

Array = NDArray[np.float64]

BARE = long_corridor(1, features=0, length=100.0)
SPINNING = LaserModel(450, np.radians(359.2), range_min=0.02, range_max=12.0, sweep=0.1)


def drive_in(kind: str, laser: LaserModel, rate: float = 5.0, seconds: float = 60.0) -> SimulatedLog:
    world = {"hall": hall, "office": office_building}[kind](1) if kind != "corridor" else BARE
    return simulate(world, drive(tour(world, 1, 2 * seconds), rate=rate, duration=seconds), laser,
                    OdometryModel.medium(), 1)


def mapped(stream: Iterable[LaserScan | Odometry], *, use_odometry: bool = True) -> Slam:
    slam = Slam(use_odometry=use_odometry)
    for measurement in stream:
        slam.add(measurement)
    return slam


def error(log: SimulatedLog, slam: Slam) -> float:
    run = slam.trajectory
    found = absolute_trajectory_error(log.timestamps, log.T_world_robot, run.timestamps, run.T_world_robot)
    return float(found.translation.rmse)


def steps(log: SimulatedLog, slam: Slam) -> tuple[np.ndarray, np.ndarray]:
    """Errors ``(m, 3)`` and information of the steps between keyframes."""
    edges = next(block for block in slam.graph.blocks() if block.role.name == "ODOMETRY")
    truth = log.T_world_robot[np.searchsorted(log.timestamps, slam.keyframes.timestamps)]
    first, second = edges.keys.T
    measured = np.asarray(edges.measurement).reshape(-1, 3)
    return se2.between(se2.between(truth[first], truth[second]), measured), edges.information


@pytest.mark.parametrize("sigma", [0.005, 0.01, 0.03])
def test_covariances_are_those_of_the_errors_at_any_noise(sigma: float) -> None:
    log = drive_in("hall", LaserModel(181, sigma_range=sigma, resolution=0.001))
    slam = mapped(log.measurements())
    laser = slam.sensor["laser"]
    assert isinstance(laser, dict)
    assert laser["range_noise_m"] == pytest.approx(sigma, rel=0.1)
    errors, information = steps(log, slam)
    squared = np.einsum("mi,mij,mj->m", errors, information, errors)
    assert 0.65 < squared.mean() / 3 < 1.4
    assert np.mean(squared <= 7.815) > 0.88


def rough(log: SimulatedLog, deviation: float) -> Iterable[LaserScan | Odometry]:
    """Three beams next to each other err together, as on stucco or between shelves."""
    rng = np.random.default_rng(5)
    for m in log.measurements():
        if isinstance(m, LaserScan):
            together = np.repeat(deviation * rng.standard_normal(len(m.ranges) // 3 + 1), 3)
            m = replace(m, ranges=m.ranges + together[: len(m.ranges)])
        yield m


def test_returns_that_err_together_tell_less() -> None:
    log = drive_in("office", LaserModel(361, sigma_range=0.004, resolution=0.001))
    slam = mapped(rough(log, 0.015))
    laser = slam.sensor["laser"]
    assert isinstance(laser, dict)
    assert laser["residual_correlation"] > 1.4
    errors, information = steps(log, slam)
    squared = np.einsum("mi,mij,mj->m", errors, information, errors)
    assert 0.5 < squared.mean() / 3 < 1.9  # 2.5 where they are taken to err by themselves


def test_noise_of_normals_does_not_lead_along_a_bare_corridor() -> None:
    """Where returns tell nothing the pose is that of the odometry, not where their noise has it."""
    world = long_corridor(1, features=3, length=100.0)
    way = drive(tour(world, 1, 120.0), rate=5.0, duration=100.0)
    log = simulate(world, way, LaserModel(), OdometryModel.medium(), 1)
    slam = mapped(log.measurements())
    rows = np.searchsorted(log.timestamps, slam.keyframes.timestamps)
    truth = se2.between(log.T_world_robot[rows[:-1]], log.T_world_robot[rows[1:]])
    reckoned = se2.between(log.T_odom_robot[rows[:-1]], log.T_odom_robot[rows[1:]])
    by_odometry, errors = se2.between(truth, reckoned), steps(log, slam)[0]
    assert np.sqrt(np.mean(errors[:, 0] ** 2)) < 1.2 * np.sqrt(np.mean(by_odometry[:, 0] ** 2))
    assert np.sqrt(np.mean(errors[:, 1] ** 2)) < 0.5 * np.sqrt(np.mean(by_odometry[:, 1] ** 2))


def test_a_bare_corridor_does_not_tell_how_far_along_the_robot_is() -> None:
    log = drive_in("corridor", LaserModel(361, sigma_range=0.01, range_max=8.0))
    errors, information = steps(log, mapped(log.measurements()))
    covariance = np.linalg.inv(information)
    along, across = np.sqrt(covariance[:, 0, 0]), np.sqrt(covariance[:, 1, 1])
    assert np.median(along) > 3 * np.median(across)
    assert np.mean(errors[:, 0] ** 2 / covariance[:, 0, 0]) < 1.5


def test_a_match_that_corrects_many_steps_at_once_is_known_to_be_uncertain() -> None:
    """Three cabinets in 100 m: between them the keyframes drift in the map, and each corrects all of it in one step."""
    world = long_corridor(1, features=3, length=100.0)
    log = simulate(world, drive(tour(world, 1, 180.0), rate=5.0, duration=150.0),
                   LaserModel(361, sigma_range=0.005, range_max=80.0, resolution=0.001), OdometryModel.medium(), 1)
    errors, information = steps(log, mapped(log.measurements()))
    squared = np.einsum("mi,mij,mj->m", errors, information, errors)
    assert squared.mean() / 3 < 2.0
    assert np.mean(errors[:, 0] ** 2 / np.linalg.inv(information)[:, 0, 0]) < 4.0


def test_noise_of_normals_is_taken_out_of_the_weak_direction_alone() -> None:
    lines = np.diag([2.0, 100.0, 50.0])
    clean = without_normal_noise(lines[None], 0.01)[0]
    np.testing.assert_allclose(np.diag(clean), [1.0, 99.98, 50.0], rtol=1e-6)
    assert without_normal_noise(np.diag([0.5, 100.0, 50.0]), 0.01)[0, 0] < 1e-4
    assert not without_normal_noise(np.zeros((3, 3)), 0.01).any()


def test_a_round_pillar_does_not_tell_from_which_side_it_is_seen() -> None:
    """Noise of its normals seems to; with the spread of its returns that is known and taken out, a wall stays."""
    angles = np.radians(np.linspace(120.0, 240.0, 60))
    points = np.array([3.5, 0.4]) + 0.3 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    noisy = angles + np.random.default_rng(0).normal(0.0, 0.1, len(angles))

    def information(normals: Array) -> Array:
        row = np.column_stack([normals, points[:, 0] * normals[:, 1] - points[:, 1] * normals[:, 0]])
        return 1e4 * row.T @ row

    x, y = points.T
    moments = np.array([x.mean(), y.mean(), (x**2 + y**2).mean()])
    true = information(np.stack([np.cos(angles), np.sin(angles)], axis=1))
    seeming = information(np.stack([np.cos(noisy), np.sin(noisy)], axis=1))
    about = np.array([0.4, -3.5, 1.0])  # the turn about its middle, which moves the robot sideways
    assert about @ true @ about < 1e-6 * np.trace(true)
    assert about @ seeming @ about > 1.0
    clean = without_normal_noise(seeming, 0.1**2, moments)
    assert about @ clean @ about < 0.3 * about @ seeming @ about
    np.testing.assert_allclose(clean[:2, :2], seeming[:2, :2], rtol=0.1)
    np.testing.assert_allclose(without_normal_noise(seeming, 0.0, moments), seeming, rtol=1e-6)


def frozen(log: SimulatedLog) -> Iterable[LaserScan | Odometry]:
    return (Odometry(m.timestamp, np.zeros(3)) if isinstance(m, Odometry) else m for m in log.measurements())


def senseless(log: SimulatedLog) -> Iterable[LaserScan | Odometry]:
    rng = np.random.default_rng(2)
    for m in log.measurements():
        yield Odometry(m.timestamp, rng.standard_normal(3)) if isinstance(m, Odometry) else m


def worse(log: SimulatedLog) -> Iterable[LaserScan | Odometry]:
    noise = OdometryModel(sigma_distance=0.1, sigma_side=0.03, sigma_turn=0.06, sigma_drift=0.02)
    return disturbed(log, noise, 1, Slips())


@pytest.mark.parametrize("broken", [frozen, senseless, worse])
def test_broken_odometry_does_not_break_the_map(broken: object) -> None:
    assert callable(broken)
    log = drive_in("hall", LaserModel(181), seconds=40.0)
    slam = mapped(broken(log))
    assert error(log, slam) < 0.02
    plain = mapped(log.measurements())
    before, after = (s.sensor["odometry"] for s in (plain, slam))
    assert isinstance(before, dict)
    assert isinstance(after, dict)
    assert after["noise_per_sqrt_metre"]["forward"] > 2 * before["noise_per_sqrt_metre"]["forward"]
    assert before["matches_without_it"] == 0


def test_a_sweep_whose_time_is_told_does_no_harm() -> None:
    log = drive_in("hall", SPINNING, rate=10.0, seconds=20.0)
    told = error(log, mapped(log.measurements()))
    untold = error(log, mapped(
        replace(m, time_increment=0.0) if isinstance(m, LaserScan) else m for m in log.measurements()))
    assert told < 0.02
    assert untold > 2 * told


def test_a_sweep_is_taken_out_without_odometry_too() -> None:
    """A velocity taken from one match for the next would swing up from scan to scan."""
    log = drive_in("office", SPINNING, rate=10.0, seconds=12.0)
    scans = [m for m in log.measurements() if isinstance(m, LaserScan)]
    slam = mapped(scans, use_odometry=False)
    assert error(log, slam) < 0.02
    moved = np.diff(slam.trajectory.T_world_robot[:, :2], axis=0)
    assert np.hypot(*moved.T).max() < 1.2 * np.hypot(*np.diff(log.T_world_robot[:, :2], axis=0).T).max()


def untold(log: SimulatedLog) -> Iterable[LaserScan | Odometry]:
    return (replace(m, time_increment=0.0, moments=None) if isinstance(m, LaserScan) else m
            for m in log.measurements())


def test_a_laser_that_takes_two_turns_for_a_scan_is_found_out_and_reported() -> None:
    laser = LaserModel(361, sigma_range=0.005, resolution=0.001, sweep=1 / 150, interlace=1 / 75)
    log = drive_in("office", laser, seconds=70.0)
    slam = mapped(untold(log))
    early = slam._sensor.beam_times  # known while the robot drives
    assert early.interlace == pytest.approx(1 / 75, rel=0.1)
    slam.refine()
    told = slam.sensor["laser"]
    assert isinstance(told, dict)
    assert told["sweep_known_from"] == "scans"
    assert told["interlace_seconds"] == pytest.approx(1 / 75, rel=0.1)
    assert 0.0 <= told["sweep_seconds"] < 0.012
    raw = [slam._scans.of_keyframes(slam.keyframe_numbers)[k].scan for k in (0, 5)]
    assert all(np.array_equal(scan.moments, slam._sensor.beam_times.moments(361)) for scan in raw)


def test_a_slow_sweep_that_is_not_told_is_found() -> None:
    log = drive_in("office", SPINNING, rate=10.0, seconds=40.0)
    slam = mapped(untold(log))
    assert slam._sensor.beam_times.sweep == pytest.approx(SPINNING.sweep, rel=0.15)
    bent = slam._closer._places.submap(0)
    slam.refine()
    assert slam._sensor.beam_times.sweep == pytest.approx(SPINNING.sweep, rel=0.1)
    # What is drawn, and what scans to come are matched against, is as the map has it.
    kept = slam._scans.of_keyframes(slam.keyframe_numbers)
    anew = [extract_points(scan.still, slam.config.cleaning) for scan in kept]
    apart = [cKDTree(cloud.points).query(points)[0] for cloud, points in zip(anew, slam.keyframe_points, strict=True)]
    assert max(np.quantile(distances, 0.95) for distances in apart) < 0.005
    assert slam._closer._places.submap(0) is not bent


def test_what_the_log_tells_is_not_looked_for() -> None:
    log = drive_in("office", SPINNING, rate=10.0, seconds=12.0)
    slam = mapped(log.measurements())
    slam.refine()
    laser = slam.sensor["laser"]
    assert isinstance(laser, dict)
    assert laser["sweep_known_from"] == "log"
    assert laser["sweep_seconds"] == pytest.approx(SPINNING.sweep, rel=0.01)
    assert not slam._sensor.beam_times


def test_scans_of_one_moment_stay_as_they_are() -> None:
    log = drive_in("office", LaserModel(181), seconds=60.0)
    slam = mapped(log.measurements())
    slam.refine()
    assert not slam._sensor.beam_times
    laser = slam.sensor["laser"]
    assert isinstance(laser, dict)
    assert laser["sweep_known_from"] is None
    assert all(not kept.scan.is_sweep for kept in slam._scans.of_keyframes(slam.keyframe_numbers))


def test_scans_of_one_moment_stay_as_they_are_where_odometry_misleads() -> None:
    odometry = OdometryModel(0.06, 0.04, 0.006, 0.1, 0.04, 0.08, 0.03)
    laser = LaserModel(181, range_max=25.0)
    log = simulate_kind("campus", 50, duration=170.0, rate=3.0, laser=laser, odometry=odometry)
    assert not mapped(log.measurements())._sensor.beam_times
