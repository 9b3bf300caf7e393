"""Landmarks that prove to be two, against solving the graph again with both."""

from __future__ import annotations

import numpy as np
import pytest

from clew.factors import Between, PointObservation
from clew.geometry import SE2, Point2, se2
from clew.graph import FactorGraph
from clew.slam.landmarks.split import _most_apart, _scores, two_in_one
from clew.solve import Solution, optimize

LANDMARK, OTHER, POSTS, POSES, SIGMA = 1000, 1001, 1010, 80, 0.05
LANDMARKS = np.array([[3.0, 2.0], [9.0, -2.0], [15.0, 2.0], [19.0, -3.0]])


def drive(offset: float, seed: int = 0) -> tuple[FactorGraph, PointObservation, np.ndarray]:
    """A robot that drives to and fro past posts and one tree, which on every other visit is another, `offset` away."""
    rng = np.random.default_rng(seed)
    x = np.abs((np.arange(POSES) + 20.0) % 40.0 - 20.0)
    poses = np.column_stack([x, np.zeros(POSES), np.zeros(POSES)])
    graph = FactorGraph()
    graph.add_pose(SE2.from_array(poses), key=np.arange(POSES))
    graph.set_constant(0)
    graph.add_point(np.array([10.0, 3.0]), key=LANDMARK)
    graph.add_point(LANDMARKS, key=POSTS + np.arange(len(LANDMARKS)))
    step = se2.between(poses[:-1], poses[1:]) + 0.05 * rng.standard_normal((POSES - 1, 3)) * [1.0, 1.0, 0.1]
    keys = np.arange(POSES)
    graph.add(Between(keys[:-1], keys[1:], step, sigmas=[0.05, 0.05, 0.005]))
    rows, points, second = [], [], []
    for k in range(POSES):
        for key, point in zip(POSTS + np.arange(len(LANDMARKS)), LANDMARKS, strict=True):
            if abs(point[0] - x[k]) < 4.0:
                rows.append((k, key))
                points.append(point)
                second.append(False)
        if abs(10.0 - x[k]) < 2.5:
            other = (k // 20) % 2 == 1
            rows.append((k, LANDMARK))
            points.append(np.array([10.0 + offset * other, 3.0]))
            second.append(other)
    pose, target = np.array(rows).T
    z = se2.act(se2.inverse(poses[pose]), np.array(points)) + SIGMA * rng.standard_normal((len(rows), 2))
    seen = PointObservation(pose, target, z, sigmas=[SIGMA, SIGMA])
    graph.add(seen)
    return graph, seen, np.array(second)


def solved(graph: FactorGraph) -> Solution:
    return optimize(graph, init="file")


def test_two_trees_are_told_apart_by_the_visits_they_were_seen_on() -> None:
    graph, seen, second = drive(0.3)
    (rows,) = two_in_one(solved(graph), seen)
    first = (seen.keys[:, 1] == LANDMARK) & ~second
    assert set(rows.tolist()) in (set(np.flatnonzero(second)), set(np.flatnonzero(first)))


@pytest.mark.parametrize("seed", range(5))
def test_one_tree_stays_one(seed: int) -> None:
    graph, seen, _ = drive(0.0, seed)
    assert two_in_one(solved(graph), seen) == []


def test_chi2_falls_by_what_was_foretold() -> None:
    graph, seen, second = drive(0.3, 1)
    solution = solved(graph)
    rows = np.flatnonzero(seen.keys[:, 1] == LANDMARK)
    place = seen.keys[rows, 0]
    visit = np.cumsum(np.append(0, np.diff(place) > 10))
    score, spread = _scores(solution, seen, rows, visit)
    _, _, fall = _most_apart(score, spread)
    graph.add_point(np.array([10.0, 3.0]), key=OTHER)
    keys = seen.keys.copy()
    keys[second, 1] = OTHER
    graph.remove(np.concatenate(list(graph.block_ids("observation"))))
    graph.add(PointObservation(keys[:, 0], keys[:, 1], seen.measurement, information=seen.information))
    again = solved(graph)
    assert len(again.keys(Point2)) == len(LANDMARKS) + 2
    assert fall == pytest.approx(solution.chi2 - again.chi2, rel=0.05)
    assert fall > 40.0
