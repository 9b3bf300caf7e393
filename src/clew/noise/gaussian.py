"""Gaussian noise: information matrices, checked, and whitening.

The law of whitening: ``||whiten(L, e)||^2 = e^T Omega e`` with ``Omega = L L^T`` and
``whiten(L, e) = L^T e``, for dense ``Omega`` too (with ``L e`` it would hold for diagonal matrices only).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError

Array = NDArray[np.float64]

#: Largest asymmetry and most negative eigenvalue that count as rounding, relative to the largest entry.
_TOLERANCE = 1e-9


def _numbers(values: ArrayLike, what: str) -> Array:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: cannot be read as numbers ({error})") from None


def _broadcast(values: Array, shape: tuple[int, ...], what: str) -> Array:
    if values.ndim > len(shape):
        raise InputError(f"{what}: expected shape {shape} or one that broadcasts to it, got {values.shape}")
    try:
        return np.ascontiguousarray(np.broadcast_to(values, shape))
    except ValueError:
        raise InputError(
            f"{what}: expected shape {shape} or one that broadcasts to it, got {values.shape}"
        ) from None


def indefinite(information: Array) -> NDArray[np.int64]:
    """Indices of the matrices in a symmetric batch ``(M, d, d)`` that have a negative eigenvalue."""
    try:
        np.linalg.cholesky(information)
    except np.linalg.LinAlgError:
        lowest = np.linalg.eigvalsh(information)[:, 0]
        largest = np.abs(information).max(axis=(1, 2))
        return np.flatnonzero(lowest < -_TOLERANCE * largest)
    return np.empty(0, dtype=np.int64)


def check_information(information: Array, what: str = "information") -> None:
    """Check that ``(..., d, d)`` matrices are finite, symmetric and positive semidefinite.

    Raises:
        InputError: naming the first matrix that is not, and why.
    """
    if information.ndim < 2 or information.shape[-1] != information.shape[-2]:
        raise InputError(f"{what}: expected square matrices (..., d, d), got shape {information.shape}")
    batch = information.reshape(-1, *information.shape[-2:])
    finite = np.isfinite(batch).all(axis=(1, 2))
    if not finite.all():
        raise InputError(f"{what}: matrix {int(np.argmin(finite))} has an entry that is not finite")
    asymmetry = np.abs(batch - np.swapaxes(batch, 1, 2)).max(axis=(1, 2), initial=0.0)
    bad = asymmetry > _TOLERANCE * np.abs(batch).max(axis=(1, 2), initial=0.0)
    if bad.any():
        raise InputError(f"{what}: matrix {int(np.argmax(bad))} is not symmetric")
    negative = indefinite(batch)
    if negative.size:
        first = int(negative[0])
        lowest = float(np.linalg.eigvalsh(batch[first])[0])
        raise InputError(
            f"{what}: matrix {first} is not positive semidefinite (smallest eigenvalue {lowest:.3g}); "
            f"{negative.size} of {len(batch)} are not"
        )


def information_from_sigmas(sigmas: ArrayLike, count: int, dim: int, what: str = "sigmas") -> Array:
    """Diagonal information ``(count, dim, dim)`` from standard deviations that broadcast to ``(count, dim)``.

    An infinite sigma stands for no information on that component.

    Raises:
        InputError: a shape that does not fit, or a sigma that is not positive.
    """
    values = _broadcast(_numbers(sigmas, what), (count, dim), what)
    if not (values > 0.0).all():
        row, column = (int(i) for i in np.argwhere(~(values > 0.0))[0])
        raise InputError(f"{what}: must be positive, got {values[row, column]} at ({row}, {column})")
    information = np.zeros((count, dim, dim))
    diagonal = np.arange(dim)
    with np.errstate(over="ignore", divide="ignore"):
        information[:, diagonal, diagonal] = values**-2.0
    if not np.isfinite(information).all():
        raise InputError(f"{what}: {values.min()} is so small that its information overflows")
    return information


def information_from_matrix(information: ArrayLike, count: int, dim: int, what: str = "information") -> Array:
    """Checked information ``(count, dim, dim)`` from matrices that broadcast to it; raises `InputError`."""
    values = _numbers(information, what)
    full = _broadcast(values, (count, dim, dim), what)
    check_information(full[:1] if values.ndim < 3 or len(values) == 1 else full, what)
    return full


def information_from_covariance(
    covariance: ArrayLike, count: int, dim: int, what: str = "covariance"
) -> Array:
    """Information ``(count, dim, dim)`` from covariances that broadcast to it.

    Raises:
        InputError: a shape that does not fit, or a matrix that is not symmetric and positive definite.
    """
    full = information_from_matrix(covariance, count, dim, what)
    try:
        lower = np.linalg.cholesky(full)
    except np.linalg.LinAlgError:
        first = int(np.argmin(np.linalg.eigvalsh(full)[:, 0]))
        raise InputError(f"{what}: matrix {first} is singular, so it has no information matrix") from None
    root = np.linalg.inv(lower)
    inverse: Array = np.swapaxes(root, 1, 2) @ root
    return inverse


def resolve_information(
    count: int,
    dim: int,
    *,
    sigmas: ArrayLike | None = None,
    information: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
    what: str = "factor",
) -> Array:
    """Information ``(count, dim, dim)`` from exactly one way to state noise; raises `InputError`."""
    ways = {"sigmas": sigmas, "information": information, "covariance": covariance}
    given = [name for name, value in ways.items() if value is not None]
    if len(given) != 1:
        got = " and ".join(given) or "none"
        raise InputError(f"{what}: give exactly one of sigmas, information and covariance, got {got}")
    if sigmas is not None:
        return information_from_sigmas(sigmas, count, dim, f"{what}: sigmas")
    if information is not None:
        return information_from_matrix(information, count, dim, f"{what}: information")
    assert covariance is not None
    return information_from_covariance(covariance, count, dim, f"{what}: covariance")


def sqrt_information(information: Array) -> Array:
    """``L`` ``(..., d, d)`` with ``Omega = L L^T`` for positive semidefinite ``Omega``.

    The Cholesky factor where all matrices are positive definite, else the symmetric root's columns.
    """
    try:
        return np.asarray(np.linalg.cholesky(information), dtype=np.float64)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(information)
        root: Array = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
        return root


def whiten(sqrt_info: Array, residual: Array) -> Array:
    """``L^T e`` for ``L`` ``(..., d, d)`` from `sqrt_information` and residuals ``(..., d)``."""
    whitened: Array = (np.swapaxes(sqrt_info, -1, -2) @ residual[..., None])[..., 0]
    return whitened
