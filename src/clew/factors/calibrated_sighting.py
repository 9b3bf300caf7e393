"""Range and bearing by a sensor whose mounting and distortion are estimated too.

A camera that measures how large a mark appears measures depth along its axis rather than distance, and looks from
where it is mounted. Both show as errors that depend smoothly on where in the picture the mark is, so the models have
a correction that is quadratic in the measured bearing. ``f_1`` and ``f_2`` are the measured bearing and its square,
each less a constant that the caller chooses.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.factors.measured import Measured, read_columns, read_keys
from clew.factors.sensor_view import direction_jacobian, direction_of, range_jacobian, range_of
from clew.geometry import SE2, Point2, se2, so2, wrap
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class CalibratedSighting(Measured):
    """Base of `CalibratedRange` and `CalibratedBearing`.

    Keys: the robot's pose; what was seen, a landmark (`Point2`) or another robot (`SE2`); points of parameters, the
    last of which is ``(bearing curve, forward)``. ``q`` is what was seen, from `forward` metres ahead of the robot's
    centre: ``q = R^T (p - t) - (forward, 0)``. Measurement: the number measured, ``f_1``, ``f_2``.
    """

    def __init__(
        self,
        pose: ArrayLike,
        target: ArrayLike,
        parameters: Sequence[ArrayLike],
        measured: ArrayLike,
        f1: ArrayLike,
        f2: ArrayLike,
        *,
        sees: type[Any] = Point2,
        sigmas: ArrayLike | None = None,
        information: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        kernel: Kernel | None = None,
        role: Role | str = Role.OBSERVATION,
    ) -> None:
        """One sighting, or ``M`` of them.

        Args:
            pose: key of the robot's pose, or ``(M,)`` keys.
            target: key of what was seen, or ``(M,)`` keys.
            parameters: keys of the two points of parameters, in the order of the class's docstring.
            measured: metres or radians, or ``(M,)``.
            f1: the measured bearing less a constant, radians.
            f2: its square less a constant.
            sees: `Point2` for landmarks, `SE2` for robots.
            sigmas: standard deviation, or ``(M, 1)``.
            information: or information matrices ``(M, 1, 1)``.
            covariance: or covariance matrices.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        what = type(self).__name__
        if sees not in (Point2, SE2):
            raise InputError(f"{what}: sees is {sees!r}; give Point2 for landmarks or SE2 for robots")
        if len(parameters) != 2:
            raise InputError(f"{what}: {len(parameters)} points of parameters; it needs 2")
        self._set_up(
            read_keys((pose, target, *parameters), what), (SE2, sees, Point2, Point2),
            read_columns(what, measured=measured, f1=f1, f2=f2), 1,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    @abstractmethod
    def _error(self, q: Array, *parameters: Array, measurement: Array) -> Array:
        """Residual ``(M, 1)``."""

    @abstractmethod
    def _derivatives(self, q: Array, *parameters: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, 1, 2)`` by ``q`` and by each point of parameters, `forward` left to the caller."""

    def _view(self, pose: Array, target: Array, last: Array) -> Array:
        q = se2.act(se2.inverse(pose), target[:, :2])
        return np.stack([q[:, 0] - last[:, 1], q[:, 1]], axis=1)

    def residual(self, *values: Array, measurement: Array) -> Array:
        """Predicted minus measured, ``(M, 1)``."""
        pose, target, *parameters = values
        return self._error(self._view(pose, target, parameters[-1]), *parameters, measurement=measurement)

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, 1, dim)`` by each variable."""
        pose, target, *parameters = values
        q = self._view(pose, target, parameters[-1])
        by_q, *by_parameters = self._derivatives(q, *parameters, measurement=measurement)
        robot = np.stack([q[:, 0] + parameters[-1][:, 1], q[:, 1]], axis=1)
        turned = np.stack([robot[:, 1], -robot[:, 0]], axis=1)[:, :, None]
        by_pose = np.concatenate([-by_q, by_q @ turned], axis=2)
        by_target = by_q @ so2.matrix(-pose[:, 2:])
        if target.shape[1] == 3:  # a pose moves in its own frame, and its heading does not matter
            by_target = np.concatenate([by_target @ so2.matrix(target[:, 2:]), np.zeros((len(q), 1, 1))], axis=2)
        by_parameters[-1] = by_parameters[-1].copy()
        by_parameters[-1][:, :, 1] -= by_q[:, :, 0]
        return by_pose, by_target, *by_parameters


class CalibratedRange(CalibratedSighting):
    """Distance of what was seen.

    Residual: ``|q| (1 + slope f_1 + curve f_2) - range``. Parameters: ``(slope, curve)``, ``(bearing curve, forward)``.
    """

    def _error(self, q: Array, *parameters: Array, measurement: Array) -> Array:
        return range_of(q) * self._stretch(parameters[0], measurement) - measurement[:, :1]

    @staticmethod
    def _stretch(first: Array, measurement: Array) -> Array:
        result: Array = 1.0 + (first * measurement[:, 1:]).sum(axis=1, keepdims=True)
        return result

    def _derivatives(self, q: Array, *parameters: Array, measurement: Array) -> tuple[Array, ...]:
        distance = range_of(q)
        by_q = range_jacobian(q) * self._stretch(parameters[0], measurement)[:, :, None]
        return by_q, (distance * measurement[:, 1:])[:, None], np.zeros((len(q), 1, 2))


class CalibratedBearing(CalibratedSighting):
    """Direction of what was seen.

    Residual: ``wrap(atan2(q_y, q_x) + offset + slope f_1 + curve f_2 - bearing)``. Parameters: ``(offset, slope)``,
    ``(curve, forward)``.
    """

    def _error(self, q: Array, *parameters: Array, measurement: Array) -> Array:
        first, last = parameters
        shift = first[:, 0] + first[:, 1] * measurement[:, 1] + last[:, 0] * measurement[:, 2]
        return wrap(direction_of(q) + (shift - measurement[:, 0])[:, None])

    def _derivatives(self, q: Array, *parameters: Array, measurement: Array) -> tuple[Array, ...]:
        one = np.ones(len(q))
        first = np.stack([one, measurement[:, 1]], axis=1)[:, None]
        last = np.stack([measurement[:, 2], 0.0 * one], axis=1)[:, None]
        return direction_jacobian(q), first, last
