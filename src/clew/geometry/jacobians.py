"""Jacobians of group operations by the tangents of `retract`, for every manifold alike.

`retract` agrees with the group's right perturbation to first order, so these are the usual right Jacobians
(Sola et al. 2018, section II.D), and one line each holds for all groups.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from clew.geometry.manifold import ManifoldFunctions

Array = NDArray[np.float64]


class HasFunctions(Protocol):
    """A geometry class, as far as these functions need it."""

    @property
    def functions(self) -> ManifoldFunctions:
        """Its array layer."""
        ...

    @property
    def dim(self) -> int:
        """Length of a tangent."""
        ...


def compose_jacobians(kind: HasFunctions, a: Array, b: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., dim, dim)`` of ``a b`` by `a` and by `b`, all in the tangent of the result."""
    f = kind.functions
    by_a = f.adjoint(f.inverse(b))
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    eye = np.eye(kind.dim)
    return np.broadcast_to(by_a, (*shape, *eye.shape)), np.broadcast_to(eye, (*shape, *eye.shape))


def inverse_jacobian(kind: HasFunctions, a: Array) -> Array:
    """Derivative ``(..., dim, dim)`` of ``a^-1``."""
    return -kind.functions.adjoint(a)


def between_jacobians(kind: HasFunctions, a: Array, b: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., dim, dim)`` of ``a^-1 b`` by `a` and by `b`."""
    f = kind.functions
    by_a = -f.adjoint(f.between(b, a))
    return by_a, np.broadcast_to(np.eye(kind.dim), by_a.shape)


def act_jacobians(kind: HasFunctions, a: Array, points: Array) -> tuple[Array, Array]:
    """Derivatives of moved points by `a`, ``(..., space, dim)``, and by them, ``(..., space, space)``."""
    return kind.functions.act_jacobians(a, points)


def local_jacobians(kind: HasFunctions, a: Array, b: Array) -> tuple[Array, Array]:
    """Derivatives ``(..., dim, dim)`` of `local` by `a` and by `b`."""
    return kind.functions.local_jacobians(a, b)
