"""Whitening and the checks of information matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clew.errors import InputError
from clew.noise import (
    check_information,
    indefinite,
    information_from_covariance,
    information_from_sigmas,
    resolve_information,
    sqrt_information,
    whiten,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.mark.parametrize("rank", [1, 3, 6])
def test_whitening_law_for_dense_information(rank: int, rng: np.random.Generator) -> None:
    root = rng.normal(size=(50, 6, rank))
    information = root @ np.swapaxes(root, 1, 2)
    residual = rng.normal(size=(50, 6))
    lower = sqrt_information(information)
    np.testing.assert_allclose(lower @ np.swapaxes(lower, 1, 2), information, atol=1e-12)
    expected = np.einsum("mi,mij,mj->m", residual, information, residual)
    np.testing.assert_allclose((whiten(lower, residual) ** 2).sum(axis=1), expected, rtol=1e-10, atol=1e-12)
    # the other factor of the same matrix is the classic mistake
    assert np.abs(((lower @ residual[..., None])[..., 0] ** 2).sum(axis=1) / expected - 1).max() > 0.1


def test_sigmas_broadcast_and_square() -> None:
    information = information_from_sigmas([0.5, 0.1], 3, 2)
    np.testing.assert_allclose(information, np.broadcast_to(np.diag([4.0, 100.0]), (3, 2, 2)))
    np.testing.assert_allclose(information_from_sigmas([[1.0], [2.0]], 2, 2)[1], 0.25 * np.eye(2))
    np.testing.assert_array_equal(information_from_sigmas([1.0, np.inf], 1, 2)[0], np.diag([1.0, 0.0]))


def test_covariance_is_inverted(rng: np.random.Generator) -> None:
    root = rng.normal(size=(20, 3, 3))
    covariance = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(3)
    information = information_from_covariance(covariance, 20, 3)
    np.testing.assert_allclose(information @ covariance, np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-10)


def test_indefinite_matrices_are_found() -> None:
    batch = np.stack([np.eye(2), np.diag([1.0, -1.0]), np.diag([1.0, 0.0]), [[1.0, 2.0], [2.0, 1.0]]])
    assert indefinite(batch).tolist() == [1, 3]
    assert indefinite(batch[:1]).size == 0


@pytest.mark.parametrize(
    ("noise", "says"),
    [
        ({}, "exactly one of sigmas, information and covariance, got none"),
        ({"sigmas": 1.0, "information": np.eye(2)}, "got sigmas and information"),
        ({"sigmas": [1.0, 0.0]}, r"sigmas: must be positive, got 0.0 at \(0, 1\)"),
        ({"sigmas": [1.0, -2.0]}, "must be positive"),
        ({"sigmas": [1.0, np.nan]}, "must be positive"),
        ({"sigmas": 1e-200}, "overflows"),
        ({"sigmas": [1.0, 2.0, 3.0]}, r"expected shape \(3, 2\)"),
        ({"sigmas": "soft"}, "cannot be read as numbers"),
        ({"information": [[1.0, 0.5], [0.4, 1.0]]}, "matrix 0 is not symmetric"),
        (
            {"information": [[1.0, 2.0], [2.0, 1.0]]},
            r"matrix 0 is not positive semidefinite \(smallest eigenvalue -1\)",
        ),
        ({"information": [np.eye(2), np.eye(2), -np.eye(2)]}, "matrix 2 is not positive semidefinite"),
        ({"information": [[np.inf, 0.0], [0.0, 1.0]]}, "matrix 0 has an entry that is not finite"),
        ({"information": np.eye(3)}, "expected shape"),
        ({"covariance": np.diag([1.0, 0.0])}, "singular"),
        ({"covariance": np.diag([1.0, -1.0])}, "not positive semidefinite"),
    ],
)
def test_noise_that_cannot_be_is_refused(noise: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says) as raised:
        resolve_information(3, 2, what="Between", **noise)
    assert str(raised.value).startswith("Between")
    assert "\n" not in str(raised.value)


def test_rounding_is_not_refused(rng: np.random.Generator) -> None:
    root = rng.normal(size=(100, 6, 2))
    check_information(root @ np.swapaxes(root, 1, 2))
    with pytest.raises(InputError, match="square"):
        check_information(np.zeros((3, 2)))
