"""Graphs that the measurements do not determine: the status says so, the diagnosis names who and where."""

from __future__ import annotations

import numpy as np
import pytest

import clew
from clew.errors import InputError
from clew.solve import Status

METHODS = ["levenberg-marquardt", "gauss-newton", "dogleg"]


def tied() -> tuple[clew.FactorGraph, int]:
    graph = clew.FactorGraph()
    pose = graph.add_pose(clew.SE2(1, 2, 0))
    graph.add(clew.Prior(pose, clew.SE2(1, 2, 0), sigmas=0.1))
    return graph, pose


@pytest.mark.parametrize("method", METHODS)
def test_a_landmark_seen_once_by_bearing_only(method: str) -> None:
    graph, pose = tied()
    good = graph.add_point((2.0, 2.0))
    graph.add(clew.RangeBearing(pose, good, 1.0, 0.1, sigmas=0.1))
    bad = graph.add_point((1.0, 5.0))
    graph.add(clew.Bearing(pose, bad, np.pi / 2, sigmas=0.1))
    solution = clew.optimize(graph, method=method)
    assert solution.status is Status.UNDERCONSTRAINED
    assert not solution.status.ok
    text = "\n".join(solution.diagnosis)
    assert (
        f"Landmark {bad} (Point2) is free along y: it has 2 coordinates, but 1 factor with 1 number" in text
    )
    assert f"Landmark {good}" not in text
    assert "Free directions in all: 1." in text
    assert np.isfinite(solution.values(clew.Point2).array).all()
    with pytest.raises(InputError, match="free to move"):
        solution.covariance(bad)


def test_two_bearings_determine_it() -> None:
    graph, pose = tied()
    other = graph.add_pose(clew.SE2(3, 2, 0))
    graph.add(clew.Prior(other, clew.SE2(3, 2, 0), sigmas=0.1))
    tree = graph.add_point((2.0, 4.5))
    graph.add(clew.Bearing([pose, other], tree, [np.pi / 4, 3 * np.pi / 4], sigmas=0.1))
    solution = clew.optimize(graph)
    assert solution.status is Status.CONVERGED
    assert solution.diagnosis == ()
    np.testing.assert_allclose(solution.value(tree).array, (2, 3), atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_pose_tied_with_information_on_one_axis_only(method: str) -> None:
    graph, pose = tied()
    loose = graph.add_pose(clew.SE2(2, 2, 0))
    graph.add(clew.Between(pose, loose, clew.SE2(1, 0, 0), information=np.diag([0.0, 4.0, 0.0])))
    solution = clew.optimize(graph, method=method)
    assert solution.status is Status.UNDERCONSTRAINED
    assert f"Pose {loose} (SE2) is free along" in "\n".join(solution.diagnosis)
    assert "Free directions in all: 2." in solution.diagnosis


def test_unconnected_parts_are_held_each_and_named() -> None:
    graph, _ = tied()
    island = graph.add_pose(clew.SE2.from_array([(5, 5, 0), (6, 5.5, 0.2)]), key=[70, 71])
    graph.add(clew.Between(island[0], island[1], clew.SE2(1, 0, 0), sigmas=0.1))
    lonely = graph.add_point((7.0, 7.0))
    solution = clew.optimize(graph)
    assert solution.status is Status.CONVERGED
    assert [(part.anchor, part.size, part.held) for part in solution.free_parts] == [
        (70, 2, True),
        (lonely, 1, True),
    ]
    assert "Nothing ties 2 variables around key 70" in str(solution)
    np.testing.assert_allclose(solution.value(71).array, (6, 5, 0), atol=1e-9)
    assert np.array_equal(solution.value(lonely).array, (7, 7))


def test_one_position_leaves_the_heading_and_two_do_not() -> None:
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE2.identity((3,)))
    graph.add(clew.Between(keys[:-1], keys[1:], clew.SE2(1, 0, 0), sigmas=0.1))
    graph.add(clew.Position(keys[0], (0.0, 0.0), sigmas=0.1))
    solution = clew.optimize(graph)
    assert solution.status is Status.UNDERCONSTRAINED
    assert "Nothing fixes the heading of 3 variables" in str(solution)
    graph.add(clew.Position(keys[2], (0.0, 2.0), sigmas=0.1))
    solution = clew.optimize(graph)
    assert solution.status is Status.CONVERGED
    assert solution.diagnosis == ()
    np.testing.assert_allclose(solution.values(clew.SE2).array[:, 2], np.pi / 2, atol=1e-6)


def test_in_space_gravity_alone_is_not_enough() -> None:
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE3.identity((2,)))
    graph.add(clew.Between(keys[0], keys[1], clew.SE3.exp([1, 0, 0, 0, 0, 0.1]), sigmas=0.1))
    assert clew.optimize(graph).status is Status.CONVERGED  # nothing ties it: held
    # position, roll and pitch are known, yaw is not
    graph.add(clew.Prior(keys[0], clew.SE3.identity(), information=np.diag([1, 1, 1, 1, 1, 0.0])))
    solution = clew.optimize(graph)
    assert solution.status is Status.UNDERCONSTRAINED
    assert "Nothing fixes the rotation about z" in str(solution)


def test_many_free_landmarks_are_summed_up() -> None:
    graph, pose = tied()
    points = graph.add_point(np.stack([np.arange(30.0) + 2, np.full(30, 4.0)], axis=1))
    graph.add(clew.Range(pose, points, np.arange(30.0) + 2, sigmas=0.1))
    solution = clew.optimize(graph)
    assert solution.status is Status.UNDERCONSTRAINED
    assert sum("Landmark" in sentence for sentence in solution.diagnosis) == 5
    assert "25 more variables like these" in "\n".join(solution.diagnosis)
    assert "at least 8" in solution.diagnosis[-1]


def test_infinite_cost_is_a_status() -> None:
    graph, pose = tied()
    graph.add(clew.CustomFactor([pose], lambda x: np.exp(1e4 * x[:, :1]), kinds=[clew.SE2], sigmas=1.0))
    with np.errstate(over="ignore", invalid="ignore"):
        solution = clew.optimize(graph)
    assert solution.status is Status.NOT_FINITE
    assert np.isfinite(solution.values().array).all()
