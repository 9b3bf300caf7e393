"""Relative poses of robots: found from landmarks, constellations and encounters, refused where they must be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clew.errors import InputError
from clew.factors import Between, RangeBearing
from clew.fleet import Encounters, MergeOptions, RobotGraph, Verdict, relative_pose, robot_graph
from clew.geometry import SE2, se2
from clew.graph import FactorGraph
from clew.sim import RobotRun
from fleet.fleets import fleet, strangers


def error(runs: list[RobotRun], found: np.ndarray) -> tuple[float, float]:
    """Metres in the middle of the second robot's trajectory as it knows it, and degrees."""
    true = se2.between(runs[0].T_world_robot[0], runs[1].T_world_robot[0])
    own = se2.between(runs[1].T_world_robot[:1], runs[1].T_world_robot)[:, :2].mean(axis=0)
    apart = se2.act(true, own) - se2.act(found, own)
    return float(np.hypot(*apart)), float(np.degrees(abs(se2.between(true, found)[2])))


@pytest.mark.parametrize("identified", [0.0, 0.05, 0.4, 1.0])
def test_overlapping_robots_are_placed(identified: float) -> None:
    for seed in range(3):
        runs, (a, b) = fleet(seed, identified=identified)
        found = relative_pose(a, b)
        assert found.verdict is Verdict.FOUND
        metres, degrees = error(runs, found.T_a_b)
        # The robots' own frames hang on what they saw from their first poses: some decimetres before the joint solve.
        assert metres < 0.5
        assert degrees < 2.0
        names = a.landmarks.identities[found.common[:, 0]], b.landmarks.identities[found.common[:, 1]]
        both = (names[0] != "") & (names[1] != "")
        np.testing.assert_array_equal(names[0][both], names[1][both])


def test_swapped_robots_give_the_inverse() -> None:
    _, (a, b) = fleet(1)
    forth, back = relative_pose(a, b), relative_pose(b, a)
    np.testing.assert_allclose(se2.compose(forth.T_a_b, back.T_a_b), 0, atol=0.02)


def test_robots_without_overlap_are_refused() -> None:
    verdicts = {relative_pose(*strangers(seed, identified)).verdict for seed in range(8) for identified in (0.0, 0.5)}
    assert Verdict.FOUND not in verdicts
    assert verdicts <= {Verdict.BY_CHANCE, Verdict.TOO_FEW, Verdict.AMBIGUOUS, Verdict.CONTRADICTED}


def still_robot(name: str, points: np.ndarray, start: tuple[float, float, float] = (0, 0, 0),
                identities: list[str] | None = None) -> RobotGraph:
    """A robot that saw exact points ``(L, 2)`` of the world twice from where it stands."""
    graph = FactorGraph()
    keys = graph.add_pose(SE2.from_array(np.zeros((2, 3))))
    graph.add(Between(keys[0], keys[1], SE2(0, 0, 0), sigmas=1e-3))
    local = se2.act(se2.inverse(np.array(start, dtype=float)), points)
    marks = graph.add_point(local)
    for key in keys:
        graph.add(RangeBearing(key, marks, np.hypot(*local.T), np.arctan2(local[:, 1], local[:, 0]), sigmas=1e-3))
    named = dict(zip(marks.tolist(), identities, strict=True)) if identities else None
    return robot_graph(name, graph, named)


def test_three_identities_are_enough_and_two_are_not() -> None:
    points = np.array([[5.0, 0.5], [3.0, 4.0], [-2.0, 6.0]])
    start = (4.0, 1.0, 2.0)
    a = still_robot("a", points, identities=["x", "y", "z"])
    found = relative_pose(a, still_robot("b", points, start, ["x", "y", "z"]))
    assert found.verdict is Verdict.FOUND
    np.testing.assert_allclose(found.T_a_b, start, atol=1e-4)
    refused = relative_pose(a, still_robot("b", points, start, ["x", "y", "w"]))
    assert refused.verdict is not Verdict.FOUND
    assert not refused.T_a_b.any()


def test_a_regular_constellation_is_refused() -> None:
    grid = np.stack(np.meshgrid(np.arange(6), np.arange(5)), axis=-1).reshape(-1, 2) * 3.0 + 0.7
    found = relative_pose(still_robot("a", grid), still_robot("b", grid, (2.0, 1.0, 0.3)))
    assert found.verdict in (Verdict.AMBIGUOUS, Verdict.BY_CHANCE)


def test_a_symmetric_constellation_is_ambiguous() -> None:
    half = 12 * np.random.default_rng(8).random((9, 2)) + (1.0, -6.0)
    points = np.concatenate([half, -half])  # half a turn brings all together as well
    found = relative_pose(still_robot("a", points), still_robot("b", points, (2.0, 1.0, 0.3)))
    assert found.verdict is Verdict.AMBIGUOUS
    assert found.support == found.runner_up == 18


