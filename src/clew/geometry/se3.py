"""Rigid motions of space on plain arrays ``(..., 7)``: ``(x, y, z, qx, qy, qz, qw)``, unit quaternion.

Tangents are ``(..., 6)``, translation first, then a rotation vector in radians. `retract` is decoupled and
*not* ``compose(a, exp(delta))``; both agree to first order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import so3
from clew.geometry.angles import half_cotangent_defect_ratio, sine_defect_ratio, versine_ratio

Array = NDArray[np.float64]


def _join(translation: Array, rotation: Array) -> Array:
    shape = np.broadcast_shapes(translation.shape[:-1], rotation.shape[:-1])
    parts = [np.broadcast_to(part, (*shape, part.shape[-1])) for part in (translation, rotation)]
    return np.concatenate(parts, axis=-1)


def _blocks(top_left: Array, top_right: Array, bottom_right: Array) -> Array:
    """``(..., 6, 6)`` from blocks ``(..., 3, 3)`` with a zero at the bottom left."""
    shape = np.broadcast_shapes(top_left.shape, top_right.shape, bottom_right.shape)[:-2]
    result = np.zeros((*shape, 6, 6))
    result[..., :3, :3] = top_left
    result[..., :3, 3:] = top_right
    result[..., 3:, 3:] = bottom_right
    return result


def canonical(a: Array) -> Array:
    """The storage that stands for a pose: quaternion of unit length with ``qw >= 0``."""
    return np.concatenate((a[..., :3], so3.canonical(a[..., 3:])), axis=-1)


def compose(a: Array, b: Array) -> Array:
    """``a b``: first `b`, then `a`."""
    return _join(act(a, b[..., :3]), so3.compose(a[..., 3:], b[..., 3:]))


def inverse(a: Array) -> Array:
    """``a^-1``."""
    rotation = so3.inverse(a[..., 3:])
    return _join(-so3.act(rotation, a[..., :3]), rotation)


def between(a: Array, b: Array) -> Array:
    """``a^-1 b``: pose `b` as seen from pose `a`."""
    rotation = so3.inverse(a[..., 3:])
    return _join(so3.act(rotation, b[..., :3] - a[..., :3]), so3.compose(rotation, b[..., 3:]))


def act(a: Array, points: Array) -> Array:
    """Points ``(..., 3)`` mapped by the pose: ``t + R p``."""
    return a[..., :3] + so3.act(a[..., 3:], points)


def exp(tangent: Array) -> Array:
    """Group exponential: the motion with constant body velocity `tangent` for unit time."""
    v, w = tangent[..., :3], tangent[..., 3:]
    squared = (w * w).sum(axis=-1)[..., None]
    turned = so3.cross(w, v)
    translation = v + versine_ratio(squared) * turned + sine_defect_ratio(squared) * so3.cross(w, turned)
    return _join(translation, so3.exp(w))


def log(a: Array) -> Array:
    """Inverse of `exp` for rotations of at most pi."""
    t, w = a[..., :3], so3.log(a[..., 3:])
    squared = (w * w).sum(axis=-1)[..., None]
    turned = so3.cross(w, t)
    return _join(t - 0.5 * turned + half_cotangent_defect_ratio(squared) * so3.cross(w, turned), w)


def adjoint(a: Array) -> Array:
    """``(..., 6, 6)`` with ``a exp(v) a^-1 = exp(adjoint(a) v)``."""
    rotation = so3.matrix(a[..., 3:])
    return _blocks(rotation, so3.hat(a[..., :3]) @ rotation, rotation)


def matrix(a: Array) -> Array:
    """``(..., 4, 4)`` homogeneous matrix."""
    top = np.concatenate((so3.matrix(a[..., 3:]), a[..., :3, None]), axis=-1)
    bottom = np.broadcast_to(np.array([[0.0, 0.0, 0.0, 1.0]]), (*a.shape[:-1], 1, 4))
    return np.concatenate((top, bottom), axis=-2)


def retract(a: Array, delta: Array) -> Array:
    """``t + R v, R Exp(w)`` for ``delta = (v, w)``."""
    return _join(act(a, delta[..., :3]), so3.retract(a[..., 3:], delta[..., 3:]))


def local(a: Array, b: Array) -> Array:
    """The tangent that `retract` needs to get from `a` to `b`."""
    rotation = a[..., 3:]
    return _join(so3.act(so3.inverse(rotation), b[..., :3] - a[..., :3]), so3.local(rotation, b[..., 3:]))


def local_jacobians(a: Array, b: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., 6, 6)`` of `local` by `a` and by `b`."""
    delta = local(a, b)
    by_a, by_b = so3.local_jacobians(a[..., 3:], b[..., 3:])
    relative = so3.matrix(so3.between(a[..., 3:], b[..., 3:]))
    zero = np.zeros((3, 3))
    return _blocks(-np.eye(3), so3.hat(delta[..., :3]), by_a), _blocks(relative, zero, by_b)


def act_jacobians(a: Array, points: Array) -> tuple[Array, Array]:
    """Derivatives of `act` by the pose, ``(..., 3, 6)``, and by the point, ``(..., 3, 3)``."""
    by_rotation, by_point = so3.act_jacobians(a[..., 3:], points)
    return np.concatenate((by_point, by_rotation), axis=-1), by_point


def tangent_basis(a: Array) -> Array:
    """Derivative ``(..., 7, 6)`` of the storage by the tangent of `retract` at zero."""
    basis = np.zeros((*a.shape, 6))
    basis[..., :3, :3] = so3.matrix(a[..., 3:])
    basis[..., 3:, 3:] = so3.tangent_basis(a[..., 3:])
    return basis
