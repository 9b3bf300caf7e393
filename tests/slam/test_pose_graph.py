"""The graph of keyframes against dense computations."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.geometry import SE2, se2
from clew.place import Closure, Verdict
from clew.scan import ScanPoints
from clew.slam.keyframes import Keyframe
from clew.slam.pose_graph import FACTORISE_AFTER, PoseGraph, chi2

Array = NDArray[np.float64]
Edges = list[tuple[int, int, Array, Array]]
NOTHING = ScanPoints(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))


def random_information(rng: np.random.Generator) -> Array:
    root = rng.normal(size=(3, 3)) + 3 * np.eye(3)
    return root @ root.T * np.array([[400.0]])


def built(seed: int, count: int, closures: list[tuple[int, int]]) -> tuple[PoseGraph, Edges]:
    """A graph of keyframes with full informations whose closures agree, and all its edges."""
    rng = np.random.default_rng(seed)
    graph, edges = PoseGraph(10.0), []
    for k in range(count):
        step = np.zeros(3) if k == 0 else np.array([0.5, 0.05, 0.2]) + rng.normal(0, 0.05, 3)
        information = np.zeros((3, 3)) if k == 0 else random_information(rng)
        graph.add_keyframe(Keyframe(float(k), NOTHING, np.zeros(3), np.zeros(3), 0.5 * k, step, information))
        if k:
            edges.append((k - 1, k, step, information))
    for target, source in closures:
        T = se2.between(graph.poses[target], graph.poses[source])
        information = random_information(rng)
        graph.add_closure(Closure(source, target, 1.0, Verdict.CONFIRMED, T, information), information)
        edges.append((target, source, T, information))
    return graph, edges


def dense_covariance(poses: Array, edges: Edges) -> Array:
    """``(3 K, 3 K)`` inverse of the Hessian with numeric Jacobians, the first keyframe certain."""
    size = 3 * len(poses)
    hessian = np.zeros((size, size))
    for a, b, T, information in edges:
        jacobian = np.zeros((3, size))
        for row, key in ((0, a), (1, b)):
            for axis in range(3):
                ends = []
                for sign in (1, -1):
                    pair = [poses[a], poses[b]]
                    pair[row] = se2.retract(pair[row], sign * 1e-6 * np.eye(3)[axis])
                    ends.append(se2.between(T, se2.between(*pair)))
                jacobian[:, 3 * key + axis] = (ends[0] - ends[1]) / 2e-6
        hessian += jacobian.T @ information @ jacobian
    covariance = np.zeros((size, size))
    covariance[3:, 3:] = np.linalg.inv(hessian[3:, 3:])
    return covariance


def dense_relative(poses: Array, covariance: Array, target: int, source: int) -> Array:
    """Covariance of the source seen from the target, in the source's tangent, by numeric Jacobians."""
    jacobian = np.zeros((3, covariance.shape[0]))
    here = se2.between(poses[target], poses[source])
    for key in (target, source):
        for axis in range(3):
            ends = []
            for sign in (1, -1):
                pair = {target: poses[target], source: poses[source]}
                pair[key] = se2.retract(pair[key], sign * 1e-6 * np.eye(3)[axis])
                ends.append(se2.local(here, se2.between(pair[target], pair[source])))
            jacobian[:, 3 * key + axis] = (ends[0] - ends[1]) / 2e-6
    return jacobian @ covariance @ jacobian.T


