"""Relative poses between the variables of a blanket, as functions of their tangents."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between, PointObservation, Prior
from clew.geometry import SE2, SE3
from clew.graph import Factor, Role
from clew.reduce.blanket import Blanket

Array = NDArray[np.float64]

WORLD = -1  # node that stands for the world's origin


def is_pose(kind: type[Any]) -> bool:
    """Whether others can be seen from a variable of this kind."""
    return kind in (SE2, SE3)


def see(blanket: Blanket, a: int, b: int) -> Array:
    """Storage of node `b` seen from node `a`, a pose or `WORLD`."""
    values = blanket.values
    if a == WORLD:
        return values[b]
    frame = blanket.kinds[a].functions
    if is_pose(blanket.kinds[b]):
        return np.asarray(frame.between(values[a], values[b]))
    return np.asarray(frame.act(frame.inverse(values[a]), values[b]))


def see_jacobian(blanket: Blanket, a: int, b: int) -> Array:
    """Derivative ``(dim, n)`` of `b` seen from `a`, in the tangent of what is seen, by all tangents of the blanket."""
    dim = blanket.kinds[b].dim
    out = np.zeros((dim, int(blanket.starts[-1])))
    if a == WORLD:
        out[:, blanket.span(b)] = np.eye(dim)
    elif is_pose(blanket.kinds[b]):
        functions = blanket.kinds[a].functions
        out[:, blanket.span(b)] = np.eye(dim)
        out[:, blanket.span(a)] = -functions.adjoint(functions.between(blanket.values[b], blanket.values[a]))
    else:
        seen = relation(blanket, a, b, see(blanket, a, b), np.eye(dim))
        _, (by_pose, by_point) = seen.linearise(blanket.values[a][None], blanket.values[b][None])
        out[:, blanket.span(a)], out[:, blanket.span(b)] = by_pose[0], by_point[0]
    return out


def measured(blanket: Blanket, a: int, b: int, step: Array) -> tuple[Array, Array]:
    """What measurement of `b` seen from `a` has its residual vanish after a step of it, to first order.

    Args:
        step: ``(dim,)`` in the tangent of what is seen.

    Returns:
        Its storage, and the matrix ``(dim, dim)`` that turns the residual of this measurement into the tangent of what
        is seen now: with both, gradient and Gauss-Newton matrix of the factor are exactly what they should be.
    """
    functions = blanket.kinds[b].functions
    now = see(blanket, a, b)
    z = np.asarray(functions.retract(now, step))
    return z, np.asarray(np.linalg.inv(functions.local_jacobians(z, now)[1]))


def relation(blanket: Blanket, a: int, b: int, measurement: Array, information: Array) -> Factor:
    """The measurement of `b` seen from `a` as a factor."""
    if a == WORLD:
        value = blanket.kinds[b].from_array(measurement)
        return Prior(blanket.keys[b], value, information=information, role=Role.MARGINAL)
    keys = blanket.keys[a], blanket.keys[b]
    if is_pose(blanket.kinds[b]):
        return Between(*keys, measurement, information=information, role=Role.MARGINAL)
    return PointObservation(*keys, measurement, information=information, role=Role.MARGINAL)
