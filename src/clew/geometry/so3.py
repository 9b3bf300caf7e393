"""Rotations of space on plain arrays ``(..., 4)``: unit quaternions ``(qx, qy, qz, qw)`` with ``qw >= 0``.

Tangents are rotation vectors ``(..., 3)`` in radians, applied on the right. Formulas: Sola, Deray, Atchuthan,
"A micro Lie theory for state estimation in robotics", 2018, appendix B.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry.angles import (
    away_from_zero,
    half_cotangent_defect_ratio,
    sinc,
    sine_defect_ratio,
    versine_ratio,
)
from clew.geometry.dual import primal

Array = NDArray[np.float64]


def cross(a: Array, b: Array) -> Array:
    """Vector product ``(..., 3)``."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=-1)


def hat(v: Array) -> Array:
    """``(..., 3, 3)`` skew matrix with ``hat(v) @ u = cross(v, u)``."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    zero = np.zeros_like(x)
    return np.stack(
        (
            np.stack((zero, -z, y), axis=-1),
            np.stack((z, zero, -x), axis=-1),
            np.stack((-y, x, zero), axis=-1),
        ),
        axis=-2,
    )


def canonical(a: Array) -> Array:
    """The storage that stands for a rotation: unit length, ``qw >= 0``."""
    length = np.sqrt((a * a).sum(axis=-1))
    unit: Array = a / np.where(primal(a)[..., 3] < 0.0, -length, length)[..., None]
    return unit


def _product(a: Array, b: Array) -> Array:
    ax, ay, az, aw = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bx, by, bz, bw = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return np.stack(
        (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ),
        axis=-1,
    )


def compose(a: Array, b: Array) -> Array:
    """Rotation by `b`, then by `a`."""
    return canonical(_product(a, b))


def inverse(a: Array) -> Array:
    """Rotation the other way round."""
    conjugate: Array = a * np.array([-1.0, -1.0, -1.0, 1.0])
    return conjugate


def between(a: Array, b: Array) -> Array:
    """``a^-1 b``."""
    return canonical(_product(inverse(a), b))


def act(a: Array, points: Array) -> Array:
    """Points ``(..., 3)`` rotated."""
    axis = a[..., :3]
    twice = 2.0 * cross(axis, points)
    moved: Array = points + a[..., 3:] * twice + cross(axis, twice)
    return moved


def exp(tangent: Array) -> Array:
    """Rotation about `tangent` by its length."""
    quarter = 0.25 * (tangent * tangent).sum(axis=-1)
    small, safe = away_from_zero(quarter)
    q = quarter
    series = 1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0))))
    cos_half = np.where(small, series, np.cos(np.sqrt(safe)))
    return canonical(np.concatenate((0.5 * sinc(quarter)[..., None] * tangent, cos_half[..., None]), axis=-1))


def log(a: Array) -> Array:
    """Rotation vector of a rotation, of length at most pi."""
    sign = np.where(primal(a)[..., 3] < 0.0, -1.0, 1.0)
    vector, w = a[..., :3], a[..., 3] * sign
    squared = (vector * vector).sum(axis=-1)
    small, safe = away_from_zero(squared)
    sine = np.sqrt(safe)
    ratio = np.where(small, squared / np.where(small, w * w, 1.0), 0.0)  # tan^2 of the half angle
    r = ratio
    series = 1.0 - r * (1 / 3 - r * (1 / 5 - r * (1 / 7 - r * (1 / 9 - r * (1 / 11 - r * (1 / 13))))))
    scale = 2.0 * np.where(small, series / np.where(small, w, 1.0), np.arctan2(sine, w) / sine)
    return (sign * scale)[..., None] * vector


def adjoint(a: Array) -> Array:
    """``(..., 3, 3)`` with ``a exp(w) a^-1 = exp(adjoint(a) w)``: the rotation matrix."""
    return matrix(a)


def matrix(a: Array) -> Array:
    """``(..., 3, 3)`` rotation matrix."""
    x, y, z, w = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    return np.stack(
        (
            np.stack((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)), axis=-1),
            np.stack((2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)), axis=-1),
            np.stack((2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)), axis=-1),
        ),
        axis=-2,
    )


def from_matrix(rotation: Array) -> Array:
    """Quaternions of rotation matrices ``(..., 3, 3)``.

    Taken from the row of ``4 q q^T`` whose diagonal entry is largest, which is never near zero.

    Source: Shepperd, "Quaternion from rotation matrix", 1978.
    """
    m = rotation
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    xw, yw, zw = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    outer = np.stack(
        (
            np.stack((1 + xx - yy - zz, xy, xz, xw), axis=-1),
            np.stack((xy, 1 - xx + yy - zz, yz, yw), axis=-1),
            np.stack((xz, yz, 1 - xx - yy + zz, zw), axis=-1),
            np.stack((xw, yw, zw, 1 + xx + yy + zz), axis=-1),
        ),
        axis=-2,
    )
    row = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    return canonical(np.take_along_axis(outer, row[..., None, None], axis=-2)[..., 0, :])


def retract(a: Array, delta: Array) -> Array:
    """``R Exp(delta)``."""
    return compose(a, exp(delta))


def local(a: Array, b: Array) -> Array:
    """The tangent that `retract` needs to get from `a` to `b`: ``Log(a^-1 b)``."""
    return log(_product(inverse(a), b))


def right_jacobian(w: Array) -> Array:
    """``(..., 3, 3)`` with ``Exp(w + d) ~ Exp(w) Exp(J d)``."""
    squared = (w * w).sum(axis=-1)[..., None, None]
    skew = hat(w)
    return np.eye(3) - versine_ratio(squared) * skew + sine_defect_ratio(squared) * (skew @ skew)


def right_jacobian_inverse(w: Array) -> Array:
    """``(..., 3, 3)`` with ``Log(Exp(w) Exp(d)) ~ w + J d``, for ``|w| <= pi``."""
    squared = (w * w).sum(axis=-1)[..., None, None]
    skew = hat(w)
    return np.eye(3) + 0.5 * skew + half_cotangent_defect_ratio(squared) * (skew @ skew)


def local_jacobians(a: Array, b: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., 3, 3)`` of `local` by `a` and by `b`."""
    w = local(a, b)
    return -right_jacobian_inverse(-w), right_jacobian_inverse(w)


def act_jacobians(a: Array, points: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., 3, 3)`` of `act` by the rotation and by the point."""
    rotation = matrix(a)
    by_rotation = -rotation @ hat(points)
    return by_rotation, np.broadcast_to(rotation, by_rotation.shape)


def tangent_basis(a: Array) -> Array:
    """Derivative ``(..., 4, 3)`` of the storage by the tangent of `retract` at zero."""
    x, y, z, w = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    return 0.5 * np.stack(
        (
            np.stack((w, -z, y), axis=-1),
            np.stack((z, w, -x), axis=-1),
            np.stack((-y, x, w), axis=-1),
            np.stack((-x, -y, -z), axis=-1),
        ),
        axis=-2,
    )
