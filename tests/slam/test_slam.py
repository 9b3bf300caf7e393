"""The pipeline on simulated drives against the truth, and its answers at any moment."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace

import numpy as np
import pytest

from clew.errors import InputError
from clew.geometry import SE2, se2
from clew.graph import Role
from clew.io import write_graph
from clew.motion import Odometry
from clew.sim import LaserModel, OdometryModel, SimulatedLog, simulate_kind
from clew.slam import Slam
from slam.drives import closure_error, errors, mapped, measurements, outing, round_trip, truth_of


@pytest.mark.parametrize("kind", ["office", "hall", "corridor", "loop"])
def test_trajectory_is_near_the_truth_and_far_better_than_odometry(kind: str) -> None:
    log = outing(kind)
    slam, truth = mapped(log, refine=True), truth_of(log)
    translation, rotation = errors(slam.trajectory.T_world_robot, truth)
    of_odometry, _ = errors(slam.odometry.T_world_robot, truth)
    along = 0.5 if kind in ("corridor", "loop") else 0.1  # a corridor tells little of how far the robot has come
    assert np.sqrt(np.mean(translation**2)) < along
    assert rotation.max() < 0.02
    assert translation.max() < max(0.1, 0.7 * of_odometry.max())
    np.testing.assert_allclose(slam.odometry.T_world_robot, log.T_odom_robot, atol=1e-9)


def test_second_round_is_closed_with_the_first_and_every_closure_is_right() -> None:
    log = round_trip()
    slam = mapped(log)
    assert len(slam.closures) >= 10
    for closure in slam.closures:
        off = closure_error(closure, slam, log)
        assert np.hypot(off[0], off[1]) < 0.1
        assert abs(off[2]) < 0.03
        assert closure.verdict.name == "CONFIRMED"
        assert closure.source > closure.target
    accepted = {(c.source, c.target) for c in slam.closures}
    assert not accepted & {(c.source, c.target) for c in slam.rejected_closures}
    translation, rotation = errors(slam.trajectory.T_world_robot, truth_of(log))
    assert translation.max() < 0.06
    assert rotation.max() < 0.01
    before = slam.trajectory.T_world_robot
    slam.refine()
    translation_refined, _ = errors(slam.trajectory.T_world_robot, truth_of(log))
    assert translation_refined.max() < translation.max() + 0.01
    assert np.abs(slam.trajectory.T_world_robot - before).max() > 1e-6


def test_one_pose_a_scan_and_one_vertex_a_keyframe() -> None:
    log = round_trip()
    slam = mapped(log)
    assert slam.scan_count == len(slam.trajectory) == len(slam.odometry) == log.scan_count
    np.testing.assert_array_equal(slam.trajectory.timestamps, log.timestamps)
    assert slam.time_span == (log.timestamps[0], log.timestamps[-1])
    count = len(slam.keyframes)
    assert 40 < count < log.scan_count
    assert np.isin(slam.keyframes.timestamps, log.timestamps).all()
    np.testing.assert_array_equal(slam.graph.values(SE2).array, slam.keyframes.T_world_robot)
    solution = slam.solution()
    np.testing.assert_array_equal(solution.values().array, slam.keyframes.T_world_robot)
    assert (np.diagonal(solution.covariances()[1:], axis1=1, axis2=2) > 0).all()
    assert len(slam.keyframe_points) == count
    at = np.searchsorted(slam.trajectory.timestamps, slam.keyframes.timestamps)
    np.testing.assert_allclose(slam.trajectory.T_world_robot[at], slam.keyframes.T_world_robot, atol=1e-12)
    by_role = {role: sum(len(b) for b in slam.graph.blocks() if b.role is role) for role in Role}
    assert by_role[Role.ODOMETRY] == count - 1
    assert by_role[Role.LOOP] == len(slam.closures)
    np.testing.assert_allclose(slam.trajectory.T_world_robot[0], np.zeros(3), atol=1e-12)


def test_answers_at_any_moment_are_those_of_a_log_that_ends_there() -> None:
    log = round_trip()
    slam, steps = Slam(), [0, 1, 2, 40, 41, 120]
    for first, last in itertools.pairwise(steps):
        for measurement in measurements(log, first, last):
            slam.add(measurement)
        fresh = Slam()
        for measurement in measurements(log, 0, last):
            fresh.add(measurement)
        np.testing.assert_array_equal(slam.trajectory.T_world_robot, fresh.trajectory.T_world_robot)
        assert slam.chi2 == fresh.chi2
        np.testing.assert_array_equal(slam.pose.array, slam.trajectory.T_world_robot[-1])
        if last in (1, 41):
            grid = slam.map(0.1)
            np.testing.assert_array_equal(grid.log_odds, fresh.map(0.1).log_odds)
            assert slam.map().resolution == slam.config.map_resolution


def test_what_was_answered_does_not_change_later() -> None:
    log = outing("office")
    slam = Slam()
    for measurement in measurements(log, 0, 30):
        slam.add(measurement)
    taken = [slam.trajectory.T_world_robot, slam.keyframes.T_world_robot, slam.odometry.T_world_robot]
    copies = [a.copy() for a in taken]
    for measurement in measurements(log, 30, 60):
        slam.add(measurement)
    slam.refine()
    for array, copy in zip(taken, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_same_log_same_bytes(tmp_path) -> None:  # type: ignore[no-untyped-def]  # pytest's own fixture
    texts = []
    for name in ("a", "b"):
        slam = mapped(round_trip(), refine=True)
        write_graph(tmp_path / name, slam.graph)
        texts.append((tmp_path / name).read_bytes() + slam.trajectory.T_world_robot.tobytes()
                     + slam.map(0.1).log_odds.tobytes())
    assert texts[0] == texts[1]


def test_scans_alone_are_enough() -> None:
    log = outing("office")
    slam, with_odometry = Slam(use_odometry=False), mapped(log)
    for k in range(log.scan_count):
        slam.add_scan(log.scan(k))
    translation, rotation = errors(slam.trajectory.T_world_robot, truth_of(log))
    assert translation.max() < 0.15
    assert rotation.max() < 0.02
    assert not slam.odometry.T_world_robot.any()
    assert len(slam.keyframes) == pytest.approx(len(with_odometry.keyframes), rel=0.2)


def blinded(log: SimulatedLog, which: slice) -> Slam:
    slam = Slam()
    blind = set(range(log.scan_count)[which])
    for k in range(log.scan_count):
        slam.add_odometry(Odometry(float(log.timestamps[k]), log.T_odom_robot[k]))
        scan = log.scan(k)
        slam.add_scan(replace(scan, ranges=np.full_like(scan.ranges, np.inf if k % 2 else np.nan)) if k in blind
                      else scan)
    return slam


@pytest.mark.parametrize("which", [slice(30, 40), slice(0, 5), slice(60, None)])
def test_odometry_carries_over_scans_without_returns(which: slice) -> None:
    log = outing("office")
    slam = blinded(log, which)
    translation, _ = errors(slam.trajectory.T_world_robot, truth_of(log))
    assert translation.max() < 0.5
    slam.refine()
    assert np.isfinite(slam.trajectory.T_world_robot).all()


def test_with_no_return_at_all_the_trajectory_is_odometry() -> None:
    log = outing("office")
    slam = blinded(log, slice(None))
    slam.refine()
    np.testing.assert_allclose(se2.between(slam.odometry.T_world_robot, slam.trajectory.T_world_robot), 0.0, atol=1e-6)
    assert not slam.closures
    slam.map(0.2)


def test_without_returns_each_edge_is_as_uncertain_as_the_odometry_on_it() -> None:
    log = outing("office")
    slam = blinded(log, slice(None))
    block, = (b for b in slam.graph.blocks() if b.role is Role.ODOMETRY)
    of_rotation = np.linalg.inv(block.information)[:, 2, 2]
    at = np.searchsorted(log.timestamps, slam.keyframes.timestamps)
    increments = se2.between(log.T_odom_robot[:-1], log.T_odom_robot[1:])
    every = slam.config.odometry.covariance(increments)[:, 2, 2]
    expected = np.add.reduceat(every[: at[-1]], at[:-1])
    assert len(of_rotation) > 30
    assert np.all(of_rotation < 1.05 * expected)
    assert np.all(of_rotation > 0.5 * expected)


def test_nothing_and_next_to_nothing() -> None:
    slam = Slam()
    slam.refine()
    assert (len(slam.trajectory), len(slam.keyframes), slam.scan_count, slam.chi2) == (0, 0, 0, 0.0)
    assert slam.time_span == (0.0, 0.0)
    np.testing.assert_array_equal(slam.pose.array, np.zeros(3))
    with pytest.raises(InputError, match="no scan yet"):
        slam.map()
    for measurement in measurements(outing("hall"), 0, 1):
        slam.add(measurement)
    slam.refine()
    assert (len(slam.trajectory), len(slam.keyframes), slam.chi2) == (1, 1, 0.0)


def test_bad_measurements_are_refused_and_leave_no_trace() -> None:
    log = outing("hall")
    slam = Slam()
    with pytest.raises(InputError, match="no odometry before the scan"):
        slam.add_scan(log.scan(0))
    for measurement in measurements(log, 0, 20):
        slam.add(measurement)
    before = slam.trajectory.T_world_robot
    for scan in (log.scan(19), log.scan(3), replace(log.scan(25), timestamp=float("nan")),
                 replace(log.scan(25), ranges=log.scan(25).ranges[None]),
                 replace(log.scan(25), angle_increment=float("inf")),
                 replace(log.scan(25), T_robot_sensor=np.array([0.0, np.nan, 0.0]))):
        with pytest.raises(InputError) as caught:
            slam.add_scan(scan)
        assert "\n" not in str(caught.value)
    for pose in (np.array([np.nan, 0.0, 0.0]), np.array([0.0, np.inf, 0.0]), np.zeros(2)):
        with pytest.raises(InputError):
            slam.add_odometry(Odometry(float(log.timestamps[20]), pose))
    np.testing.assert_array_equal(slam.trajectory.T_world_robot, before)
    for measurement in measurements(log, 20, 22):
        slam.add(measurement)
    assert slam.scan_count == 22


@pytest.mark.parametrize("jump", [3.0, 100.0, 5e5])
def test_odometry_that_jumps_does_not_take_the_robot_along(jump: float) -> None:
    log = outing("office")
    slam = Slam()
    for k in range(45):
        offset = np.array([jump, 0.0, 0.0]) if k >= 30 else np.zeros(3)
        slam.add_odometry(Odometry(float(log.timestamps[k]), log.T_odom_robot[k] + offset))
        slam.add_scan(log.scan(k))
    translation, _ = errors(slam.trajectory.T_world_robot, truth_of(log)[:45])
    assert translation.max() < 0.15


@pytest.mark.parametrize("pause", [5.0, 3600.0])
def test_scans_alone_survive_a_pause(pause: float) -> None:
    """Without searching the whole world after it."""
    log = outing("office")
    slam, begun = Slam(use_odometry=False), time.process_time()
    for k in range(45):
        scan = log.scan(k)
        slam.add_scan(replace(scan, timestamp=scan.timestamp + (pause if k >= 30 else 0.0)))
    translation, _ = errors(slam.trajectory.T_world_robot, truth_of(log)[:45])
    assert translation.max() < 0.15
    assert time.process_time() - begun < 4.0  # 0.5 usually; 14 for each 5 s of pause if the window had no limit


def test_a_log_goes_on_after_a_refinement() -> None:
    log = round_trip()
    slam = Slam()
    for measurement in measurements(log, 0, 200):
        slam.add(measurement)
    slam.refine()
    refined = slam.graph
    for measurement in measurements(log, 200, log.scan_count):
        slam.add(measurement)
    assert slam.graph is not refined
    assert len(slam.graph) == len(slam.keyframes) > len(refined)
    np.testing.assert_array_equal(slam.graph.values(SE2).array, slam.keyframes.T_world_robot)
    assert errors(slam.trajectory.T_world_robot, truth_of(log))[0].max() < 0.06


def test_optimising_after_a_refinement_gives_that_up() -> None:
    """Graph, poses and covariances are of one estimate at any moment."""
    slam = mapped(outing("office"), refine=True)
    refined = slam.graph
    slam.optimise()
    assert slam.graph is not refined
    np.testing.assert_array_equal(slam.graph.values(SE2).array, slam.keyframes.T_world_robot)


def test_odometry_edges_are_as_certain_as_they_are_right() -> None:
    """Normalised squared errors of an honest edge are 3 on average, early or late in the drive."""
    log = round_trip()
    slam = mapped(log)
    block, = (b for b in slam.graph.blocks() if b.role is Role.ODOMETRY)
    at = np.searchsorted(log.timestamps, slam.keyframes.timestamps)
    true = se2.between(log.T_world_robot[at][:-1], log.T_world_robot[at][1:])
    e = se2.between(true, block.measurement)
    squared = np.einsum("mi,mij,mj->m", e, block.information, e)
    for part in np.array_split(squared, 3):
        assert 0.1 < part.mean() < 6.0
    spread = np.linalg.det(block.information) ** (-1 / 6)
    assert np.median(spread[-40:]) < 1.5 * np.median(spread[:40])


@pytest.mark.parametrize("use_odometry", [True, False])
def test_a_robot_before_far_walls_alone_does_not_seem_to_stand_still(use_odometry: bool) -> None:
    """The walls of a street are sampled so sparsely that at first only the same beams meet the same places again."""
    log = simulate_kind("campus", 1, duration=12.0, rate=3.0, laser=LaserModel(beams=181, range_max=25.0),
                        odometry=OdometryModel.good())
    slam, truth = mapped(log, use_odometry=use_odometry), truth_of(log)
    assert np.hypot(*truth[-1, :2]) > 8.0
    translation, rotation = errors(slam.trajectory.T_world_robot, truth)
    assert translation.max() < 0.2
    assert rotation.max() < 0.01