@pytest.mark.parametrize("closures", [[], [(0, 9)], [(0, 9), (2, 11), (1, 6)]], ids=["chain", "one", "three"])
@pytest.mark.parametrize("seed", [0, 1])
def test_relative_covariances_are_the_dense_ones(seed: int, closures: list[tuple[int, int]]) -> None:
    graph, edges = built(seed, 12, closures)
    targets = np.array([0, 3, 4, 7])
    actual = graph.relative_covariances(11, targets)
    covariance = dense_covariance(graph.poses, edges)
    for target, of_target in zip(targets, actual, strict=True):
        expected = dense_relative(graph.poses, covariance, int(target), 11)
        np.testing.assert_allclose(of_target, expected, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("later", [1, 4, FACTORISE_AFTER + 3])
def test_uncertainty_is_carried_on_over_keyframes_that_came_after_the_solution(later: int) -> None:
    graph, edges = built(5, 12, [(1, 10)])
    graph.relative_covariances(11, np.array([2]))
    rng = np.random.default_rng(9)
    for k in range(12, 12 + later):
        step, information = np.array([0.4, -0.1, 0.3]), random_information(rng)
        graph.add_keyframe(Keyframe(float(k), NOTHING, np.zeros(3), np.zeros(3), 0.5 * k, step, information))
        edges.append((k - 1, k, step, information))
    source, targets = 11 + later, np.array([0, 5])
    actual = graph.relative_covariances(source, targets)
    covariance = dense_covariance(graph.poses, edges)
    for target, of_target in zip(targets, actual, strict=True):
        expected = dense_relative(graph.poses, covariance, int(target), source)
        np.testing.assert_allclose(of_target, expected, rtol=1e-4, atol=1e-9)


def test_chi2_is_the_plain_sum_and_the_optimum_its_least() -> None:
    graph, edges = built(2, 10, [(0, 8), (2, 9)])
    assert chi2(graph.graph) == pytest.approx(0.0, abs=1e-9)
    graph.add_closure(Closure(7, 1, 1.0, Verdict.CONFIRMED, se2.compose(
        se2.between(graph.poses[1], graph.poses[7]), np.array([0.02, -0.01, 0.005])), np.eye(3)), 50 * np.eye(3))
    edges.append((1, 7, se2.compose(se2.between(graph.poses[1], graph.poses[7]), np.array([0.02, -0.01, 0.005])),
                  50 * np.eye(3)))

    def plain(poses: Array) -> float:
        total = 0.0
        for a, b, T, information in edges:
            e = se2.between(T, se2.between(poses[a], poses[b]))
            total += float(e @ information @ e)
        return total

    assert chi2(graph.graph) == pytest.approx(plain(graph.poses))
    graph.optimise()
    best = graph.poses.copy()
    assert chi2(graph.graph) == pytest.approx(plain(best))
    for seed in range(20):
        moved = se2.retract(best, np.vstack([np.zeros((1, 3)), np.random.default_rng(seed).normal(0, 1e-3, (9, 3))]))
        assert plain(moved) > plain(best)
    np.testing.assert_array_equal(best[0], np.zeros(3))


def test_removed_closure_leaves_the_graph_as_it_was() -> None:
    graph, _ = built(3, 8, [])
    graph.optimise()
    before = graph.poses.copy()
    T = se2.compose(se2.between(before[0], before[7]), np.array([0.02, 0.0, 0.0]))
    wrong = Closure(7, 0, 1.0, Verdict.CONFIRMED, T, np.eye(3))
    factor = graph.add_closure(wrong, 1e4 * np.eye(3))
    graph.optimise()
    assert np.abs(graph.poses - before).max() > 0.001
    graph.remove(factor)
    graph.optimise()
    np.testing.assert_allclose(graph.poses, before, atol=1e-6)


def test_poses_are_those_of_the_graph_whatever_happened() -> None:
    graph, _ = built(4, 6, [(0, 5)])
    for act in (graph.optimise, lambda: graph.set_poses(graph.poses + 0.01)):
        act()
        np.testing.assert_array_equal(graph.poses, graph.graph.values(SE2).array)
    taken = graph.poses
    copy = taken.copy()
    graph.set_poses(taken + 1.0)
    np.testing.assert_array_equal(taken, copy)


def test_the_index_of_keyframes_follows_them_when_they_move() -> None:
    graph, _ = built(4, 30, [])
    moved = se2.compose(np.array([40.0, -7.0, 1.0]), graph.poses)
    graph.set_poses(moved)
    everywhere = np.arange(30)
    found = graph.near.nearest(moved[12, :2], 1, lambda numbers: np.isin(numbers, everywhere))
    assert found.tolist() == [12]
    assert len(graph.near.within(np.zeros(2), 5.0)) == 0
