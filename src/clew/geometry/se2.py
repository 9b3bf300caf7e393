"""Rigid motions of the plane on plain arrays ``(..., 3)``: ``(x, y, theta)``, theta in ``(-pi, pi]``.

Tangents are ``(..., 3)``, translation first. `retract` is decoupled and *not* ``compose(a, exp(delta))``;
both agree to first order, so Jacobians of the group operations are those of the usual right perturbation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import so2
from clew.geometry.angles import half_cotangent, sinc, versine_ratio, wrap

Array = NDArray[np.float64]


def _stacked(x: Array, y: Array, theta: Array) -> Array:
    """Poses of their numbers; a single one, of which each scan makes dozens, without the cost of stacking arrays."""
    if isinstance(theta, np.float64):
        return np.array((x, y, theta))
    return np.stack((x, y, theta), axis=-1)


def canonical(a: Array) -> Array:
    """The storage that stands for a pose: theta wrapped."""
    return _stacked(a[..., 0], a[..., 1], wrap(a[..., 2]))


def compose(a: Array, b: Array) -> Array:
    """``a b``: first `b`, then `a`."""
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = b[..., 0], b[..., 1]
    return _stacked(a[..., 0] + cos * x - sin * y, a[..., 1] + sin * x + cos * y, wrap(a[..., 2] + b[..., 2]))


def inverse(a: Array) -> Array:
    """``a^-1``."""
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = a[..., 0], a[..., 1]
    return _stacked(-cos * x - sin * y, sin * x - cos * y, wrap(-a[..., 2]))


def between(a: Array, b: Array) -> Array:
    """``a^-1 b``: pose `b` as seen from pose `a`."""
    theta = a[..., 2]
    cos, sin = np.cos(theta), np.sin(theta)
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return _stacked(cos * dx + sin * dy, cos * dy - sin * dx, wrap(b[..., 2] - theta))


def act(a: Array, points: Array) -> Array:
    """Points ``(..., 2)`` mapped by the pose: ``t + R p``."""
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x, y = points[..., 0], points[..., 1]
    return np.stack((a[..., 0] + cos * x - sin * y, a[..., 1] + sin * x + cos * y), axis=-1)


def exp(tangent: Array) -> Array:
    """Group exponential: the motion with constant body velocity `tangent` for unit time."""
    x, y, theta = tangent[..., 0], tangent[..., 1], tangent[..., 2]
    squared = theta * theta
    along, across = sinc(squared), theta * versine_ratio(squared)
    return _stacked(along * x - across * y, across * x + along * y, wrap(theta))


def log(a: Array) -> Array:
    """Inverse of `exp` for angles in ``(-pi, pi]``."""
    x, y, theta = a[..., 0], a[..., 1], wrap(a[..., 2])
    along, across = half_cotangent(theta * theta), 0.5 * theta
    return _stacked(along * x + across * y, along * y - across * x, theta)


def adjoint(a: Array) -> Array:
    """``(..., 3, 3)`` with ``a exp(v) a^-1 = exp(adjoint(a) v)``."""
    out = _turned(a)
    out[..., 0, 2], out[..., 1, 2] = a[..., 1], -a[..., 0]
    return out


def matrix(a: Array) -> Array:
    """``(..., 3, 3)`` homogeneous matrix."""
    out = _turned(a)
    out[..., :2, 2] = a[..., :2]
    return out


def _turned(a: Array) -> Array:
    """``(..., 3, 3)`` with the rotation of `a` in the upper left, laid out entry by entry: stacking costs more."""
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    out = np.zeros((*a.shape[:-1], 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = cos
    out[..., 0, 1], out[..., 1, 0] = -sin, sin
    out[..., 2, 2] = 1.0
    return out


def retract(a: Array, delta: Array) -> Array:
    """``t + R v, theta + w`` for ``delta = (v, w)``."""
    return compose(a, delta)


def local(a: Array, b: Array) -> Array:
    """The tangent that `retract` needs to get from `a` to `b`."""
    return between(a, b)


def local_jacobians(a: Array, b: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., 3, 3)`` of `local` by `a` and by `b`."""
    relative = between(a, b)
    by_b = np.zeros((*relative.shape, 3))
    by_b[..., :2, :2] = so2.matrix(relative[..., 2:])
    by_b[..., 2, 2] = 1.0
    by_a = np.zeros((*relative.shape, 3))
    by_a[..., [0, 1, 2], [0, 1, 2]] = -1.0
    by_a[..., 0, 2] = relative[..., 1]
    by_a[..., 1, 2] = -relative[..., 0]
    return by_a, by_b


def act_jacobians(a: Array, points: Array) -> tuple[Array, Array]:
    """Derivatives of `act` by the pose, ``(..., 2, 3)``, and by the point, ``(..., 2, 2)``."""
    turned, by_point = so2.act_jacobians(a[..., 2:], points)
    return np.concatenate((by_point, turned), axis=-1), by_point


def tangent_basis(a: Array) -> Array:
    """Derivative ``(..., 3, 3)`` of the storage by the tangent of `retract` at zero."""
    # laid out entry by entry, as forward differentiation uses it
    entries = np.zeros((3, 3, *a.shape[:-1]))
    entries[0, 0] = entries[1, 1] = np.cos(a[..., 2])
    entries[0, 1] = np.sin(a[..., 2])
    entries[1, 0] = -entries[0, 1]
    entries[2, 2] = 1.0
    return np.moveaxis(entries, (0, 1), (-1, -2))
