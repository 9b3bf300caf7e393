"""Relations: a hand-worked error, invariance, the choice of relations from a reference."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate import ReferenceRelations, relation_errors, relations_from_reference
from clew.geometry import se2, se3

Array = NDArray[np.float64]


def relations(first: list[float], second: list[float], poses: list[list[float]]) -> ReferenceRelations:
    revisit = np.zeros(len(first), dtype=bool)
    return ReferenceRelations(np.array(first), np.array(second), np.array(poses), revisit)


def there_and_back_again() -> tuple[Array, Array]:
    """Twice around a square of 10 m, a pose every 0.5 m at 0.5 m/s; the second round is 0.1 m to the side."""
    side = np.arange(20) * 0.5
    corner = [se2.compose(np.array([[0, 0, 0], [10, 0, np.pi / 2], [10, 10, np.pi], [0, 10, -np.pi / 2]])[i],
                          np.column_stack([side, np.zeros((20, 2))])) for i in range(4)]
    once = np.concatenate(corner)
    return np.arange(160.0), np.concatenate([once, se2.compose(once, np.array([0.0, 0.1, 0.0]))])


def test_error_by_hand() -> None:
    """True: 1 m ahead. Estimated: 1.03 m ahead, 0.04 m left, turned by 0.02 rad. Error: 5 cm, 0.02 rad."""
    start = np.array([5.0, -3.0, 2.0])
    went = np.array([[0.0, 0.0, 0.0], [1.03, 0.04, 0.02], [9.0, 9.0, 1.0]])
    poses = se2.compose(start, went)
    ahead = relations([10.0], [20.0], [[1.0, 0.0, 0.0]])
    errors = relation_errors(np.array([10.0, 20.0, 30.0]), poses, ahead)
    assert (errors.used, errors.unused) == (1, 0)
    assert errors.translation.mean == pytest.approx(0.05)
    assert errors.rotation.mean == pytest.approx(0.02)
    assert errors.to_dict()["rotation_deg"] == pytest.approx(
        {"mean": np.degrees(0.02), "std": 0.0, "rmse": np.degrees(0.02), "median": np.degrees(0.02),
         "max": np.degrees(0.02)})


def test_mean_and_deviation_by_hand() -> None:
    """Two errors, 0.3 m and 0.1 m: mean 0.2 m, standard deviation 0.1 m."""
    truth = [[1.0, 0.0, np.pi / 2], [2.0, 0.0, 0.0]]
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.3, np.pi / 2 - 0.1], [2.1, 0.0, 0.0]])
    errors = relation_errors(np.arange(3.0), poses, relations([0.0, 0.0], [1.0, 2.0], truth))
    assert errors.translation.mean == pytest.approx(0.2)
    assert errors.translation.std == pytest.approx(0.1)
    assert errors.translation.max == pytest.approx(0.3)
    assert errors.rotation.mean == pytest.approx(0.05)


def test_a_moved_trajectory_has_the_same_errors() -> None:
    times, truth = there_and_back_again()
    chosen = relations_from_reference(times, truth)
    noisy = truth + np.random.default_rng(1).normal(0, 0.05, truth.shape)
    before = relation_errors(times, noisy, chosen)
    after = relation_errors(times, se2.compose(np.array([7.0, -9.0, 3.0]), noisy), chosen)
    assert before.translation.mean == pytest.approx(after.translation.mean, rel=1e-9)
    assert before.rotation.std == pytest.approx(after.rotation.std, rel=1e-9)
    assert before.translation.mean > 0.05
    moved = se2.compose(np.array([7.0, -9.0, 3.0]), truth)
    assert relation_errors(times, moved, chosen).translation.max < 1e-9


def test_poses_between_timestamps_are_interpolated() -> None:
    """On an arc with constant velocity the pose half-way is exact."""
    times = np.arange(5.0)
    poses = se2.exp(times[:, None] * np.array([1.0, 0.0, 0.4]))
    half = relations([0.5], [3.25], [se2.exp(2.75 * np.array([1.0, 0.0, 0.4])).tolist()])
    assert relation_errors(times, poses, half).translation.mean < 1e-12
    half_angle = poses[:, 2] / 2
    spatial = np.column_stack([poses[:, :2], np.zeros((5, 3)), np.sin(half_angle), np.cos(half_angle)])
    assert relation_errors(times, se3.canonical(spatial), half).translation.mean < 1e-12


def test_tolerance_and_unused() -> None:
    poses = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    times = np.array([0.0, 1.0, 10.0])
    three = relations([0.0, 1.0, -5.0], [1.0, 5.0, 0.0], [[1.0, 0, 0]] * 3)
    errors = relation_errors(times, poses, three)
    assert (errors.used, errors.unused) == (1, 2)
    assert relation_errors(times, poses, three, tolerance=5.0).used == 3
    none = relation_errors(times + 100, poses, three)
    assert none.used == 0
    assert np.isnan(none.translation.mean)
    assert none.to_dict()["translation_m"] == dict.fromkeys(("mean", "std", "rmse", "median", "max"))


def test_choice_from_a_reference() -> None:
    times, truth = there_and_back_again()
    chosen = relations_from_reference(times, truth)
    successive, again = chosen.select(~chosen.revisit), chosen.select(chosen.revisit)
    np.testing.assert_array_equal(successive.second - successive.first, 1.0)
    assert len(successive) == 159
    # Every pose of the second round, and nothing else, comes back to its twin of the first.
    np.testing.assert_array_equal(again.second, np.arange(80.0, 160.0))
    np.testing.assert_array_equal(again.second - again.first, 80.0)
    np.testing.assert_allclose(again.T_first_second, np.tile([0.0, 0.1, 0.0], (80, 1)), atol=1e-9)


def test_choice_keeps_to_its_limits() -> None:
    times, truth = there_and_back_again()
    assert not relations_from_reference(times, truth, max_distance=0.09).revisit.any()
    assert not relations_from_reference(times, truth, min_travelled=100.0).revisit.any()
    assert relations_from_reference(times, truth, max_gap=0.5).revisit.all()
    assert relations_from_reference(times, truth, max_distance=0.35).revisit.all()
    # The way back looks the other way: left out but for a wide limit.
    back = np.concatenate([truth[:40], se2.compose(truth[39::-1], np.array([0.0, 0.0, np.pi]))])
    assert not relations_from_reference(np.arange(80.0), back).revisit.any()
    assert relations_from_reference(np.arange(80.0), back, max_turn=np.pi).revisit.any()


def test_choice_does_not_depend_on_the_order_of_the_file() -> None:
    times, truth = there_and_back_again()
    shuffled = np.random.default_rng(1).permutation(len(times))
    a, b = relations_from_reference(times, truth), relations_from_reference(times[shuffled], truth[shuffled])
    np.testing.assert_array_equal(a.first, b.first)
    np.testing.assert_array_equal(a.T_first_second, b.T_first_second)


def test_misfitting_relations_are_refused() -> None:
    with pytest.raises(InputError, match="two timestamps"):
        relation_errors(np.zeros(1), np.zeros((1, 3)), relations([0.0, 1.0], [0.0], [[0.0, 0, 0]]))
    with pytest.raises(InputError, match="shape"):
        relation_errors(np.zeros(1), np.zeros((1, 3)), relations([0.0], [0.0], [[0.0, 0]]))
