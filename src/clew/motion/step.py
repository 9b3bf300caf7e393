"""What every motion model gives: short motions, their Jacobians and their covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry import se2

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MotionStep:
    """Motions of a robot in the plane, as a batch.

    Attributes:
        increment: ``(N, 3)`` pose after the motion, seen from the pose before it.
        by_control: ``(N, 3, k)`` derivative of the pose after the motion (in the tangent of `retract` there) by the
            model's control.
        covariance: ``(N, 3, 3)`` covariance in the tangent of `retract` at the pose after the motion.
    """

    increment: Array
    by_control: Array
    covariance: Array

    def __len__(self) -> int:
        return len(self.increment)

    def predict(self, T_world_robot: ArrayLike) -> Array:
        """Poses ``(N, 3)`` after the motions that begin at poses ``(N, 3)`` or ``(3,)``."""
        return se2.compose(np.asarray(T_world_robot, np.float64), self.increment)

    @property
    def by_pose(self) -> Array:
        """``(N, 3, 3)`` derivative of the pose after the motion by the pose before it, tangent to tangent."""
        return se2.adjoint(se2.inverse(self.increment))


def constant_twist(twist: Array) -> tuple[Array, Array]:
    """Motions ``(..., 3)`` with constant body velocity for unit time, and their derivative ``(..., 3, 3)`` by it.

    The motion is `se2.exp` (an exact arc). The derivative by ``(x, y, theta)`` of the twist, in the tangent at the
    end, is the right Jacobian of SE(2): Sola, Deray, Atchuthan 2018, "A micro Lie theory", equation 163.
    """
    x, y, theta = twist[..., 0], twist[..., 1], twist[..., 2]
    small = np.abs(theta) < 1e-4
    safe = np.where(small, 1.0, theta)
    square = theta * theta
    sine = np.where(small, 1.0 - square / 6.0, np.sin(safe) / safe)
    versine = np.where(small, theta / 2.0, (1.0 - np.cos(safe)) / safe)
    # (theta - sin theta) / theta^2 and (1 - cos theta) / theta^2
    a = np.where(small, theta / 6.0, (safe - np.sin(safe)) / (safe * safe))
    b = np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(safe)) / (safe * safe))
    by_twist = np.zeros((*twist.shape, 3))
    by_twist[..., 0, 0] = by_twist[..., 1, 1] = sine
    by_twist[..., 0, 1], by_twist[..., 1, 0] = versine, -versine
    by_twist[..., 0, 2] = a * x - b * y
    by_twist[..., 1, 2] = a * y + b * x
    by_twist[..., 2, 2] = 1.0
    return se2.exp(twist), by_twist


def read_controls(what: str, durations: ArrayLike, controls: Sequence[tuple[str, ArrayLike]]) -> tuple[Array, ...]:
    """Durations ``(N,)`` and each control ``(N,)``, broadcast against each other.

    Raises:
        InputError: a number that is not finite, a negative duration, or lengths that do not fit.
    """
    named = [("duration", durations), *controls]
    try:
        arrays = np.broadcast_arrays(*(np.asarray(given, np.float64).reshape(-1) for _, given in named))
    except (TypeError, ValueError):
        raise InputError(f"{what}: {', '.join(name for name, _ in named)} must be numbers of equal length") from None
    for (name, _), array in zip(named, arrays, strict=True):
        if not np.isfinite(array).all():
            raise InputError(f"{what}: {name} {int(np.argmin(np.isfinite(array)))} is not finite; leave it out")
    if (arrays[0] < 0.0).any():
        raise InputError(f"{what}: duration {int(np.argmin(arrays[0]))} is negative; sort the readings by time")
    return tuple(np.array(array) for array in arrays)


def check_positive(what: str, **values: float) -> None:
    """Raise InputError for a length that is not positive and finite."""
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{what}: {name} must be positive metres, got {value}")
