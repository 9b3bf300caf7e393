"""Which timestamps belong together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clew.evaluate import associate, poses_at
from clew.evaluate.poses import nearest_in_time

times = st.sets(st.integers(0, 60), min_size=1, max_size=25).map(lambda v: np.array(sorted(v)) / 4)


@given(times, st.lists(st.integers(-20, 90), max_size=20).map(lambda v: np.array(v) / 4))
def test_nearest_agrees_with_a_search_of_all(known: np.ndarray, at: np.ndarray) -> None:
    expected = np.abs(at[:, None] - known).argmin(axis=1)
    np.testing.assert_array_equal(nearest_in_time(known, at), expected)


@given(times, times, st.sampled_from([0.0, 0.25, 0.5, 100.0]))
def test_pairs_are_one_to_one_and_near(first: np.ndarray, second: np.ndarray, tolerance: float) -> None:
    i, j = associate(first, second, tolerance)
    assert (np.diff(i) > 0).all()
    assert (np.diff(j) > 0).all()
    assert (np.abs(first[i] - second[j]) <= tolerance).all()
    same = np.intersect1d(first, second)
    assert np.isin(same, first[i]).all()


@pytest.mark.parametrize(("first", "second", "tolerance", "pairs"), [
    ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], 0.0, [(0, 0), (1, 1), (2, 2)]),
    ([0.0, 0.1, 0.2], [0.09], 0.05, [(1, 0)]),
    ([0.0, 1.0], [0.5], 0.4, []),
    ([0.0, 1.0], [0.5], 0.5, [(0, 0)]),  # as near to both: the earlier
    ([0.0], [5.0, 6.0], 1.0, []),
    ([10.0, 11.0], [10.05, 10.95, 11.02], 0.1, [(0, 0), (1, 2)]),
])
def test_pairs_by_hand(first: list[float], second: list[float], tolerance: float,
                       pairs: list[tuple[int, int]]) -> None:
    i, j = associate(np.array(first), np.array(second), tolerance)
    assert list(zip(i.tolist(), j.tolist(), strict=True)) == pairs


def test_poses_at_the_ends_are_not_extrapolated() -> None:
    known, poses = np.array([0.0, 1.0]), np.array([[0.0, 0, 0], [2.0, 0, 0]])
    at = np.array([-0.5, 0.0, 0.25, 1.0, 1.2, 9.0])
    found, usable = poses_at(known, poses, at, 0.5)
    np.testing.assert_allclose(found[:5, 0], [0.0, 0.0, 0.5, 2.0, 2.0])
    np.testing.assert_array_equal(usable, [True, True, True, True, True, False])


def test_a_single_pose_is_used_within_its_tolerance() -> None:
    found, usable = poses_at(np.array([3.0]), np.array([[1.0, 2, 3]]), np.array([2.9, 4.0]), 0.2)
    np.testing.assert_array_equal(found, [[1, 2, 3], [1, 2, 3]])
    np.testing.assert_array_equal(usable, [True, False])
