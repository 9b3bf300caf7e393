"""Landmarks that stand in a map twice: sets of pairs against chance."""

from __future__ import annotations

import numpy as np
import pytest

from clew.place import evidence_of_one, join_landmarks, landmark_density

NOISE = 0.05  # metres, of each landmark by itself


def twice(points: np.ndarray, drift: np.ndarray, sigma: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """All points, and all of them again moved by a drift of a standard deviation that both axes have."""
    rng = np.random.default_rng(seed)
    count = len(points)
    doubled = np.concatenate([points, points + drift]) + NOISE * rng.standard_normal((2 * count, 2))
    covariance = NOISE**2 * np.eye(4 * count)
    second = np.kron(np.diag(np.repeat([0.0, 1.0], count)), np.eye(2))
    covariance += sigma**2 * second @ np.kron(np.ones((2 * count, 2 * count)), np.eye(2)) @ second
    return doubled, covariance


def co_visible(count: int) -> np.ndarray:
    """The first half was seen together, and the second."""
    half = np.arange(2 * count) < count
    return half[:, None] == half[None]


def test_a_constellation_is_found_again_after_a_drift_larger_than_its_spacing() -> None:
    points = np.random.default_rng(3).uniform(0.0, 12.0, (8, 2))
    doubled, covariance = twice(points, np.array([2.0, -1.5]), 2.0)
    pairs = join_landmarks(doubled, covariance, co_visible(8), landmark_density(points))
    assert sorted(tuple(sorted(pair)) for pair in pairs) == [(k, k + 8) for k in range(8)]


def test_evidence_is_the_ratio_of_densities() -> None:
    """One landmark: the difference is normal about zero; two: the second may be anywhere, so many a square metre."""
    covariance, difference = np.array([[0.04, 0.01], [0.01, 0.02]]), np.array([0.2, -0.1])
    distance = difference @ np.linalg.inv(covariance) @ difference
    normal = np.exp(-0.5 * distance) / (2.0 * np.pi * np.sqrt(np.linalg.det(covariance)))
    assert evidence_of_one(np.array(distance), covariance, 0.3) == pytest.approx(np.log(normal / 0.3))


def test_where_the_density_is_not_known_nothing_is_joined() -> None:
    """Only one landmark was seen often enough to be sure of: what stands where by chance is not known."""
    near = np.array([[0.0, 0.0], [0.05, 0.02]])
    assert join_landmarks(near, NOISE**2 * np.eye(4), np.eye(2, dtype=bool), 0.0) == []


def test_a_regular_row_is_refused() -> None:
    """Every shift by one place fits nearly as well as the right one."""
    points = np.stack([2.0 * np.arange(8.0), np.zeros(8)], axis=1)
    doubled, covariance = twice(points, np.array([1.0, 0.0]), 3.0)
    assert join_landmarks(doubled, covariance, co_visible(8), landmark_density(points)) == []


def test_one_pair_proves_nothing_where_the_drift_is_large() -> None:
    points = np.array([[0.0, 0.0], [0.9, 0.4]])
    for sigma, joined in ((0.0, False), (3.0, False)):
        covariance = NOISE**2 * np.eye(4)
        covariance[2:, 2:] += sigma**2 * np.eye(2)
        assert bool(join_landmarks(points, covariance, np.eye(2, dtype=bool), 0.05)) is joined
    near = np.array([[0.0, 0.0], [0.05, 0.02]])
    assert join_landmarks(near, NOISE**2 * np.eye(4), np.eye(2, dtype=bool), 0.05) == [(0, 1)]
    assert join_landmarks(near, NOISE**2 * np.eye(4), np.ones((2, 2), bool), 0.05) == []


def test_density_of_evenly_scattered_points() -> None:
    points = np.random.default_rng(1).uniform(0.0, 100.0, (3000, 2))
    assert landmark_density(points) == pytest.approx(0.3, rel=0.1)
    assert landmark_density(points[:1]) == 0.0
