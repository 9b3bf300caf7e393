"""Alignment, absolute and relative errors: laws and hand-worked answers, in the plane and in space."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate import absolute_trajectory_error, align, relative_pose_error
from clew.evaluate.poses import functions_of
from clew.geometry import se2, se3, so3

Array = NDArray[np.float64]
DIMS = {3: 3, 7: 6}  # length of the tangent by length of the storage


def random_walk(storage: int, seed: int = 1, count: int = 60) -> Array:
    """Poses with random steps."""
    rng = np.random.default_rng(seed)
    group = se2 if storage == 3 else se3
    poses = [group.exp(rng.normal(size=DIMS[storage]))]
    for _ in range(count - 1):
        poses.append(group.compose(poses[-1], group.exp(rng.normal(0, 0.5, DIMS[storage]))))
    return np.array(poses)


def motion(storage: int, seed: int) -> Array:
    tangent = np.random.default_rng(seed).normal(0, 2, DIMS[storage])
    return (se2 if storage == 3 else se3).exp(tangent)


def spatial(poses: Array) -> Array:
    """Planar poses in SE3 storage."""
    zero = np.zeros((len(poses), 3))
    half = poses[:, 2] / 2
    return se3.canonical(np.column_stack([poses[:, :2], zero, np.sin(half), np.cos(half)]))


@pytest.mark.parametrize("storage", [3, 7])
@pytest.mark.parametrize("seed", range(5))
def test_a_moved_copy_has_no_error(storage: int, seed: int) -> None:
    truth, moved_by = random_walk(storage, seed), motion(storage, seed + 100)
    group = functions_of(truth)
    times = np.arange(len(truth)) * 0.1
    error = absolute_trajectory_error(times, truth, times, group.compose(moved_by, truth))
    assert error.used == len(truth)
    assert error.unused == 0
    assert error.translation.max < 1e-9
    assert error.rotation.max < 1e-7
    undone = group.compose(error.T_truth_estimate, moved_by)
    np.testing.assert_allclose(group.log(undone), 0.0, atol=1e-9)
    for along in ("distance", "time"):
        moved = group.compose(moved_by, truth)
        drift = relative_pose_error(times, truth, times, moved, delta=1.0, along=along)
        assert drift.used > 10
        assert drift.translation.max < 1e-9


@pytest.mark.parametrize("storage", [3, 7])
def test_errors_do_not_depend_on_the_frames(storage: int) -> None:
    truth, estimate = random_walk(storage, 1), random_walk(storage, 2)
    estimate = truth + 0.1 * (estimate - truth)
    if storage == 7:
        estimate = se3.canonical(estimate / np.r_[1, 1, 1, [1] * 4])
        estimate[:, 3:] /= np.linalg.norm(estimate[:, 3:], axis=1, keepdims=True)
    group = functions_of(truth)
    times = np.arange(len(truth)) * 1.0
    moved_truth = group.compose(motion(storage, 3), truth)
    moved = group.compose(motion(storage, 4), estimate)
    for measure in (absolute_trajectory_error, relative_pose_error):
        before = measure(times, truth, times, estimate)
        after = measure(times, moved_truth, times, moved)
        assert before.translation.rmse > 0.05
        assert after.translation.rmse == pytest.approx(before.translation.rmse, rel=1e-9)
        assert after.rotation.rmse == pytest.approx(before.rotation.rmse, rel=1e-6)


@pytest.mark.parametrize("dim", [2, 3])
def test_alignment_is_the_best_one(dim: int) -> None:
    """No small motion about it makes the sum of squares less."""
    rng = np.random.default_rng(dim)
    truth, estimate = rng.normal(size=(2, 30, dim))
    best = align(truth, estimate)
    group = functions_of(best)

    def cost(pose: Array) -> float:
        return float(((truth - group.act(pose, estimate)) ** 2).sum())

    for _ in range(50):
        tangent = rng.normal(0, 1e-3, 3 if dim == 2 else 6)
        assert cost(group.retract(best, tangent)) > cost(best)


def test_alignment_never_mirrors() -> None:
    points = np.random.default_rng(1).normal(size=(20, 3))
    best = align(points * [1, 1, -1], points)
    assert np.linalg.det(so3.matrix(best[3:])) == pytest.approx(1.0)


def test_a_straight_line_is_aligned() -> None:
    truth = np.column_stack([np.arange(10.0), np.zeros((10, 2))])
    turned = se2.compose(np.array([3.0, -2.0, 2.5]), truth)
    times = np.arange(10.0)
    for poses, true in ((turned, truth), (spatial(turned), spatial(truth))):
        error = absolute_trajectory_error(times, true, times, poses)
        assert error.translation.max < 1e-9
        assert error.rotation.max < 1e-6


def test_absolute_error_by_hand() -> None:
    """A square with one corner 4 cm off; the best shift and turn have closed forms in the plane."""
    truth = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
    estimate = truth.copy()
    estimate[0, 0] += 0.04
    times = np.arange(4.0)
    error = absolute_trajectory_error(times, truth, times, estimate)
    # Least squares in the plane: theta = atan2(sum of cross products, sum of dot products), about the
    # middles.
    centred = estimate[:, :2] - estimate[:, :2].mean(axis=0)
    theta = np.arctan2(np.sum(centred[:, 0] * truth[:, 1] - centred[:, 1] * truth[:, 0]),
                       np.sum(centred * truth[:, :2]))
    assert theta == pytest.approx(0.04 / 8.04, abs=1e-6)
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    distances = np.linalg.norm(truth[:, :2] - centred @ turn.T, axis=1)
    assert error.translation.rmse == pytest.approx(np.sqrt(np.mean(distances ** 2)))
    assert error.translation.max == pytest.approx(distances.max())
    assert error.translation.median == pytest.approx(np.median(distances))
    assert error.rotation.mean == pytest.approx(theta)


def test_relative_error_by_hand() -> None:
    """A robot on a straight line whose odometry counts 2 % too much and turns 0.001 rad a metre."""
    way = np.arange(101.0) * 0.5
    truth = np.column_stack([way, np.zeros((101, 2))])
    estimate = np.column_stack([1.02 * way, np.zeros(101), np.zeros(101)])
    times = way / 2.0
    error = relative_pose_error(times, truth, times, estimate, delta=10.0)
    assert error.used == 101 - 20
    assert error.translation.mean == pytest.approx(0.2)
    assert error.translation.std == pytest.approx(0.0, abs=1e-12)
    timed = relative_pose_error(times, truth, times, estimate, delta=10.0, along="time")
    assert timed.used == 101 - 40
    assert timed.translation.mean == pytest.approx(0.4)
    estimate[:, 2] = 0.001 * way
    assert relative_pose_error(times, truth, times, estimate, delta=10.0).rotation.mean == pytest.approx(0.01)


def test_planar_poses_in_either_storage_give_the_same() -> None:
    truth, estimate = random_walk(3, 1), random_walk(3, 1) + np.random.default_rng(1).normal(0, 0.1, (60, 3))
    times = np.arange(60.0)
    plane = absolute_trajectory_error(times, truth, times, estimate).to_dict()
    for a, b in ((spatial(truth), estimate), (truth, spatial(estimate)), (spatial(truth), spatial(estimate))):
        space = absolute_trajectory_error(times, a, times, b).to_dict()
        assert space["translation_m"] == pytest.approx(plane["translation_m"])
        assert space["rotation_deg"] == pytest.approx(plane["rotation_deg"])


def test_unmatched_poses_are_counted() -> None:
    truth = random_walk(3)
    times = np.arange(60.0)
    error = absolute_trajectory_error(times[::2], truth[::2], times + 0.01, truth)
    assert (error.used, error.unused) == (30, 30)
    assert error.translation.max < 1e-9


def test_impossible_requests_are_refused() -> None:
    truth, times = random_walk(3), np.arange(60.0)
    with pytest.raises(InputError, match="0 poses of trajectory and truth"):
        absolute_trajectory_error(times, truth, times + 1000, truth)
    with pytest.raises(InputError, match="not finite"):
        absolute_trajectory_error(times, truth, times, np.where(truth > 1, np.nan, truth))
    with pytest.raises(InputError, match="timestamps of shape"):
        absolute_trajectory_error(times, truth, times[:5], truth)
    with pytest.raises(InputError, match="no pose"):
        absolute_trajectory_error(times, truth, times[:0], truth[:0])
    with pytest.raises(InputError, match=r"\(N, 3\)"):
        absolute_trajectory_error(times, truth, times, truth[:, :2])
    with pytest.raises(InputError, match="positive"):
        relative_pose_error(times, truth, times, truth, delta=0.0)
    with pytest.raises(InputError, match="negative"):
        absolute_trajectory_error(times, truth, times, truth, tolerance=-1.0)
