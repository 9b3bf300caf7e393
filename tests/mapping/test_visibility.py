"""Returns against the rays of other scans: the native look-up against a NumPy twin, and what it says of a person."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew import _native
from clew.geometry import se2
from clew.mapping import Views, contradicted, view_of
from clew.scan import LaserScan

Array = NDArray[np.float64]
SLACK = 0.2


def room(pose: Array, beams: int = 181, person: Array | None = None, increment: float = np.pi / 180) -> LaserScan:
    """What a laser sees in a square room of 8 m about the origin, with a person of 0.2 m radius in it."""
    angles = -0.5 * (beams - 1) * increment + increment * np.arange(beams)
    heading = pose[2] + angles + 1e-9  # along no wall
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    ranges = np.min(np.where(direction > 0, 4.0 - pose[:2], -4.0 - pose[:2]) / direction, axis=1)
    if person is not None:
        to = person - pose[:2]
        along = direction @ to
        inside = 0.04 - (to @ to - along**2)
        hit = (inside > 0) & (along > 0)
        ranges = np.where(hit, np.minimum(ranges, along - np.sqrt(np.maximum(inside, 0.0))), ranges)
    return LaserScan(0.0, ranges, angles[0], increment, 0.1, 30.0)


def twin(views: list[tuple[Array, LaserScan, Array]], points: Array) -> tuple[Array, Array]:
    """Counts from the definition, view by view and point by point."""
    seen, through = np.zeros(len(points), int), np.zeros(len(points), int)
    for pose, scan, clear in views:
        for i, point in enumerate(se2.act(se2.inverse(pose), points)):
            distance = np.hypot(*point)
            middle = scan.angle_min + 0.5 * (len(clear) - 1) * scan.angle_increment
            off = (np.arctan2(point[1], point[0]) - middle + np.pi) % (2 * np.pi) - np.pi
            beam = off / scan.angle_increment + 0.5 * (len(clear) - 1)
            if not 0 <= beam < len(clear) - 1:
                continue
            both = [int(beam), int(beam) + 1]
            if (np.abs(scan.ranges[both] - distance) <= SLACK).any():
                seen[i] += 1
            elif (clear[both] > distance).all():
                through[i] += 1
    return seen, through


@pytest.mark.parametrize("increment", [np.pi / 180, -np.pi / 180, 2 * np.pi / 181])
def test_looks_against_the_twin(increment: float) -> None:
    rng = np.random.default_rng(3)
    poses = np.column_stack([rng.uniform(-3, 3, (6, 2)), rng.uniform(-9, 9, 6)])
    scans = [room(pose, person=rng.uniform(-3, 3, 2), increment=increment) for pose in poses]
    scans[2].ranges[50:60] = np.inf
    scans[3].ranges[50:60] = np.nan
    views = [view_of(scan, pose) for scan, pose in zip(scans, poses, strict=True)]
    points = rng.uniform(-4.3, 4.3, (500, 2))
    frame = np.array([0.3, -0.2, 2.0])
    expected = twin([(p, s, v.clear) for p, s, v in zip(poses, scans, views, strict=True)], points)
    for got in (Views(views).looks_at(points), Views(views).looks_at(se2.act(se2.inverse(frame), points), frame)):
        for counts, wanted in zip(got, expected, strict=True):
            # Directions are good to 2e-5 rad: a point so close to a beam may be counted with the one beyond.
            assert np.mean(counts != wanted) < 0.005
    assert expected[0].sum() > 100
    assert expected[1].sum() > 300


def test_the_sensor_sits_where_it_sits() -> None:
    mounted = np.array([0.5, 0.1, 0.4])
    pose = np.array([1.0, -0.5, 2.0])
    scan = room(se2.compose(pose, mounted))
    on_robot = LaserScan(0.0, scan.ranges, scan.angle_min, scan.angle_increment, 0.1, 30.0, mounted)
    ends = np.stack([scan.ranges * np.cos(scan.angles), scan.ranges * np.sin(scan.angles)], axis=1)[1:-1]
    seen, through = Views([view_of(on_robot, pose)]).looks_at(se2.act(se2.compose(pose, mounted), ends))
    assert seen.all()
    assert not through.any()


def test_who_walked_on_is_contradicted_and_walls_are_not() -> None:
    poses = np.array([[-3.0, 0.0, 0.0], [-2.5, 0.1, 0.1], [-2.0, 0.0, 0.0], [-1.5, 0.0, -0.1]])
    steps = [np.array([0.5 * k, 0.8 * k - 1.0]) for k in range(4)]
    scans = [room(pose, person=where) for pose, where in zip(poses, steps, strict=True)]
    views = [view_of(scan, pose) for scan, pose in zip(scans, poses, strict=True)]
    for k, scan in enumerate(scans):
        points = se2.act(poses[k], scan.ranges[:, None] * np.stack([np.cos(scan.angles), np.sin(scan.angles)], axis=1))
        moved = contradicted(*Views([v for j, v in enumerate(views) if j != k]).looks_at(points))
        person = np.hypot(*(points - steps[k]).T) < 0.25
        assert person.sum() >= 5
        assert moved[person].all()
        assert not moved[~person].any()


def test_nothing_seen_says_nothing() -> None:
    points = np.zeros((3, 2))
    blind = LaserScan(0.0, np.ones(5), 0.0, 0.0, 0.1, 30.0)
    empty = LaserScan(0.0, np.zeros(0), 0.0, 0.1, 0.1, 30.0)
    for views in (Views([]), Views([view_of(blind, np.zeros(3)), view_of(empty, np.zeros(3))])):
        seen, through = views.looks_at(points)
        assert not seen.any()
        assert not through.any()
        assert not contradicted(seen, through).any()


def test_bad_native_input_is_refused() -> None:
    good = (np.zeros((1, 3)), np.array([0, 2]), np.zeros(1), np.ones(1), np.ones(2), np.ones(2), np.zeros((1, 2)), 0.2)
    _native.mapping.see(*good)
    for index, bad in ((1, np.array([0, 3])), (2, np.zeros(2)), (3, np.zeros(1)), (5, np.ones(3))):
        with pytest.raises(ValueError, match="must"):
            _native.mapping.see(*good[:index], bad, *good[index + 1 :])
