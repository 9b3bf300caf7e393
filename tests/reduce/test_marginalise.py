"""Marginalised graphs against dense linear algebra on the whole graph."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import clew
from clew.errors import InputError
from clew.factors import Between, PointObservation, Position, Prior, Range
from clew.geometry import SE2, SE3, Point2, Point3
from clew.graph import FactorGraph, Role
from clew.noise import Huber
from clew.reduce import fuse_parallel, marginalise
from clew.solve import Solution, optimize

KINDS = (SE2, SE3)


def wandering(kind: Any, count: int, rng: np.random.Generator) -> Any:
    """Poses that follow each other."""
    poses = [kind.identity()]
    for _ in range(count - 1):
        step = 0.5 * rng.standard_normal(kind.dim)
        step[0] += 1.0
        poses.append(poses[-1] @ kind.exp(step))
    return kind.from_array(np.stack([p.array for p in poses]))


def spd(dim: int, rng: np.random.Generator) -> np.ndarray:
    """A well conditioned information matrix."""
    a = rng.standard_normal((dim, dim))
    return np.asarray(100.0 * (a @ a.T / dim + np.eye(dim)))


def noisy_edge(kind: Any, poses: Any, i: int, j: int, rng: np.random.Generator, **more: Any) -> Between:
    seen = kind.from_array(poses.array[i]).between(kind.from_array(poses.array[j]))
    return Between(i, j, seen.retract(0.03 * rng.standard_normal(kind.dim)), information=spd(kind.dim, rng), **more)


def pose_graph(kind: Any, pairs: list[tuple[int, int]], seed: int = 0, constant: bool = True) -> FactorGraph:
    """At its optimum; the first pose holds still."""
    rng = np.random.default_rng(seed)
    poses = wandering(kind, 1 + max(max(p) for p in pairs), rng)
    graph = FactorGraph()
    graph.add_pose(kind.from_array(poses.array[0]), key=0, constant=constant)
    graph.add_pose(kind.from_array(poses.array[1:]), key=np.arange(1, len(poses.array)))
    for i, j in pairs:
        graph.add(noisy_edge(kind, poses, i, j, rng))
    assert optimize(graph, init="file", update=True).status.ok
    return graph


CHAIN = [(k, k + 1) for k in range(7)]
MESH = [*CHAIN, (0, 5), (1, 4), (2, 6), (1, 6), (3, 6), (0, 7)]


def joint(graph: FactorGraph, keys: list[int]) -> tuple[np.ndarray, Solution]:
    solution = optimize(graph, init="file")
    assert solution.status.ok
    return solution.joint_covariance(keys), solution


def divergence(kept: np.ndarray, approximation: np.ndarray) -> float:
    """Kullback-Leibler divergence of zero-mean Gaussians given by covariances."""
    ratio = np.linalg.solve(approximation, kept)
    return float(0.5 * (np.trace(ratio) - np.linalg.slogdet(ratio)[1] - len(kept)))


@pytest.mark.parametrize("kind", KINDS)
def test_dense_marginal_is_exact(kind: Any) -> None:
    graph = pose_graph(kind, MESH)
    rest = [1, 2, 5, 7]
    before, _ = joint(graph, rest)
    values = graph.values(rest).array
    found = marginalise(graph, [3, 6, 4], method="dense")
    after, solution = joint(found.graph, rest)
    np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-6 * abs(before).max())
    assert np.abs(solution.values(kind).local(graph.values(found.graph.keys()))).max() < 1e-6
    np.testing.assert_array_equal(graph.values(rest).array, values)
    assert found.information_loss == 0.0
    assert sorted(found.graph.keys()) == [0, 1, 2, 5, 7]
    assert sorted(graph.keys()) == list(range(8))  # a copy was changed


@pytest.mark.parametrize("kind", KINDS)
def test_a_chain_loses_nothing(kind: Any) -> None:
    graph = pose_graph(kind, CHAIN)
    before, _ = joint(graph, [3, 7])
    found = marginalise(graph, [1, 2, 5, 4, 6])
    assert found.information_loss < 1e-9
    assert found.graph.counts[Role.MARGINAL.value] == 2
    after, _ = joint(found.graph, [3, 7])
    np.testing.assert_allclose(after, before, rtol=1e-6, atol=1e-9 * abs(before).max())
    leaf = marginalise(found.graph, 7)
    assert sorted(leaf.graph.keys()) == [0, 3]
    np.testing.assert_allclose(joint(leaf.graph, [3])[0], before[: kind.dim, : kind.dim], rtol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("conservative", [False, True])
def test_loss_is_the_divergence_of_the_whole_graph(kind: Any, conservative: bool) -> None:
    star = [(0, 1), (1, 2), (1, 3), (1, 4), (5, 1)]
    graph = pose_graph(kind, star)
    rest = [2, 3, 4, 5]
    before, _ = joint(graph, rest)
    found = marginalise(graph, 1, conservative=conservative)
    after, solution = joint(found.graph, rest)
    assert found.losses[0] == pytest.approx(divergence(before, after), rel=1e-4)
    assert found.losses[0] > 0.1
    assert found.graph.factor_count == 4  # a tree
    assert np.abs(solution.values(kind).local(graph.values(found.graph.keys()))).max() < 1e-6
    excess = np.linalg.eigvals(np.linalg.solve(after, before)).real.max()
    assert (excess <= 1.0 + 1e-6) if conservative else (excess > 1.05)


def test_no_other_tree_is_nearer() -> None:
    graph = pose_graph(SE2, [(0, 1), (1, 2), (1, 3)], seed=3)
    before, _ = joint(graph, [2, 3])
    dense = marginalise(graph, 1, method="dense").graph
    best = marginalise(graph, 1).losses[0]
    losses = []
    for tree in ([(0, 2), (0, 3)], [(0, 2), (2, 3)], [(0, 3), (2, 3)]):
        other = dense.copy()
        for ids in list(other.block_ids()):
            other.remove(ids)
        _, solution = joint(dense, [2, 3])
        for a, b in tree:
            seen = graph.value(a).between(graph.value(b))
            # the marginal of this pair alone, from the dense graph with the other variable taken out
            pair = marginalise(dense, [k for k in (2, 3) if k not in (a, b)], method="dense").graph
            # seen from a pose that holds still, the tangent of b is that of the relative pose
            covariance = joint(pair, [b])[0] if a == 0 else relative_covariance(solution, graph, a, b)
            other.add(Between(a, b, seen, covariance=covariance))
        losses.append(divergence(before, joint(other, [2, 3])[0]))
    assert best == pytest.approx(min(losses), rel=1e-6)
    assert max(losses) > 1.05 * min(losses)


def relative_covariance(solution: Solution, graph: FactorGraph, a: int, b: int) -> np.ndarray:
    both = solution.joint_covariance([a, b])
    edge = Between(a, b, graph.value(a).between(graph.value(b)), sigmas=[1.0, 1.0, 1.0])
    by_a, by_b = edge.jacobians(graph.value(a).array[None], graph.value(b).array[None], measurement=edge.measurement)
    rows = np.concatenate([by_a[0], by_b[0]], axis=1)
    return np.asarray(rows @ both @ rows.T)


@pytest.mark.parametrize("method", ["tree", "dense"])
def test_tension_moves_the_measurement(method: str) -> None:
    """Two neighbours that other edges pull off: the marginal has its mean where the removed factors had it."""
    rng = np.random.default_rng(5)
    graph = FactorGraph()
    graph.add_pose(SE2.identity(), key=0, constant=True)
    for key in (1, 2):
        graph.add_pose(SE2.from_array(np.array([key, 0.2 * key, 0.1 * key])), key=key)
    first, second = SE2.from_array(np.array([1.0, 0.0, 0.1])), SE2.from_array(np.array([0.9, 0.1, -0.2]))
    graph.add(Between(0, 1, first, information=spd(3, rng)))
    graph.add(Between(1, 2, second, information=spd(3, rng)))
    pulled = (first @ second).retract(np.array([0.02, -0.03, 0.01]))
    graph.add(Between(0, 2, pulled, information=spd(3, rng), role=Role.LOOP))
    optimize(graph, init="file", update=True)
    found = marginalise(graph, 1, method=method).graph
    again = optimize(found, init="file")
    assert np.abs(again.values(SE2).local(graph.values([0, 2]))).max() < 1e-5
    (marginal,) = found.blocks(Role.MARGINAL)
    expected = (first @ second).array
    np.testing.assert_allclose(marginal.measurement[0], expected, atol=3e-3)


def landmark_graph(space: int) -> FactorGraph:
    kind: Any = SE2 if space == 2 else SE3
    point: Any = Point2 if space == 2 else Point3
    rng = np.random.default_rng(7)
    graph = pose_graph(kind, [(0, 1), (1, 2), (2, 3)], seed=2)
    places = rng.uniform(-3, 5, (3, space))
    graph.add_point(point.from_array(places), key=[10, 11, 12])
    for pose in (1, 2, 3):
        for landmark in (10, 11, 12):
            seen = graph.value(pose).inverse().act(point.from_array(places[landmark - 10]))
            noise = 0.02 * rng.standard_normal(space)
            graph.add(PointObservation(pose, landmark, seen.array + noise, information=spd(space, rng)))
    optimize(graph, init="file", update=True)
    return graph


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("key", [2, 11])
def test_landmarks(space: int, key: int) -> None:
    graph = landmark_graph(space)
    rest = [k for k in (1, 2, 3, 10, 11, 12) if k != key]
    before, _ = joint(graph, rest)
    exact = marginalise(graph, key, method="dense")
    np.testing.assert_allclose(joint(exact.graph, rest)[0], before, rtol=1e-5, atol=1e-8 * abs(before).max())
    sparse = marginalise(graph, key)
    after, _ = joint(sparse.graph, rest)
    # Other factors tie the neighbours, so that what is lost of one variable's is more than what the whole loses.
    assert 0.0 < divergence(before, after) < sparse.losses[0] + 1e-6
    ratio = np.diag(after) / np.diag(before)
    assert ratio.min() > 0.7
    assert ratio.max() < 2.0


def test_ties_to_the_world_are_kept() -> None:
    rng = np.random.default_rng(11)
    graph = pose_graph(SE2, CHAIN[:3], constant=False)
    graph.add(Prior(1, graph.value(1), information=spd(3, rng)))
    graph.add(Position(2, graph.value(2).array[:2], sigmas=[0.1, 0.1]))
    before, _ = joint(graph, [0, 3])
    exact = marginalise(graph, [1, 2], method="dense")
    np.testing.assert_allclose(joint(exact.graph, [0, 3])[0], before, rtol=1e-6)
    sparse = marginalise(graph, [1, 2])
    after, _ = joint(sparse.graph, [0, 3])
    ratio = np.diag(after) / np.diag(before)
    assert ratio.min() > 0.4
    assert ratio.max() < 2.5


def test_robust_weights_count() -> None:
    graph = pose_graph(SE2, CHAIN[:2])
    far = graph.value(0).between(graph.value(1)).retract(np.array([1.0, 0.0, 0.0]))
    graph.add(Between(0, 1, far, sigmas=[0.02, 0.02, 0.02], kernel=Huber(1.0), role=Role.LOOP))
    optimize(graph, init="file", update=True)
    before, _ = joint(graph, [2])
    found = marginalise(graph, 1)
    np.testing.assert_allclose(joint(found.graph, [2])[0], before, rtol=1e-6)


def test_what_would_lose_too_much_stays() -> None:
    graph = pose_graph(SE2, MESH)
    free = marginalise(graph, [3, 6])
    assert free.losses[0] > 0.0
    bound = 0.5 * (free.losses.min() + free.losses.max())
    found = marginalise(graph, [3, 6], most_loss=bound)
    assert len(found.kept) >= 1
    assert set(found.kept) | set(found.removed) == {3, 6}
    assert (found.losses <= bound).all()
    assert set(found.kept) <= set(found.graph.keys().tolist())


def test_update_changes_the_graph_itself() -> None:
    graph = pose_graph(SE2, CHAIN)
    assert marginalise(graph, 2, update=True).graph is graph
    assert 2 not in graph


def test_public_name() -> None:
    assert clew.marginalise is marginalise


@pytest.mark.parametrize(("keys", "options", "message"), [
    ([99], {}, "99"), ([0], {}, "held constant"), ([2, 2], {}, "twice"), ([2], {"method": "best"}, "tree or dense"),
])  # fmt: skip
def test_bad_requests(keys: list[int], options: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        marginalise(pose_graph(SE2, CHAIN), keys, **options)  # type: ignore[arg-type]


def test_a_pose_among_landmarks_alone_is_refused() -> None:
    graph = FactorGraph()
    graph.add_pose(SE2.identity(), key=0)
    graph.add_point([1.0, 0.0], key=1)
    graph.add_point([0.0, 1.0], key=2)
    for landmark in (1, 2):
        graph.add(Range(0, landmark, 1.0, sigmas=[0.1]))
    with pytest.raises(InputError, match="landmarks"):
        marginalise(graph, 0)


@pytest.mark.parametrize("kind", KINDS)
def test_parallel_edges_fuse(kind: Any) -> None:
    graph = pose_graph(kind, CHAIN[:2])
    rng = np.random.default_rng(1)
    for _ in range(3):
        graph.add(noisy_edge(kind, graph.values([0, 1, 2]), 1, 2, rng, role=Role.MARGINAL))
    graph.add(noisy_edge(kind, graph.values([0, 1, 2]), 0, 2, rng, role=Role.MARGINAL))
    optimize(graph, init="file", update=True)
    before, _ = joint(graph, [1, 2])
    assert fuse_parallel(graph) == 2
    assert graph.factor_count == 4
    after, solution = joint(graph, [1, 2])
    # up to second order in a disagreement of some 0.05
    np.testing.assert_allclose(after, before, rtol=0.02, atol=0.02 * np.abs(before).max())
    assert np.abs(solution.values(kind).local(graph.values([0, 1, 2]))).max() < 2e-3
    assert fuse_parallel(graph) == 0


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("reuse", [0.3, 1e3])
def test_edges_that_are_there_already_are_used_again_at_a_bounded_loss(kind: Any, reuse: float) -> None:
    """A hub that all see goes; edges of an earlier tree tie its neighbours, where another has its place."""
    rng = np.random.default_rng(3)
    graph = pose_graph(kind, [(0, k) for k in range(1, 7)], seed=3, constant=False)
    poses = graph.values(range(7))
    for i, j in ((1, 4), (2, 4), (2, 6), (3, 6), (3, 5)):
        graph.add(noisy_edge(kind, poses, i, j, rng, role=Role.MARGINAL))
    graph.add(Prior(1, kind.from_array(poses.array[1]), information=np.eye(kind.dim)))
    best = marginalise(graph, 0)
    spared = marginalise(graph, 0, reuse=reuse)
    edges = 5
    assert best.information_loss <= spared.information_loss <= best.information_loss + edges * reuse
    fuse_parallel(spared.graph)
    fuse_parallel(best.graph)
    assert spared.graph.counts["marginal"] <= best.graph.counts["marginal"]
    if reuse == 1e3:
        assert spared.graph.counts["marginal"] == edges
        assert best.graph.counts["marginal"] > edges
