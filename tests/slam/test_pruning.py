"""Keyframes that are taken out leave trajectory, graph and map as good as they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from clew.geometry import SE2, se2
from clew.scan import LaserScan, extract_points
from clew.slam import Slam, SlamConfig
from clew.slam.attachments import Attachments
from clew.slam.keyframes import Keyframe, KeyframeStore
from clew.slam.pose_graph import PoseGraph
from clew.slam.pruning import Pruner
from slam.drives import errors, measurements, round_trip, truth_of
from slam.test_pose_graph import built

Array = NDArray[np.float64]

#: So that a drive of two rounds has something to prune.
EAGER = replace(SlamConfig().pruning, cover=3, path=6.0, recent=22)


def driven(*, enabled: bool) -> Slam:
    slam = Slam(replace(SlamConfig(), pruning=replace(EAGER, enabled=enabled)))
    log = round_trip()
    for measurement in measurements(log, 0, log.scan_count):
        slam.add(measurement)
    slam.optimise()
    return slam


@pytest.fixture(scope="module")
def pruned() -> Slam:
    return driven(enabled=True)


@pytest.fixture(scope="module")
def whole() -> Slam:
    return driven(enabled=False)


def test_keyframes_go_and_the_trajectory_stays(pruned: Slam, whole: Slam) -> None:
    log = round_trip()
    taken = len(whole.keyframes)
    assert whole.pruned.keyframes == 0
    assert pruned.pruned.keyframes > 0.15 * taken
    assert len(pruned.every_keyframe) == len(pruned.keyframes) + pruned.pruned.keyframes
    assert len(pruned.trajectory) == log.scan_count
    error, turn = errors(pruned.trajectory.T_world_robot, truth_of(log))
    before, turn_before = errors(whole.trajectory.T_world_robot, truth_of(log))
    assert np.sqrt(np.mean(error**2)) < np.sqrt(np.mean(before**2)) + 0.01
    assert error.max() < before.max() + 0.02
    assert turn.max() < turn_before.max() + np.radians(0.5)


def test_the_graph_holds_those_that_are_left(pruned: Slam) -> None:
    keys = pruned.graph.keys(SE2)
    np.testing.assert_array_equal(pruned.graph.values(SE2).array, pruned.keyframes.T_world_robot)
    np.testing.assert_array_equal(pruned.every_keyframe.timestamps[keys], pruned.keyframes.timestamps)
    np.testing.assert_array_equal(pruned.every_keyframe.T_world_robot[keys], pruned.keyframes.T_world_robot)
    assert 0 in pruned.graph
    counts = pruned.graph.counts
    assert counts["marginal"] > 0
    assert pruned.graph.factor_count < 3 * len(pruned.graph)
    assert 0.0 < pruned.pruned.information_loss_nats < 10.0 * pruned.pruned.keyframes


def test_what_is_left_is_known_as_well_as_before(pruned: Slam, whole: Slam) -> None:
    keys = pruned.graph.keys(SE2)
    some = keys[(keys > 0) & (keys < keys[-1])][::9]
    before = whole._pose_graph.relative_covariances(int(keys[-1]), some)
    after = pruned._pose_graph.relative_covariances(int(keys[-1]), some)
    deviation = np.sqrt(np.trace(after[:, :2, :2], axis1=1, axis2=2) / np.trace(before[:, :2, :2], axis1=1, axis2=2))
    assert np.median(deviation) == pytest.approx(1.0, abs=0.25)
    assert deviation.max() < 1.6
    assert deviation.min() > 0.6


def test_the_map_is_the_same(pruned: Slam, whole: Slam) -> None:
    one, other = pruned.map(0.1), whole.map(0.1)
    walls = np.argwhere(other.states() == 1)
    cells = one.world_to_cell(other.cell_to_world(walls))
    inside = ((cells >= 0) & (cells < one.shape)).all(axis=1)
    occupied = one.states() == 1
    near = binary_dilation(occupied)
    assert inside.mean() > 0.99
    assert near[tuple(cells[inside].T)].mean() > 0.98
    assert len(pruned._scans.kept()[0]) < len(whole._scans.kept()[0])


def test_refining_what_is_left_keeps_all_poses_right(pruned: Slam) -> None:
    del pruned
    slam = driven(enabled=True)
    slam.refine()
    error, _ = errors(slam.trajectory.T_world_robot, truth_of(round_trip()))
    assert error.max() < 0.08
    np.testing.assert_array_equal(slam.graph.values(SE2).array, slam.keyframes.T_world_robot)


def test_same_log_same_graph(pruned: Slam) -> None:
    again = driven(enabled=True)
    np.testing.assert_array_equal(again.trajectory.T_world_robot, pruned.trajectory.T_world_robot)
    np.testing.assert_array_equal(again.graph.keys(), pruned.graph.keys())
    assert again.pruned == pruned.pruned


def test_pruning_a_keyframe_of_a_chain_changes_nothing_for_the_others() -> None:
    graph, _ = built(5, 12, [(0, 11)])
    graph.optimise(to_the_end=True)
    others = np.array([1, 3, 8])
    before, poses = graph.relative_covariances(11, others), graph.poses.copy()
    for key in (6, 5):
        loss = graph.prune(key, np.array([4]), se2.between(poses[[4]], poses[[key]]), np.eye(3)[None], 10.0)
        assert loss == pytest.approx(0.0, abs=1e-9)
    graph.optimise(to_the_end=True)
    np.testing.assert_allclose(graph.relative_covariances(11, others), before, rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(graph.follow(), poses, atol=1e-7)
    assert len(graph) == 12
    assert len(graph.graph) == 10


def test_a_keyframe_that_would_lose_too_much_stays() -> None:
    graph, _ = built(6, 9, [(0, 4), (1, 4), (2, 8)])
    graph.optimise()
    edges = graph.graph.factor_count
    assert graph.prune(4, np.array([3]), np.zeros((1, 3)), np.eye(3)[None], 1e-6) is None
    assert 4 in graph.graph
    assert graph.graph.factor_count == edges


def test_attached_keyframes_follow_through_chains() -> None:
    rng = np.random.default_rng(3)
    poses = rng.uniform(-2, 2, (8, 3))
    hung = Attachments()
    for key, on in ((3, [1, 4]), (4, [0, 5, 1]), (5, [0])):  # 3 hangs on 4, which was pruned later and hangs on 5
        T = se2.between(poses[on], poses[key])
        hung.add(key, np.array(on), T, np.stack([np.diag(rng.uniform(1, 9, 3)) for _ in on]))
    moved = se2.compose(np.array([3.0, -1.0, 0.7]), poses)
    found = moved.copy()
    found[[3, 4, 5]] = np.nan
    hung.place(found)
    np.testing.assert_allclose(found, se2.canonical(moved), atol=1e-5)


def test_partners_that_disagree_count_by_their_information() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [np.nan] * 3])
    hung = Attachments()
    T = np.array([[1.0, 0.0, 0.0], [1.04, 0.02, 0.0]])
    hung.add(2, np.array([0, 1]), T, np.stack([np.diag([3.0, 1.0, 1.0]), np.diag([1.0, 1.0, 1.0])]))
    hung.place(poses)
    np.testing.assert_allclose(poses[2], [1.01, 0.01, 0.0], atol=1e-6)


def room(width: float, depth: float) -> LaserScan:
    """From the middle of a rectangle."""
    angles = np.linspace(-np.pi, np.pi, 361)
    ranges = 1.0 / np.maximum(np.abs(np.cos(angles)) / width, np.abs(np.sin(angles)) / depth)
    return LaserScan(0.0, ranges, -np.pi, float(angles[1] - angles[0]), 0.1, 30.0)


def standing(scans: list[LaserScan], poses: Array, **options: float) -> tuple[Pruner, KeyframeStore]:
    """Keyframes with the scans at the poses, a metre of path apart, and what prunes them."""
    eager = replace(EAGER, batch=1, recent=2, path=3.0, **options)  # type: ignore[arg-type]  # numbers
    keyframes, graph = KeyframeStore(), PoseGraph(10.0)
    for k, (scan, pose) in enumerate(zip(scans, poses, strict=True)):
        step = se2.between(poses[k - 1], pose) if k else np.zeros(3)
        information = 1e4 * np.eye(3) if k else np.zeros((3, 3))
        keyframe = Keyframe(float(k), extract_points(scan), np.zeros(3), pose, float(k), step, information)
        keyframes.add(keyframe)
        graph.add_keyframe(keyframe)
    return Pruner(keyframes, graph, replace(SlamConfig(), pruning=eager)), keyframes


def forward(count: int) -> Array:
    """A centimetre at a time."""
    return np.stack([0.01 * np.arange(count), np.zeros(count), np.zeros(count)], axis=1)


@pytest.mark.parametrize(("width", "gone"), [(3.0, True), (6.0, False)])
def test_only_what_looks_the_same_is_redundant(width: float, gone: bool) -> None:
    """Keyframes that stand where others are believed to stand, but see something else, are not covered by these."""
    scans = [room(width, 0.5 * width + 0.5) if k == 5 else room(3.0, 2.0) for k in range(16)]
    pruner, keyframes = standing(scans, forward(16))
    taken_out = pruner.prune(set())
    assert len(taken_out) > 3
    assert (5 in taken_out) is gone
    assert pruner.pruned.keyframes == len(taken_out)
    assert not set(taken_out) & set(keyframes.alive.tolist())


def test_needed_keyframes_and_the_first_stay() -> None:
    pruner, _ = standing([room(3.0, 2.0)] * 16, forward(16))
    needed = set(range(3, 9))
    gone = pruner.prune(needed)
    assert gone
    assert not set(gone) & (needed | {0})


def test_the_oldest_and_the_newest_of_a_place_stay() -> None:
    pruner, keyframes = standing([room(3.0, 2.0)] * 20, forward(20), cover=8)
    gone = pruner.prune(set())
    assert gone
    assert min(gone) >= 4
    assert set(range(20 - 3, 20)) <= set(keyframes.alive.tolist())


def test_a_keyframe_that_its_returns_put_elsewhere_stays() -> None:
    """It stands a hand's breadth beside where the graph has it: what it would hang on is not where it belongs."""
    poses = forward(16)
    poses[5, 1] += 0.15
    pruner, keyframes = standing([room(3.0, 2.0)] * 16, poses, movement=0.02)
    assert len(pruner.prune(set())) > 3
    assert 5 in keyframes.alive


def test_what_a_pruned_keyframe_hangs_on_is_known_by_its_returns() -> None:
    """A room tells where its middle is to millimetres, a corridor only across."""
    rooms, _ = standing([room(3.0, 2.0)] * 16, forward(16))
    corridors, _ = standing([room(1e3, 2.0)] * 16, forward(16))
    for pruner, along in ((rooms, 0.01), (corridors, 0.06)):
        attached = pruner._attach(9, 12)
        assert attached is not None
        deviations = np.sqrt(np.diagonal(np.linalg.inv(attached[2]), axis1=1, axis2=2))
        assert (deviations[:, 1] < 0.01).all()
        assert (deviations[:, 0] < along).all()
        assert (deviations[:, 0] > along / 10).all()
