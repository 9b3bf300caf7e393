"""Initial guesses: exact on exact data, in every direction of the edges, and the best of them is taken."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import clew
from clew import _native
from clew.geometry import so3
from clew.solve import Status
from solve.worlds import turned_sphere


def exact_world(kind: Any, seed: int) -> tuple[clew.FactorGraph, Any, Any]:
    """Poses and landmarks with exact measurements between them, and values that say nothing."""
    generator = np.random.default_rng(seed)
    truth = kind.exp(np.pi * generator.standard_normal((12, kind.dim)) / 2)
    points = generator.standard_normal((4, kind.space))
    graph = clew.FactorGraph()
    keys = graph.add_pose(kind.identity((12,)), key=100 - np.arange(12))
    a = np.concatenate([np.arange(11), generator.integers(0, 12, 8)])
    b = np.concatenate([np.arange(1, 12), generator.integers(0, 12, 8)])
    turn = generator.random(len(a)) < 0.5
    a, b = np.where(turn, b, a)[a != b], np.where(turn, a, b)[a != b]
    graph.add(clew.Prior(keys[3], truth[3], sigmas=0.1))
    graph.add(clew.Between(keys[a], keys[b], truth[a].between(truth[b]), sigmas=0.1))
    landmarks = graph.add_point(np.zeros((4, kind.space)))
    sensor = kind.exp(generator.standard_normal(kind.dim))
    seen = truth[:4].compose(sensor).inverse().act(points)
    graph.add(clew.PointObservation(keys[:4], landmarks, seen, sigmas=0.1, T_robot_sensor=sensor))
    return graph, truth, points


@pytest.mark.parametrize("kind", [clew.SE2, clew.SE3])
@pytest.mark.parametrize("init", ["tree", "rotation", "joint", "auto"])
@pytest.mark.parametrize("seed", range(5))
def test_exact_measurements_give_exact_guesses(kind: Any, init: str, seed: int) -> None:
    graph, truth, points = exact_world(kind, seed)
    solution = clew.optimize(graph, init=init, max_iterations=0)
    assert solution.chi2_initial == pytest.approx(0.0, abs=1e-15)
    assert np.abs(truth.local(solution.values(kind))).max() < 1e-9
    point = clew.Point2 if kind is clew.SE2 else clew.Point3
    np.testing.assert_allclose(solution.values(point).array, points, atol=1e-9)


@pytest.mark.parametrize("kind", [clew.SE2, clew.SE3])
@pytest.mark.parametrize("init", ["rotation", "joint"])
def test_guesses_meet_several_known_poses(kind: Any, init: str) -> None:
    graph, truth, _ = exact_world(kind, 1)
    known = graph.keys(kind)[[2, 7]]
    graph.set_values(known, truth[[2, 7]])
    graph.set_constant(known)
    solution = clew.optimize(graph, init=init, max_iterations=0)
    assert solution.init == init
    assert np.abs(truth.local(solution.values(kind))).max() < 1e-9
    given = graph.values(kind)[[2, 7]].array
    np.testing.assert_array_equal(solution.values(kind)[[2, 7]].array, given)  # constant to the last bit


@pytest.mark.parametrize("init", ["tree", "rotation", "joint", "auto"])
def test_guesses_of_landmarks_alone(init: str) -> None:
    """All poses are held, and what they see contradicts itself."""
    graph, _, _ = exact_world(clew.SE2, 1)
    keys, point = graph.keys(clew.SE2), graph.add_point([5.0, 5.0])
    graph.set_constant(keys)
    graph.add(clew.PointObservation(keys[:3], np.repeat(point, 3), [[1.0, 2.0], [9.0, -3.0], [4.0, 4.0]], sigmas=0.01))
    solution = clew.optimize(graph, init=init)
    assert solution.status is Status.CONVERGED
    np.testing.assert_array_equal(solution.values(clew.SE2).array, graph.values(clew.SE2).array)


def test_auto_keeps_current_values_that_are_better() -> None:
    graph, _, _ = exact_world(clew.SE2, 0)
    clew.optimize(graph, update=True)
    loop = clew.Between(100, 95, clew.SE2(1, 2, 3), sigmas=1.0)
    graph.add(loop)
    solved = clew.optimize(graph, update=True)
    again = clew.optimize(graph)
    assert again.init == "file"
    assert again.chi2_initial == pytest.approx(solved.chi2)


def test_guesses_fall_back_where_a_graph_does_not_admit_them() -> None:
    graph = clew.FactorGraph()
    point = graph.add_point((5.0, 5.0))
    graph.add(clew.Prior(point, clew.Point2(1, 1), sigmas=1.0))
    for init in ("tree", "rotation", "auto"):
        solution = clew.optimize(graph, init=init)
        assert solution.init == "file"
        assert solution.status is Status.CONVERGED


def test_with_a_robust_kernel_the_tree_trusts_odometry() -> None:
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE2.identity((6,)))
    graph.add(clew.Between(0, 5, clew.SE2(-50, 0, 1), sigmas=0.1, role="loop"))
    graph.add(clew.Between(keys[:-1], keys[1:], clew.SE2(1, 0, 0), sigmas=0.1))
    x = clew.optimize(graph, init="tree", robust=clew.Cauchy(), max_iterations=0).values().array[:, 0]
    np.testing.assert_allclose(x, np.arange(6.0))
    assert clew.optimize(graph, init="tree", max_iterations=0).values().array[5, 0] == -50


@pytest.mark.parametrize("robust", [None, clew.Cauchy()])
def test_the_tree_of_known_poses_needs_no_odometry(robust: Any) -> None:
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE2([0.0, 1.0], [0.0, 0.0], [0.0, 0.0]), constant=True)
    tree = graph.add_point((5.0, 5.0))
    graph.add(clew.Between(*keys, clew.SE2(1.1, 0, 0), sigmas=0.1, role="loop"))
    graph.add(clew.RangeBearing(keys[1], tree, range=2.0, bearing=np.pi / 2, sigmas=(0.1, 0.01)))
    solution = clew.optimize(graph, init="tree", robust=robust)
    assert solution.init == "tree"
    np.testing.assert_allclose(solution.value(tree).array, [1.0, 2.0], atol=1e-9)


def test_spanning_forest_by_hand() -> None:
    i, j = np.array([0, 1, 3, 4]), np.array([1, 2, 2, 5])
    none = np.empty(0, np.int64)
    node, parent, edge, forward, component = _native.solve.spanning_forest(7, i, j, none)
    assert node.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert parent.tolist() == [-1, 0, 1, 2, -1, 4, -1]
    assert edge.tolist() == [-1, 0, 1, 2, -1, 3, -1]
    assert forward.tolist() == [1, 1, 1, 0, 1, 1, 1]
    assert component.tolist() == [0, 0, 0, 0, 1, 1, 2]
    seeded = _native.solve.spanning_forest(4, i[:3], j[:3], np.array([3]))
    assert seeded[0].tolist() == [3, 2, 1, 0]
    with pytest.raises(ValueError, match="does not exist"):
        _native.solve.spanning_forest(3, i, j, none)


def lap_world(laps: int) -> tuple[clew.FactorGraph, float]:
    """Laps around a field with two rows of trees, the gyroscope drifting; and the cost of the truth."""
    generator = np.random.default_rng(3)
    count = 400 * laps
    truth = clew.SE2.identity()
    step = clew.SE2(1.0, 0.0, 2 * np.pi / 400)
    path = [truth]
    for _ in range(count - 1):
        path.append(path[-1].compose(step))
    truth = clew.SE2.from_array(np.stack([pose.array for pose in path]))
    trees = np.array([0.0, 64.0]) + generator.uniform(-90, 90, (40, 2))
    drift = np.array([0.0, 0.0, 0.012])  # the odometry's noise is all of one sign
    odometry = truth[:-1].between(truth[1:]).retract(np.broadcast_to(drift, (count - 1, 3)))
    seer = np.arange(0, count, 10)
    distance = np.linalg.norm(truth.array[seer, None, :2] - trees, axis=2)
    pose, tree = np.nonzero(distance < 25)
    seen = truth[seer[pose]].inverse().act(trees[tree]) + 0.02 * generator.standard_normal((len(pose), 2))
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE2.identity((count,)))
    landmarks = graph.add_point(np.zeros((40, 2)))
    graph.add(clew.Between(keys[:-1], keys[1:], odometry, sigmas=(0.02, 0.02, 0.015)))
    graph.add(clew.PointObservation(keys[seer[pose]], landmarks[tree], seen, sigmas=0.05))
    known = graph.copy()
    known.set_values(keys, truth)
    known.set_values(landmarks, trees)
    return graph, clew.optimize(known, init="file").chi2


def test_a_graph_that_grows_finds_the_minimum_that_bent_odometry_misses() -> None:
    graph, best = lap_world(2)
    assert clew.optimize(graph, init="tree").chi2 > 2 * best
    for init in ("sequential", "auto"):
        solution = clew.optimize(graph, init=init)
        assert solution.status is Status.CONVERGED
        assert solution.init == "sequential"
        assert solution.chi2 == pytest.approx(best, rel=1e-6)
    guess = clew.optimize(graph, init="sequential", max_iterations=0)
    assert guess.chi2_initial < 1.1 * best


def test_a_graph_that_grows_uses_a_map_that_is_given() -> None:
    graph, _ = lap_world(1)
    solved = clew.optimize(graph, init="sequential")
    graph.set_values(graph.keys(clew.Point2), solved.values(clew.Point2))
    graph.set_constant(graph.keys(clew.Point2))
    guess = clew.optimize(graph, init="sequential", max_iterations=0)
    assert guess.chi2_initial < 1.1 * solved.chi2


@pytest.mark.parametrize(("shape", "sigmas", "seed"), [((10, 20), (0.5, 0.5), 2), ((10, 12), (0.1, 0.5), 0)])
def test_rotations_and_translations_at_once_where_rotations_first_end_badly(
    shape: tuple[int, int], sigmas: tuple[float, float], seed: int
) -> None:
    graph, best = turned_sphere(*shape, sigmas, seed)
    assert clew.optimize(graph, init="rotation").chi2 > 1.3 * best
    solution = clew.optimize(graph)
    assert solution.status is Status.CONVERGED
    assert solution.init == "joint"
    assert solution.chi2 < 1.08 * best
    assert clew.optimize(graph, init="joint", max_iterations=0).init == "joint"


def test_nearest_rotations_against_the_singular_value_decomposition() -> None:
    """Noisy rotations, arbitrary matrices of either sign, nearly singular ones, and rotations by pi."""
    rng = np.random.default_rng(0)
    exact = so3.matrix(so3.exp(np.concatenate([rng.normal(size=(50, 3)), np.pi * np.eye(3)])))
    noisy = exact[:, None] + rng.normal(size=(1, 8, 3, 3)) * np.geomspace(1e-15, 0.3, 8)[:, None, None]
    flat = rng.normal(size=(30, 3, 2)) @ rng.normal(size=(30, 2, 3)) + 1e-9 * rng.normal(size=(30, 3, 3))
    matrices = np.concatenate([noisy.reshape(-1, 3, 3), rng.normal(size=(300, 3, 3)), 1e-200 * exact, flat])
    found = np.empty((len(matrices), 4))
    _native.solve.nearest_rotations(matrices, found)
    left, sizes, right = np.linalg.svd(matrices)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    unique = sizes[:, 1] + np.sign(np.linalg.det(matrices)) * sizes[:, 2] > 1e-3 * sizes[:, 0]
    assert unique.sum() > 0.9 * len(unique)
    np.testing.assert_allclose(so3.matrix(found)[unique], (left @ right)[unique], atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-14)
    assert (found[:, 3] >= 0).all()


def test_nearest_rotations_of_what_is_no_matrix() -> None:
    found = np.empty((3, 4))
    _native.solve.nearest_rotations(np.array([0.0, np.nan, np.inf])[:, None, None] * np.ones((3, 3)), found)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    with pytest.raises(ValueError, match="3, 3"):
        _native.solve.nearest_rotations(np.zeros((2, 3, 2)), found)
    with pytest.raises(ValueError, match="out"):
        _native.solve.nearest_rotations(np.zeros((2, 3, 3)), found)
