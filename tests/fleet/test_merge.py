"""Merged fleets: relative poses near the truth, one solve, keys kept apart, refusals that say why."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clew.errors import InputError
from clew.factors import Between, PointObservation, Prior
from clew.fleet import (
    Encounters,
    InterRobotEdges,
    MergedFleet,
    RelativePose,
    RobotGraph,
    Verdict,
    merge,
    read_robots,
    robot_graph,
    write_merged,
)
from clew.fleet.common import Link, common_landmarks
from clew.fleet.keys import separate_keys
from clew.geometry import SE2, Point2, se2
from clew.graph import FactorGraph
from clew.io import read_graph
from clew.sim import RobotRun
from clew.solve import optimize
from clew.view import report_of_merge
from fleet.fleets import fleet, strangers, trajectory_fit
from fleet.test_relative_pose import still_robot

FOUR_ROBOTS = Path(__file__).parents[3] / "shared" / "data" / "multirobot" / "example_4robots"


def errors(merged: MergedFleet, runs: list[RobotRun]) -> tuple[float, float]:
    """Worst error of a robot relative to the first: metres in the middle of its trajectory, and degrees."""
    fits = [trajectory_fit(run, merged.poses(k).array) for k, run in enumerate(runs)]
    middles = [run.T_world_robot[:, :2].mean(axis=0) for run in runs]
    apart = [np.hypot(*(se2.act(f, m) - se2.act(fits[0], m))) for f, m in zip(fits, middles, strict=True)]
    return max(apart), max(abs(np.degrees(se2.between(fits[0], f)[2])) for f in fits)


@pytest.mark.parametrize(("identified", "reach", "headings"),
                         [(1.0, 0.0, False), (0.3, 0.0, False), (0.0, 6.0, False), (0.0, 6.0, True)])
def test_three_robots_come_together(identified: float, reach: float, headings: bool) -> None:
    runs, robots = fleet(2, 3, identified=identified, reach=reach, headings=headings)
    merged = merge(robots)
    metres, degrees = errors(merged, runs)
    assert metres < 0.10
    assert degrees < 1.0
    assert len(merged.shared) >= 20
    # The joint solve explains all measurements as well as noise of this size lets it.
    blocks = list(merged.graph.blocks())
    rows = sum(len(block) * block.residual_dim for block in blocks)
    free = rows - sum(len(merged.solution.keys(kind)) * kind.dim for kind in merged.solution.kinds) + 3
    assert merged.solution.chi2 == pytest.approx(free, abs=5 * np.sqrt(2 * free))


@pytest.mark.parametrize("landmarks_first", [False, True])
def test_the_report_tells_robots_from_landmarks(landmarks_first: bool) -> None:
    _, graphs = fleet(4, 2, identified=1.0)
    merged = merge(graphs)
    if landmarks_first:  # the order of kinds is that in which a graph got them
        graph, whole = FactorGraph(), merged.solution.graph
        graph.add_point(merged.solution.values(Point2).array, key=merged.solution.keys(Point2))
        graph.add_pose(merged.solution.values(SE2), key=merged.solution.keys(SE2))
        for block in whole.blocks():
            graph.add(block)
        graph.set_constant(int(merged.keys[0][1][0]))
        merged = replace(merged, solution=optimize(graph, init="file"))
        assert merged.solution.kinds[0] is Point2
    report = report_of_merge(merged)
    assert "2 robots in one frame" in report.lead[0]
    assert f"{len(merged.solution.keys(SE2))} poses" in report.lead[0]


def test_every_measurement_and_landmark_is_there_once() -> None:
    _, robots = fleet(2, 2, identified=0.3)
    merged = merge(robots)
    assert merged.graph.factor_count == sum(robot.graph.factor_count for robot in robots)
    points = sum(len(robot.landmarks) for robot in robots) - len(merged.shared)
    assert len(merged.graph.keys(Point2)) == points
    assert len(merged.graph.keys(SE2)) == sum(len(robot.graph.keys(SE2)) for robot in robots)
    letters = [set((new[np.isin(new, merged.graph.keys(SE2))] >> 56).tolist()) for _, new in merged.keys]
    assert letters == [{ord("a")}, {ord("b")}]


def test_merging_makes_no_robot_worse() -> None:
    runs, robots = fleet(4, 3, identified=1.0)
    merged = merge(robots)
    for number, (run, robot) in enumerate(zip(runs, robots, strict=True)):
        alone, together = (
            np.sqrt(np.mean((se2.act(trajectory_fit(run, poses), run.T_world_robot[:, :2]) - poses[:, :2]) ** 2))
            for poses in (robot.graph.values(SE2).array, merged.poses(number).array)
        )
        assert together < 1.1 * alone


def test_robots_without_overlap_are_not_merged() -> None:
    with pytest.raises(InputError, match=r"robot b cannot be placed .* nothing was merged"):
        merge(strangers(1))


def test_a_third_robot_without_overlap_stops_the_merge() -> None:
    _, robots = fleet(2, 2, identified=1.0)
    lost = still_robot("c", np.array([[5.0, 0.5], [3.0, 4.0], [-2.0, 6.0]]), identities=["p", "q", "r"])
    with pytest.raises(InputError, match="robot c cannot be placed"):
        merge([*robots, lost])


def test_the_order_of_robots_only_changes_the_frame() -> None:
    _, robots = fleet(2, 3, identified=0.5)
    forth, back = merge(robots), merge(robots[::-1])
    assert back.solution.chi2 == pytest.approx(forth.solution.chi2, rel=1e-6)
    assert len(forth.shared) == len(back.shared)


def test_priors_of_others_do_not_tear_the_merge() -> None:
    runs, robots = fleet(2, 2, identified=1.0)
    anchored = []
    for robot in robots:
        graph = robot.graph
        graph.add(Prior(0, SE2(100.0, 50.0, 1.0), sigmas=1e-3))
        names = dict(zip(robot.landmarks.keys.tolist(), robot.landmarks.identities.tolist(), strict=True))
        named = {key: name for key, name in names.items() if name}
        anchored.append(robot_graph(robot.name, graph, named, init="auto"))
    merged = merge(anchored)
    assert max(errors(merged, runs)) < 0.2
    np.testing.assert_allclose(merged.poses(0).array[0], [100, 50, 1], atol=1e-6)
    twice = anchored[1].graph
    twice.add(Prior(5, twice.value(5), sigmas=1e-3))
    with pytest.raises(InputError, match="tied to the world in 2 places"):
        merge([anchored[0], robot_graph("b", twice, {
            key: name for key, name in zip(anchored[1].landmarks.keys.tolist(),
                                           anchored[1].landmarks.identities.tolist(), strict=True) if name})])


def test_identities_that_disagree_are_named() -> None:
    points = np.random.default_rng(3).random((6, 2)) * 20
    names = list("uvwxyz")
    moved = points.copy()
    moved[2] += 3.0
    with pytest.raises(InputError, match="disagree about identities: w "):
        merge([still_robot("a", points, identities=names), still_robot("b", moved, (3, 2, 1), names)])


@pytest.mark.parametrize("apart", [1.9, 2.1])
def test_one_identity_in_two_places_is_told_once_the_maps_are_placed(apart: float) -> None:
    """As of robots that were placed by other means: by edges, or by way of a third robot."""
    points = 20 * np.random.default_rng(9).random((3, 2))
    turn = np.array([4.0, -2.0, 0.7])
    moved = points.copy()
    moved[1] += apart * np.array([0.6, 0.8])
    robots = [still_robot("a", points, identities=["u", "v", "w"]),
              still_robot("b", se2.act(se2.inverse(turn), moved), identities=["u", "v", "x"])]
    tables = separate_keys([robot.graph for robot in robots], list("ab"))
    if apart < 2.0:
        assert len(common_landmarks(robots, {}, [np.zeros(3), turn], tables).shared) == 2
    else:
        with pytest.raises(InputError, match=r"a and b disagree about identities: v stand 2\.1 m apart"):
            common_landmarks(robots, {}, [np.zeros(3), turn], tables)


def edge_robots(wrong: int) -> list:
    """Two robots on the same square, tied by four relative poses of which `wrong` are wrong."""
    square = np.array([[0, 0, 0], [2, 0, np.pi / 2], [2, 2, np.pi], [0, 2, -np.pi / 2]])
    frame = np.array([7.0, -3.0, 2.0])
    z = se2.between(square, se2.compose(frame, square))
    z[:wrong, 0] += np.array([4.0, -9.0, 3.0])[:wrong]
    robots = []
    for name in "ab":
        graph = FactorGraph()
        graph.add_pose(SE2.from_array(square))
        graph.add(Between([0, 1, 2, 3], [1, 2, 3, 0], se2.between(square, np.roll(square, -1, axis=0)), sigmas=0.01))
        edges = InterRobotEdges(np.arange(4), np.array(["b"] * 4), np.arange(4), z,
                                np.broadcast_to(np.eye(3) * 1e4, (4, 3, 3)).copy())
        robots.append(robot_graph(name, graph, edges=edges if name == "a" else None))
    return robots


def test_wrong_edges_are_left_out() -> None:
    for wrong in (0, 1, 2):
        merged = merge(edge_robots(wrong))
        np.testing.assert_allclose(merged.frames[1], [7, -3, 2], atol=1e-9)
        link = merged.links[0, 1]
        assert link.edges is not None
        assert len(link.edges.edges) == 4 - wrong
        assert merged.solution.chi2 < 1e-9
    with pytest.raises(InputError, match="of 4 relative poses between their graphs, no more than 1 agree"):
        merge(edge_robots(3))


def test_a_mistaken_encounter_does_not_bend_the_merge() -> None:
    runs, (a, b) = fleet(3, identified=1.0, reach=8.0)
    met = a.encounters
    assert met is not None
    ranges = met.ranges.copy()
    assert len(ranges) >= 4
    ranges[: len(ranges) // 4] += 8.0
    mistaken = Encounters(met.poses, met.others, met.other_poses, ranges, met.bearings, met.covariance)
    merged = merge([RobotGraph(a.name, a.solution, a.landmarks, mistaken), b])
    assert merged.solution.chi2 < 1.5 * merge([a, b]).solution.chi2  # it has next to no say
    metres, degrees = errors(merged, runs)
    assert metres < 0.05
    assert degrees < 0.5


def test_links_that_contradict_each_other_merge_nothing() -> None:
    square = np.array([[0, 0, 0], [2, 0, np.pi / 2], [2, 2, np.pi], [0, 2, -np.pi / 2]])
    frames = {"a": np.zeros(3), "b": np.array([7.0, -3.0, 2.0]), "c": np.array([1.0, 5.0, -1.0])}
    said = {**frames, "c": np.array([4.0, 5.0, -1.0])}  # what a says of c, against what b says
    robots = []
    for name, others, where in (("a", ["b", "c"], said), ("b", ["c"], frames), ("c", [], frames)):
        graph = FactorGraph()
        graph.add_pose(SE2.from_array(square))
        graph.add(Between([0, 1, 2, 3], [1, 2, 3, 0], se2.between(square, np.roll(square, -1, axis=0)), sigmas=0.01))
        z = [se2.between(se2.compose(where[name], square), se2.compose(where[other], square)) for other in others]
        count = 4 * len(others)
        edges = InterRobotEdges(np.tile(np.arange(4), len(others)), np.repeat(np.array(others, dtype=np.str_), 4),
                                np.tile(np.arange(4), len(others)), np.concatenate([*z, np.empty((0, 3))]),
                                np.broadcast_to(np.eye(3) * 1e4, (count, 3, 3)).copy())
        robots.append(robot_graph(name, graph, edges=edges if others else None))
    with pytest.raises(InputError, match=r"contradicts .* by 3\.0 m; nothing was merged"):
        merge(robots)


def test_landmarks_that_links_would_make_one_of_two_are_left_apart() -> None:
    rng = np.random.default_rng(9)
    points = 20 * rng.random((4, 2))
    robots = [still_robot(name, points) for name in "abc"]
    pairs = {(0, 1): [[0, 0], [1, 1]], (1, 2): [[0, 0], [1, 1]], (0, 2): [[0, 0], [2, 1]]}  # a's 1 and 2 would be one
    links = {
        ab: Link(np.zeros(3), 3, RelativePose(Verdict.FOUND, np.zeros(3), np.eye(3), np.array(common)))
        for ab, common in pairs.items()
    }
    tables = separate_keys([robot.graph for robot in robots], list("abc"))
    common = common_landmarks(robots, links, [np.zeros(3)] * 3, tables)
    assert len(common.shared) == 1
    keys = [new[np.searchsorted(old, robot.landmarks.keys)] for robot, (old, new) in
            zip(robots, common.tables, strict=True)]
    assert keys[0][0] == keys[1][0] == keys[2][0]
    assert len({int(key) for of_robot in keys for key in of_robot}) == 12 - 2


def test_bad_requests() -> None:
    _, robots = fleet(2, 2, identified=1.0, duration=20.0)
    with pytest.raises(InputError, match="at least two"):
        merge(robots[:1])
    with pytest.raises(InputError, match="the same name"):
        merge([robots[0], robots[0]])


def test_keys_that_carry_letters_are_kept() -> None:
    plain, lettered, again = FactorGraph(), FactorGraph(), FactorGraph()
    for graph, base in ((plain, 0), (lettered, ord("a") << 56), (again, ord("a") << 56)):
        graph.add_pose(SE2.identity((3,)), key=base + np.arange(3))
    tables = separate_keys([plain, lettered], ["x", "y"])
    np.testing.assert_array_equal(tables[0][1], (ord("b") << 56) + np.arange(3))
    np.testing.assert_array_equal(tables[1][0], tables[1][1])
    with pytest.raises(InputError, match="letter 'a'"):
        separate_keys([lettered, again], ["x", "y"])


@pytest.mark.skipif(not FOUR_ROBOTS.exists(), reason="needs ../shared/data/multirobot/example_4robots")
def test_four_real_robots_end_where_one_graph_of_all_their_edges_does(tmp_path: Path) -> None:
    files = [FOUR_ROBOTS / f"{number}.g2o" for number in range(4)]
    merged = merge(read_robots(files))
    together = tmp_path / "all.g2o"
    together.write_text("\n".join(sorted({line for file in files for line in file.read_text().splitlines()})) + "\n")
    graph = read_graph(together).graph
    assert merged.graph.factor_count == graph.factor_count == 144
    assert merged.solution.chi2 == pytest.approx(optimize(graph).chi2, rel=1e-6)


def landmarks_first(name: str, T_world_own: SE2) -> RobotGraph:
    """A robot whose landmarks have smaller keys than its poses, as in the graphs of `clew run`."""
    tags = np.array([[0.0, 3.0], [4.0, 3.0], [2.0, -1.0], [5.0, 0.5]])
    graph = FactorGraph()
    points = graph.add_point(T_world_own.inverse().act(tags), key=np.arange(6, 10))
    poses = graph.add_pose(SE2.from_array(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])), key=[1000, 1001])
    graph.add(Between(poses[:1], poses[1:], SE2(1.0, 0.0, 0.0), sigmas=0.01))
    graph.add(PointObservation(np.full(4, poses[0]), points, T_world_own.inverse().act(tags), sigmas=0.05))
    return robot_graph(name, graph, identities={int(key): f"tag {key}" for key in points})


def test_poses_and_letters_are_the_robots_own_where_landmarks_have_smaller_keys(tmp_path: Path) -> None:
    merged = merge([landmarks_first("ann", SE2.identity()), landmarks_first("bob", SE2(2.0, 1.0, 0.5))])
    np.testing.assert_allclose(merged.poses(1).array[0], [2.0, 1.0, 0.5], atol=1e-6)
    assert len(merged.poses(0)) == len(merged.poses(1)) == 2
    write_merged(merged, tmp_path)
    letters = [robot["letter"] for robot in json.loads((tmp_path / "robots.json").read_text())]
    keys = read_graph(tmp_path / "graph.g2o").graph.keys(SE2)
    assert sorted({chr(int(key) >> 56) for key in keys}) == letters == ["a", "b"]
