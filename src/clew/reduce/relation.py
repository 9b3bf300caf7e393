"""Relative poses between the variables of a blanket, many at once, as functions of their tangents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between, PointObservation, Prior
from clew.geometry import SE2, SE3
from clew.graph import Factor, Role
from clew.reduce.blanket import Blanket

Array = NDArray[np.float64]
Index = NDArray[np.int64]

WORLD = -1  # node that stands for the world's origin


def is_pose(kind: type[Any]) -> bool:
    """Whether others can be seen from a variable of this kind."""
    return kind in (SE2, SE3)


@dataclass(frozen=True)
class Relations:
    """``P`` variables of one kind, each seen from a pose or from the world.

    Attributes:
        kind: of what is seen.
        a, b: ``(P,)`` nodes of the blanket; all `a` are `WORLD`, or none.
        now: ``(P, storage)`` what is seen at the blanket's values.
        jacobian: ``(P, dim, n)`` derivative of what is seen, in its tangent, by all tangents of the blanket.
    """

    kind: Any
    a: Index
    b: Index
    now: Array
    jacobian: Array

    def measured(self, step: Array) -> tuple[Array, Array]:
        """The measurements whose residuals vanish after a step ``(n,)`` of the blanket, to first order.

        Returns:
            Their storages ``(P, storage)``, and matrices ``(P, dim, dim)`` that turn their residuals into the tangents
            of what is seen now: with both, gradient and Gauss-Newton matrix of the factors are exactly as they should.
        """
        z = self.kind.functions.retract(self.now, self.jacobian @ step)
        return z, np.asarray(np.linalg.inv(self.kind.functions.local_jacobians(z, self.now)[1]))

    def factors(self, blanket: Blanket, step: Array, information: Array) -> Factor:
        """The relations as one block of factors; `information` ``(P, dim, dim)`` is that of what is seen now."""
        z, turn = self.measured(step)
        information = turn.transpose(0, 2, 1) @ information @ turn
        information = 0.5 * (information + information.transpose(0, 2, 1))
        keys = np.asarray(blanket.keys)
        if self.a[0] == WORLD:
            return Prior(keys[self.b], self.kind.from_array(z), information=information, role=Role.MARGINAL)
        kind = Between if is_pose(self.kind) else PointObservation
        return kind(keys[self.a], keys[self.b], z, information=information, role=Role.MARGINAL)


def relations(blanket: Blanket, a: Index, b: Index) -> Relations:
    """Nodes `b`, all of one kind, seen from nodes `a`, all of them poses or all of them `WORLD`."""
    kind: Any = blanket.kinds[b[0]]
    seen = np.stack([blanket.values[i] for i in b])
    rows, across = np.arange(len(b))[:, None, None], np.arange(kind.dim)
    jacobian = np.zeros((len(b), kind.dim, int(blanket.starts[-1])))
    of_b = rows, across[None, :, None], (blanket.starts[b][:, None] + across)[:, None, :]
    if a[0] == WORLD:
        jacobian[of_b] = np.eye(kind.dim)
        return Relations(kind, a, b, seen, jacobian)
    frame: Any = blanket.kinds[a[0]]
    functions = frame.functions
    poses = np.stack([blanket.values[i] for i in a])
    of_a = rows, across[None, :, None], (blanket.starts[a][:, None] + np.arange(frame.dim))[:, None, :]
    if is_pose(kind):
        now = functions.between(poses, seen)
        jacobian[of_b] = np.eye(kind.dim)
        jacobian[of_a] = -functions.adjoint(functions.inverse(now))
    else:
        inverse = functions.inverse(poses)
        now = functions.act(inverse, seen)
        by_inverse, jacobian[of_b] = functions.act_jacobians(inverse, seen)
        # A step of a pose on the right moves its inverse by minus the adjoint of that step.
        jacobian[of_a] = -by_inverse @ functions.adjoint(poses)
    return Relations(kind, a, b, now, jacobian)
