"""Things that move: left out of matching, of keyframes, and of what these are refined against."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.geometry import se2
from clew.motion import Odometry
from clew.scan import LaserScan, extract_points
from clew.sim import LaserModel, OdometryModel, SimulatedLog, drive, hall, simulate, tour
from clew.slam import Slam
from slam.drives import mapped

LASER = LaserModel(beams=181, resolution=0.001)


@cache
def crowd() -> tuple[SimulatedLog, Slam]:
    """A minute in a hall with sixty people, not refined."""
    world = hall(4, width=24.0, depth=18.0, pillars=8)
    log = simulate(world, drive(tour(world, 4, 70.0), rate=4.0, duration=60.0), LASER, OdometryModel.medium(), 4,
                   people=60)
    return log, mapped(log)


def test_people_are_left_out_of_refinement_and_the_building_stays() -> None:
    log, slam = crowd()
    scans = np.searchsorted(log.timestamps, slam.keyframes.timestamps)
    moving, returned = log.moving[scans], np.isfinite(log.ranges[scans])
    whole = np.array([len(extract_points(log.scan(int(row)), slam.config.cleaning)) for row in scans])
    numbers = slam.keyframe_numbers
    clouds = slam._keyframes.clouds(numbers)
    left = slam._scans.still_returns(numbers, clouds, slam.keyframes.T_world_robot, slam.config.cleaning)
    still = np.array([len(points) for points in left])
    assert moving.sum() > 0.05 * returned.sum()
    left_out = whole - still
    assert np.all(left_out >= 0)
    assert abs(left_out.sum() - moving.sum()) < 0.3 * moving.sum()
    crowded = moving.sum(axis=1) > 0.2 * returned.sum(axis=1)
    assert left_out[crowded].min() > 0.1 * whole[crowded].min()
    calm = ~moving.any(axis=1)
    assert left_out[calm].sum() <= 0.005 * whole[calm].sum()


def test_keyframes_are_left_without_people_while_driving() -> None:
    log, slam = crowd()
    moving = still = moving_left = still_left = 0
    rows = np.searchsorted(log.timestamps, slam.keyframes.timestamps)
    for number, row in zip(slam.keyframe_numbers, rows, strict=True):
        scan = log.scan(int(row))
        returned = scan.ranges <= scan.range_max
        directions = np.stack([np.cos(scan.angles), np.sin(scan.angles)], axis=1)[returned]
        ends = se2.act(scan.T_robot_sensor, scan.ranges[returned, None] * directions)

        def left(points: NDArray[np.float64], ends: NDArray[np.float64] = ends) -> NDArray[np.bool_]:
            return np.asarray(cKDTree(points).query(ends)[0] < 1e-6)

        usable = left(extract_points(scan, slam.config.cleaning).points)  # isolated returns are left out anyway
        kept, moved = left(slam._keyframes[int(number)].points.points), log.moving[row][returned]
        moving, still = moving + np.sum(usable & moved), still + np.sum(usable & ~moved)
        moving_left, still_left = moving_left + np.sum(kept & moved), still_left + np.sum(kept & ~moved)
    assert moving > 3000
    assert moving_left < 0.4 * moving
    assert still_left > 0.998 * still


def beside(robot: float, person: float, seconds: float) -> LaserScan:
    """What a robot sees in the middle of an endless corridor 2.4 m wide, with a person ahead of it."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, 181) + 1e-9
    ranges = 1.2 / np.abs(np.sin(angles))
    along = (person - robot) * np.cos(angles) + 0.4 * np.sin(angles)
    inside = 0.04 - ((person - robot) ** 2 + 0.16 - along**2)
    hit = (inside > 0.0) & (along > 0.0)
    ranges = np.where(hit, np.minimum(ranges, along - np.sqrt(np.maximum(inside, 0.0))), ranges)
    ranges += np.random.default_rng(round(10.0 * seconds)).normal(0.0, 0.005, 181)
    return LaserScan(seconds, np.where(ranges < 20.0, ranges, np.inf), float(angles[0]), np.pi / 180, 0.1, 25.0)


def test_who_walks_beside_the_robot_does_not_hold_it_back() -> None:
    """Along a bare corridor the person is all that tells of motion: none, at the speed of the robot."""
    slam = Slam()
    for step in range(50):  # the robot sets out, and then drives as fast as the person walks
        seconds = 0.2 * step
        x = 0.2 * seconds**2 if seconds < 2.5 else seconds - 1.25
        slam.add_odometry(Odometry(seconds, np.array([x, 0.0, 0.0])))
        slam.add_scan(beside(x, seconds + 1.0, seconds))
    assert abs(slam.pose.array[0] - x) < 0.3


def test_scans_full_of_people_tell_less() -> None:
    """Returns that contradict what was seen before, and those that are left with them, are worth less."""
    slam = Slam()
    numbers = []
    for person in (1e3, 3.0):
        slam = Slam()
        for step in range(12):
            x = 0.2 * step
            slam.add_odometry(Odometry(x, np.array([x, 0.0, 0.0])))
            slam.add_scan(beside(x, person if step == 11 else 1e3, x))
        numbers.append(slam._tracker._covariance[1, 1])
    assert numbers[1] > 1.15 * numbers[0]  # alike if nothing but their number counted


def cast(walls: NDArray[np.float64], pose: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ranges to the nearest of walls ``(W, 4)``, from one point to another."""
    rays = np.stack([np.cos(pose[2] + angles), np.sin(pose[2] + angles)], axis=1)
    begin, along = walls[:, :2] - pose[:2], walls[:, 2:] - walls[:, :2]
    across = rays[:, None, 0] * along[None, :, 1] - rays[:, None, 1] * along[None, :, 0] + 1e-12  # none is parallel
    distance = (begin[:, 0] * along[:, 1] - begin[:, 1] * along[:, 0]) / across
    share = (begin[:, 0] * rays[:, None, 1] - begin[:, 1] * rays[:, None, 0]) / across
    return np.where((distance > 0.0) & (share >= 0.0) & (share <= 1.0), distance, np.inf).min(axis=1)


def test_where_everything_that_is_seen_contradicts_the_map_the_run_goes_on() -> None:
    street = np.array([[-10.0, 3, 10, 3], [-10, -3, 10, -3], [10, -3, 10, 3]])
    elsewhere = np.array([[7.0, -0.6, 7, 0.6], [-10, 9, 10, 9], [-10, -9, 10, -9]])  # a screen ahead, no walls near
    angles = np.linspace(-np.pi / 2, np.pi / 2, 361)
    slam, noise = Slam(), np.random.default_rng(0)
    for k in range(80):
        pose = np.array([0.1 * min(k, 60), 0.0, 0.05 * max(k - 59, 0)])
        slam.add(Odometry(0.1 * k, pose))
        ranges = cast(street if k < 60 else elsewhere, pose, angles) + noise.normal(0.0, 0.01, 361)
        slam.add(LaserScan(0.1 * k, ranges, angles[0], angles[1] - angles[0], 0.05, 30.0, np.zeros(3)))
    assert np.allclose(slam.trajectory.T_world_robot[-1], [6.0, 0.0, 1.0], atol=0.3)