def test_encounters_of_two_minds_are_ambiguous() -> None:
    """Half of the sightings are of somebody else, who stands 5 m beside."""
    track = np.column_stack([np.arange(12.0), np.sin(np.arange(12.0)), np.zeros(12)])
    robots = []
    seen = np.column_stack([track[:, 0], 4.0 + np.cos(track[:, 0])])
    seen[6:] += (3.0, 4.0)
    local = seen - track[:, :2]
    met = Encounters(np.arange(12), np.array(["b"] * 12), np.arange(12), np.hypot(*local.T),
                     np.arctan2(local[:, 1], local[:, 0]), np.diag([1e-4, 1e-4]))
    for name, own in (("a", track), ("b", np.column_stack([track[:, 0], np.cos(track[:, 0]), np.zeros(12)]))):
        graph = FactorGraph()
        graph.add_pose(SE2.from_array(own))
        graph.add(Between(np.arange(11), np.arange(1, 12), se2.between(own[:-1], own[1:]), sigmas=1e-3))
        robots.append(robot_graph(name, graph, encounters=met if name == "a" else None))
    assert relative_pose(*robots).verdict is Verdict.AMBIGUOUS


def test_three_anonymous_landmarks_may_be_chance() -> None:
    points = np.array([[5.0, 0.5], [3.0, 4.0], [-2.0, 6.0]])
    found = relative_pose(still_robot("a", points), still_robot("b", points, (1, 1, 1)))
    assert found.verdict is Verdict.BY_CHANCE


def test_one_displaced_identity_is_named() -> None:
    rng = np.random.default_rng(2)
    points, names = 20 * rng.random((8, 2)), [f"tag {k}" for k in range(8)]
    moved = points.copy()
    moved[[3, 5]] = moved[[5, 3]]
    with pytest.raises(InputError, match="disagree about identities: tag 3, tag 5 "):
        relative_pose(still_robot("a", points, identities=names), still_robot("b", moved, (1, 2, 3), names))
    with pytest.raises(InputError, match=r"disagree about identities: no relative pose"):
        relative_pose(still_robot("a", points, identities=names),
                      still_robot("b", 20 * rng.random((8, 2)), (1, 2, 3), names))


def test_encounters_alone_place_robots() -> None:
    runs, (a, b) = fleet(3, identified=0.0, reach=6.0)
    assert a.encounters is not None
    assert b.encounters is not None
    assert len(a.encounters) + len(b.encounters) > 5
    nobody = replace(a.landmarks, **{
        name: getattr(a.landmarks, name)[:0] for name in ("keys", "identities", "positions", "covariances", "sightings")
    })
    blind_a, blind_b = replace_landmarks(a, nobody), replace_landmarks(b, nobody)
    found = relative_pose(blind_a, blind_b)
    assert found.verdict is Verdict.FOUND
    assert len(found.common) == 0
    metres, degrees = error(runs, found.T_a_b)
    assert metres < 0.6
    assert degrees < 3.0


def test_a_mistaken_encounter_does_not_count() -> None:
    runs, (a, b) = fleet(3, identified=0.0, reach=6.0)
    met = a.encounters
    assert met is not None
    bearings = met.bearings.copy()
    bearings[0] += 2.0
    mistaken = Encounters(met.poses, met.others, met.other_poses, met.ranges, bearings, met.covariance)
    right, found = relative_pose(a, b), relative_pose(RobotGraph(a.name, a.solution, a.landmarks, mistaken), b)
    assert found.verdict is Verdict.FOUND
    assert found.support == right.support - 1
    assert error(runs, found.T_a_b)[0] < 0.6


def replace_landmarks(robot: RobotGraph, landmarks: object) -> RobotGraph:
    return RobotGraph(robot.name, robot.solution, landmarks, robot.encounters)  # type: ignore[arg-type] # a map in fact


def test_options_reach_the_search() -> None:
    _, (a, b) = fleet(1, identified=0.0)
    assert relative_pose(a, b, MergeOptions(log10_false_alarms=-300.0)).verdict is Verdict.BY_CHANCE
    assert relative_pose(a, b, MergeOptions(heading=1e-9)).verdict is Verdict.UNCERTAIN
    assert relative_pose(a, b, MergeOptions(minimum=1000)).verdict is Verdict.TOO_FEW


def test_two_landmarks_of_one_identity_in_one_robot() -> None:
    with pytest.raises(InputError, match="same identity: x"):
        still_robot("a", np.array([[5.0, 0.5], [3.0, 4.0]]), identities=["x", "x"])
