"""Rotations of the plane on plain arrays ``(..., 1)``: theta in ``(-pi, pi]``; tangents ``(..., 1)``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry.angles import wrap

Array = NDArray[np.float64]


def canonical(a: Array) -> Array:
    """The storage that stands for a rotation: theta wrapped."""
    return wrap(a)


def compose(a: Array, b: Array) -> Array:
    """Rotation by `b`, then by `a`."""
    return wrap(a + b)


def inverse(a: Array) -> Array:
    """Rotation the other way round."""
    return wrap(-a)


def between(a: Array, b: Array) -> Array:
    """``a^-1 b``."""
    return wrap(b - a)


def act(a: Array, points: Array) -> Array:
    """Points ``(..., 2)`` rotated."""
    cos, sin = np.cos(a[..., 0]), np.sin(a[..., 0])
    x, y = points[..., 0], points[..., 1]
    return np.stack((cos * x - sin * y, sin * x + cos * y), axis=-1)


def exp(tangent: Array) -> Array:
    """Rotation by an angle."""
    return wrap(tangent)


def log(a: Array) -> Array:
    """Angle of a rotation, in ``(-pi, pi]``."""
    return wrap(a)


def adjoint(a: Array) -> Array:
    """``(..., 1, 1)``: the identity, for the group is commutative."""
    return np.ones((*a.shape, 1))


def matrix(a: Array) -> Array:
    """``(..., 2, 2)`` rotation matrix."""
    cos, sin = np.cos(a[..., 0]), np.sin(a[..., 0])
    return np.stack((np.stack((cos, -sin), axis=-1), np.stack((sin, cos), axis=-1)), axis=-2)


def retract(a: Array, delta: Array) -> Array:
    """``R Exp(delta)``."""
    return wrap(a + delta)


def local(a: Array, b: Array) -> Array:
    """The tangent that `retract` needs to get from `a` to `b`."""
    return wrap(b - a)


def local_jacobians(a: Array, b: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., 1, 1)`` of `local` by `a` and by `b`."""
    one = np.ones((*np.broadcast_shapes(a.shape, b.shape), 1))
    return -one, one


def act_jacobians(a: Array, points: Array) -> tuple[Array, Array]:
    """Derivatives of `act` by the rotation, ``(..., 2, 1)``, and by the point, ``(..., 2, 2)``."""
    moved = act(a, points)
    turned = np.stack((-moved[..., 1], moved[..., 0]), axis=-1)
    return turned[..., None], np.broadcast_to(matrix(a), (*moved.shape, 2))


def tangent_basis(a: Array) -> Array:
    """Derivative ``(..., 1, 1)`` of the storage by the tangent of `retract` at zero."""
    return np.ones((*a.shape, 1))
