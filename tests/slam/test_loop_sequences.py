"""A row of partial closures along a corridor, in a drive of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from clew.geometry import se2
from clew.place import Closure, Verdict
from clew.scan import ScanPoints
from clew.sim import OdometryModel, SimulatedLog, drive, loop, simulate, tour
from clew.slam import Slam, SlamConfig
from clew.slam.keyframes import Keyframe, KeyframeStore
from clew.slam.loop_sequences import SequenceMatcher
from clew.slam.places import Places
from clew.slam.pose_graph import PoseGraph
from slam.drives import LASER, closure_error, mapped


@cache
def twice_round() -> SimulatedLog:
    """One and a half times round a corridor of 80 m with a cabinet every six or so."""
    world = loop(2, length=80.0)
    return simulate(world, drive(tour(world, 2, 125.0), rate=3.0, duration=125.0), LASER, OdometryModel.bad(), 2)


def row_of_partial(slam: Slam) -> list[Closure]:
    """All closures taken out of the graph, and those of the first side put in again without what they know along it."""
    closer = slam._closer
    held = [c for c in closer._beliefs.held if not c.is_partial]
    for belief in closer._beliefs._held:
        slam._pose_graph.remove(belief.factor)
    closer._beliefs._held.clear()
    slam._pose_graph.optimise()
    poses = slam._pose_graph.poses
    row = []
    for closure in held:
        if abs(np.sin(2.0 * poses[closure.target, 2])) > 0.2 or len(row) == 8:
            continue
        axis = np.array([np.cos(closure.T_target_source[2]), 0.0, 0.0])  # driving along the corridor
        axis[1] = -np.sin(closure.T_target_source[2])
        column = closure.information @ axis
        information = closure.information - np.outer(column, column) / (axis @ column) + 1e-3 * np.eye(3)
        elsewhere = se2.compose(closure.T_target_source, 0.7 * axis)
        row.append(replace(closure, T_target_source=elsewhere, information=information, is_partial=True))
    for closure in row:
        closer._beliefs.add(closure)
    slam._pose_graph.optimise()
    return row


def moved_along(slam: Slam, row: list[Closure], distance: float) -> None:
    """The second round is believed farther along the first side."""
    poses = slam._pose_graph.poses[slam.keyframe_numbers].copy()
    heading = slam._pose_graph.poses[row[0].source, 2]
    second = slam.keyframe_numbers >= row[0].source
    poses[second, :2] += distance * np.array([np.cos(heading), np.sin(heading)])
    slam._pose_graph.set_poses(poses)


def test_a_row_of_partial_closures_becomes_whole_where_the_truth_is() -> None:
    log = twice_round()
    slam = mapped(log)
    row = row_of_partial(slam)
    assert len(row) == 8
    moved_along(slam, row, 0.6)
    found = slam._closer._sequences.match(slam._closer._beliefs.held)
    assert len(found) >= 4
    for closure in found:
        turn = closure.T_target_source[2]  # the target looks along the corridor, the source need not
        axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        along, across = axes @ closure_error(closure, slam, log)[:2]
        deviation = np.sqrt((axes @ np.linalg.inv(closure.information)[:2, :2] @ axes.T)[0, 0])
        assert abs(along) < max(0.1, 3.0 * deviation)
        assert abs(across) < 0.1
        assert not closure.is_partial
        assert closure.in_row >= len(found)
        assert 0.0 < closure.within < 2.0
    assert np.median([abs(closure_error(c, slam, log)[0]) for c in found]) < 0.15


def test_a_closure_that_has_become_whole_is_told_of_once() -> None:
    slam = mapped(twice_round())
    row = row_of_partial(slam)
    closer = slam._closer
    closer._match_sequences()
    told = [*closer.accepted, *closer.rejected]
    ends = {(c.source, c.target) for c in row}
    assert sorted((c.source, c.target) for c in told if (c.source, c.target) in ends) == sorted(ends)
    assert any(c.in_row for c in closer.accepted)


def test_closures_with_two_older_passes_in_turns_are_two_rows() -> None:
    """A corridor of 30 m driven three times in one direction, by a way of 10 m back to where it begins."""
    config, along = SlamConfig(), 0.5 * np.arange(60)
    keyframes, graph = KeyframeStore(), PoseGraph(config.closing.kernel_scale)
    nothing = ScanPoints(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    for k, x in enumerate(np.tile(along, 3)):
        step = np.array([x - (keyframes.T_local_robot[k - 1, 0] if k else 0.0), 0.0, 0.0])
        path = 40.0 * (k // 60) + x
        keyframe = Keyframe(float(k), nothing, np.zeros(3), np.array([x, 0.0, 0.0]), path, step, 1e4 * np.eye(3))
        keyframes.add(keyframe)
        graph.add_keyframe(keyframe)
    graph.optimise()
    unknown_along = np.diag([1e-6, 1e4, 1e4])
    held = [Closure(120 + k, k + 60 * (k // 4 % 2), 1.0, Verdict.CONFIRMED, np.zeros(3), unknown_along, is_partial=True)
            for k in range(0, 40, 4)]
    rows = SequenceMatcher(keyframes, graph, Places(keyframes, config), config)._chains(held)
    assert [[link.closure.target for link in row] for row in rows] == [list(range(0, 40, 8)), list(range(64, 100, 8))]


def test_one_partial_closure_is_no_row() -> None:
    slam = mapped(twice_round())
    row = row_of_partial(slam)
    moved_along(slam, row, 0.6)
    assert slam._closer._sequences.match(row[3:4]) == []


def test_rows_are_left_as_they_are_when_asked_to_stop_between_their_matches() -> None:
    slam = mapped(twice_round())
    row = row_of_partial(slam)
    moved_along(slam, row, 0.6)
    asked: list[bool] = []

    def stop() -> bool:
        asked.append(len(asked) == 3)
        return asked[-1]

    assert slam._closer._sequences.match(row, stop) == []
    assert asked == [False, False, False, True]
