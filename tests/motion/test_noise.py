"""Uncertainty of odometry: what any sane model keeps to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from clew.motion import OdometryNoise

NOISE = OdometryNoise()
NO_FLOOR = replace(NOISE, translation_floor=0.0, rotation_floor=0.0)
length = st.floats(-50, 50)
turn = st.floats(-np.pi, np.pi)


@given(length, length, turn)
def test_covariance_is_positive_definite_and_the_same_in_all_directions(x: float, y: float, theta: float) -> None:
    covariance = NOISE.covariance(np.array([x, y, theta]))
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.all(np.linalg.eigvalsh(covariance) > 0)
    same = NOISE.covariance(np.array([np.hypot(x, y), 0.0, -theta]))
    np.testing.assert_allclose(covariance, same)


@given(length, turn, st.floats(1.0, 5.0))
def test_covariance_grows_with_distance_and_turn(x: float, theta: float, factor: float) -> None:
    small = NOISE.covariance(np.array([x, 0.0, theta]))
    for larger in ([factor * x, 0.0, theta], [x, 0.0, factor * theta]):
        assert np.all(np.diag(NOISE.covariance(np.array(larger)) - small) >= -1e-15)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8), st.floats(-0.2, 0.2))
def test_variance_adds_up_over_a_path_however_it_is_cut(steps: list[float], turn: float) -> None:
    parts = np.array([[s, 0.0, turn] for s in steps])
    whole = NO_FLOOR.covariance(np.array([sum(steps), 0.0, abs(turn) * len(steps)]))
    np.testing.assert_allclose(NO_FLOOR.covariance(parts).sum(axis=0), whole, atol=1e-15)


def test_deviations_are_those_of_the_attributes() -> None:
    drive, turn = NO_FLOOR.covariance(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(np.sqrt(np.diag(drive)), [NOISE.translation_per_metre] * 2 + [NOISE.rotation_per_metre])
    np.testing.assert_allclose(np.sqrt(np.diag(turn)), [NOISE.translation_per_radian] * 2 + [NOISE.rotation_per_radian])
    still = NOISE.covariance(np.zeros(3))
    np.testing.assert_allclose(np.sqrt(np.diag(still)), [NOISE.translation_floor] * 2 + [NOISE.rotation_floor])


def test_a_batch_is_its_rows() -> None:
    increments = np.random.default_rng(0).normal(size=(4, 5, 3))
    batch = NOISE.covariance(increments)
    assert batch.shape == (4, 5, 3, 3)
    np.testing.assert_array_equal(batch[2, 3], NOISE.covariance(increments[2, 3]))
