"""Normalised errors: their band against simulation, for errors that are alike for a while."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from clew.errors import InputError
from clew.evaluate import consistency, effective_count, normalised_squares


def process(rng: np.random.Generator, count: int, correlation: float, dim: int) -> np.ndarray:
    """First-order processes ``(count, dim)`` of unit variance."""
    noise = rng.standard_normal((count, dim))
    noise[1:] *= np.sqrt(1.0 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], noise, axis=0))


def test_effective_count_of_a_first_order_process() -> None:
    rng = np.random.default_rng(1)
    for correlation in (0.0, 0.5, 0.9):
        series = process(rng, 40_000, correlation, 1)[:, 0]
        assert effective_count(series) == pytest.approx(40_000 * (1 - correlation) / (1 + correlation), rel=0.15)
    assert effective_count(np.ones(10)) == 1.0


def test_squares_are_those_of_the_inverse_covariance() -> None:
    rng = np.random.default_rng(2)
    root, errors = rng.standard_normal((20, 3, 3)), rng.standard_normal((20, 3))
    covariances = root @ np.swapaxes(root, 1, 2) + np.eye(3)
    expected = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    np.testing.assert_allclose(normalised_squares(errors, covariances), expected)


@pytest.mark.parametrize("correlation", [0.0, 0.95])
def test_the_band_holds_right_covariances_as_often_as_it_says(correlation: float) -> None:
    rng = np.random.default_rng(3)
    inside = [
        consistency(np.sum(process(rng, 1500, correlation, 2) ** 2, axis=1), 2).inside for _ in range(200)
    ]
    assert 0.87 < np.mean(inside) < 0.99


def test_too_sure_and_too_cautious_are_told_apart() -> None:
    errors = process(np.random.default_rng(4), 3000, 0.9, 2)
    squares = np.sum(errors**2, axis=1)
    verdicts = [consistency(scale * squares, 2).verdict for scale in (0.4, 1.0, 2.5)]
    assert verdicts == ["too cautious", "inside", "too sure"]


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="need covariances"):
        normalised_squares(np.zeros((3, 2)), np.zeros((3, 3, 3)))
    with pytest.raises(InputError, match="positive definite"):
        normalised_squares(np.zeros((1, 2)), np.zeros((1, 2, 2)))
    with pytest.raises(InputError, match="at least two"):
        effective_count(np.zeros(1))
