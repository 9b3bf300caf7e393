"""Landmark SLAM on a simulated robot with a crooked camera and slipping wheels, and on real data where it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clew.errors import InputError
from clew.evaluate import absolute_trajectory_error, align
from clew.geometry import SE2, Point2, se2, wrap
from clew.io import SightingLog, Sightings, Velocities, read_feature_log, read_graph, read_mrclam, write_graph
from clew.io.log import ReadReport
from clew.slam.landmarks import KEYS_A_ROBOT, map_features, map_landmarks
from clew.slam.landmarks.track import _views
from clew.solve import optimize

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "landmarks"
LANDMARKS = np.array([[3.0 * np.cos(a) + 0.2 * k, 3.0 * np.sin(a)] for k, a in enumerate(np.linspace(0, 5.5, 10))])
OFFSET, CURVE, TURN_SCALE, RANGE_SIGMA, BEARING_SIGMA = 0.06, -0.4, -0.1, 0.03, 0.01


def simulate(robot: int, seed: int, start: np.ndarray, seconds: float = 120.0) -> SightingLog:
    rng = np.random.default_rng(seed)
    stamps = np.arange(0.0, seconds, 0.05)
    speed = np.full(len(stamps), 0.25)
    rate = 0.35 + 0.3 * np.sin(0.07 * stamps + robot)
    true_rate = (1.0 + TURN_SCALE) * rate + 0.02 * rng.standard_normal(len(stamps))
    truth = np.zeros((len(stamps), 4))
    truth[:, 0] = stamps
    pose = start
    for k in range(len(stamps)):
        truth[k, 1:] = pose
        pose = se2.compose(pose, se2.exp(np.array([0.05 * speed[k], 0.0, 0.05 * true_rate[k]])))
    rows = []
    for k in range(0, len(stamps), 8):
        q = se2.act(se2.inverse(truth[k, 1:]), LANDMARKS)
        distance, bearing = np.hypot(*q.T), np.arctan2(q[:, 1], q[:, 0])
        for j in np.flatnonzero(np.abs(bearing) < 0.6):
            z = bearing[j] + OFFSET + BEARING_SIGMA * rng.standard_normal()
            stretch = 1.0 + CURVE * (z * z - 0.12)
            rows.append((stamps[k], 6 + j, distance[j] * stretch + RANGE_SIGMA * rng.standard_normal(), wrap(z)))
    t, identity, distance, bearing = np.array(rows).T
    none = Sightings(*(np.empty(0, kind) for kind in (float, np.int64, float, float)))
    seen = Sightings(t, identity.astype(np.int64), distance, bearing)
    odometry = Velocities(stamps, speed, rate)
    return SightingLog(Path("simulated"), robot, odometry, seen, none, truth, ReadReport())


@pytest.fixture(scope="module")
def log() -> SightingLog:
    return simulate(1, 0, np.array([0.5, -1.0, 0.3]))


def test_trajectory_landmarks_and_calibration(log: SightingLog, tmp_path: Path) -> None:
    found = map_landmarks([log])
    (robot,) = found.robots
    assert log.truth is not None
    error = absolute_trajectory_error(log.truth[:, 0], log.truth[:, 1:], robot.timestamps, robot.T_world_robot)
    assert error.translation.rmse < 0.08
    odometry = absolute_trajectory_error(log.truth[:, 0], log.truth[:, 1:], robot.timestamps, robot.T_odom_robot)
    assert error.translation.rmse < 0.3 * odometry.translation.rmse
    true = LANDMARKS[found.identity - 6]
    assert np.linalg.norm(se2.act(align(true, found.position), found.position) - true, axis=1).max() < 0.15
    calibration = robot.model.calibration
    assert calibration.turn_scale == pytest.approx(TURN_SCALE, abs=0.02)
    assert calibration.bearing_offset == pytest.approx(OFFSET, abs=0.03)
    assert calibration.range_curve == pytest.approx(CURVE, abs=0.1)
    assert 0.5 * RANGE_SIGMA < robot.model.landmarks.range < 1.5 * RANGE_SIGMA
    assert 0.4 * BEARING_SIGMA < robot.model.landmarks.bearing < 1.5 * BEARING_SIGMA
    assert robot.keys[0] == KEYS_A_ROBOT
    assert found.sightings.sum() == len(log.landmarks)
    # the plain graph is the same problem: solved by itself it stays where it is, from a file, too
    write_graph(tmp_path / "graph.g2o", found.graph)
    again = optimize(read_graph(tmp_path / "graph.g2o").graph, init="file")
    drift = again.values(SE2).array[:, :2] - robot.T_world_robot[:, :2]
    assert np.linalg.norm(drift, axis=1).max() < 0.05


def test_the_plain_graph_rests_at_the_solution_in_spite_of_outliers(log: SightingLog) -> None:
    bearing = log.landmarks.bearing.copy()
    bearing[::40] = wrap(bearing[::40] + 1.5)
    seen = Sightings(log.landmarks.timestamp, log.landmarks.identity, log.landmarks.range, bearing)
    found = map_landmarks([replace(log, landmarks=seen)])
    again = optimize(found.graph, init="file")
    assert again.chi2 > 0.98 * again.chi2_initial
    moved = again.values(SE2).array[:, :2] - found.robots[0].T_world_robot[:, :2]
    assert np.linalg.norm(moved, axis=1).max() < 0.01


def test_two_robots_are_one_map(log: SightingLog) -> None:
    other = simulate(2, 1, np.array([-0.5, 1.5, 2.0]), 60.0)
    found = map_landmarks([log, other])
    for robot, one in zip(found.robots, (log, other), strict=True):
        assert one.truth is not None
        error = absolute_trajectory_error(one.truth[:, 0], one.truth[:, 1:], robot.timestamps, robot.T_world_robot)
        assert error.translation.rmse < 0.08
    assert set(found.graph.keys(Point2)) == set(found.identity)


def test_a_robot_that_sees_little_is_found_by_one_that_sees_it(log: SightingLog) -> None:
    """Robot 2 sees landmarks at the begin and at the end only; in between robot 1 sees it."""
    other = simulate(2, 1, np.array([-0.5, 1.5, 2.0]))
    assert log.truth is not None
    assert other.truth is not None
    stamp = other.landmarks.timestamp
    other = replace(other, landmarks=other.landmarks.take((stamp < 20.0) | (stamp > 105.0)))
    rng = np.random.default_rng(2)
    q = se2.act(se2.inverse(log.truth[::8, 1:]), other.truth[::8, 1:3])
    bearing, distance = np.arctan2(q[:, 1], q[:, 0]), np.hypot(*q.T)
    seen = np.abs(bearing) < 0.8
    z = bearing[seen] + OFFSET + BEARING_SIGMA * rng.standard_normal(seen.sum())
    ranges = distance[seen] * (1.0 + CURVE * (z * z - 0.12)) + RANGE_SIGMA * rng.standard_normal(seen.sum())
    mates = Sightings(log.truth[::8, 0][seen], np.full(seen.sum(), 2), ranges, z)
    errors = []
    for robots in (log.robots, mates):
        found = map_landmarks([replace(log, robots=robots), other]).robots[1]
        error = absolute_trajectory_error(other.truth[:, 0], other.truth[:, 1:], found.timestamps, found.T_world_robot)
        errors.append(error.translation.rmse)
    assert errors[1] < 0.6 * errors[0]


def test_robots_without_common_landmarks_are_refused(log: SightingLog) -> None:
    other = simulate(2, 1, np.array([-0.5, 1.5, 2.0]), 40.0)
    seen = other.landmarks
    far = Sightings(seen.timestamp, seen.identity + 50, seen.range, seen.bearing)
    stranger = SightingLog(other.path, 2, other.odometry, far, other.robots, other.truth, other.report)
    with pytest.raises(InputError, match="0 landmarks in common"):
        map_landmarks([log, stranger])
    with pytest.raises(InputError, match="at least one robot"):
        map_landmarks([])
    with pytest.raises(InputError, match="each may occur once"):
        map_landmarks([log, log])


def test_views_end_with_pauses_and_after_a_while() -> None:
    stamp = np.array([0.0, 0.0, 1.0, 1.5, 6.0, 7.0, 9.0, 11.0, 13.0, 15.0, 17.5])
    identity = np.array([6, 7, 6, 7, 6, 7, 7, 7, 7, 7, 7])
    none = np.zeros(len(stamp))
    views = _views(Sightings(stamp, identity, none, none))
    expected = [0, 2, 0, 2, 1, 3, 3, 3, 3, 3, 4]
    np.testing.assert_array_equal(views, expected)
    assert len(_views(Sightings(*(np.empty(0, kind) for kind in (float, np.int64, float, float))))) == 0


def test_unknown_landmarks_of_a_simulated_world() -> None:
    path, given = DATA / "world-2000-noassoc.g2o.gz", DATA / "world-2000-full.g2o.gz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    log, full = read_feature_log(path), read_graph(given).graph
    features, found_map = log.features, map_features(log)
    block = next(b for b in full.blocks() if b.kinds == (SE2, Point2))
    order = np.lexsort((*block.measurement.T, block.keys[:, 0]))
    mine = np.lexsort((*features.measurement.T, features.keys))
    truth, found = block.keys[order, 1], found_map.landmark[mine]
    right = sum(np.unique(found[truth == tree], return_counts=True)[1].max() for tree in np.unique(truth))
    assert right > 0.99 * len(found)
    assert abs(len(np.unique(found)) - len(np.unique(truth))) <= 3
    assert found_map.solution.status.ok


def test_a_real_robot() -> None:
    folder = DATA / "MRCLAM_Dataset6"
    if not folder.exists():
        pytest.skip(f"needs {folder}")
    log = read_mrclam(folder, 2)
    early = log.landmarks.timestamp < log.landmarks.timestamp[0] + 300.0
    part = SightingLog(log.path, 2, log.odometry, log.landmarks.take(early), log.robots.take(np.zeros(0, np.int64)),
                       log.truth, log.report)  # fmt: skip
    (robot,) = map_landmarks([part]).robots
    assert log.truth is not None
    error = absolute_trajectory_error(log.truth[:, 0], log.truth[:, 1:], robot.timestamps, robot.T_world_robot)
    assert error.translation.rmse < 0.12
