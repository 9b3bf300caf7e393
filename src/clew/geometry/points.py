"""Points on plain arrays ``(..., n)``: the vector group, in which `retract` is addition."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _eye(a: Array) -> Array:
    dim = a.shape[-1]
    return np.broadcast_to(np.eye(dim), (*a.shape, dim))


def canonical(a: Array) -> Array:
    """The storage as it is."""
    return a


def compose(a: Array, b: Array) -> Array:
    """Sum."""
    return a + b


def inverse(a: Array) -> Array:
    """Negative."""
    return -a


def between(a: Array, b: Array) -> Array:
    """Vector from `a` to `b`."""
    return b - a


def act(a: Array, points: Array) -> Array:
    """Points shifted by `a`."""
    return a + points


def exp(tangent: Array) -> Array:
    """The tangent itself."""
    return +tangent


def log(a: Array) -> Array:
    """The point itself."""
    return +a


def adjoint(a: Array) -> Array:
    """``(..., n, n)``: the identity."""
    return _eye(a)


def matrix(a: Array) -> Array:
    """``(..., n + 1, n + 1)`` homogeneous matrix of the translation."""
    dim = a.shape[-1]
    left = np.broadcast_to(np.eye(dim + 1)[:, :dim], (*a.shape[:-1], dim + 1, dim))
    right = np.concatenate((a, np.ones((*a.shape[:-1], 1))), axis=-1)
    return np.concatenate((left, right[..., None]), axis=-1)


def retract(a: Array, delta: Array) -> Array:
    """Sum."""
    return a + delta


def local(a: Array, b: Array) -> Array:
    """Vector from `a` to `b`."""
    return b - a


def local_jacobians(a: Array, b: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., n, n)`` of `local` by `a` and by `b`."""
    eye = _eye(b - a)
    return -eye, eye


def act_jacobians(a: Array, points: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., n, n)`` of `act` by `a` and by the point."""
    eye = _eye(a + points)
    return eye, eye


def tangent_basis(a: Array) -> Array:
    """Derivative ``(..., n, n)`` of the storage by the tangent: the identity."""
    return _eye(a)
