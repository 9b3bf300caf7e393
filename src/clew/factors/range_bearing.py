"""Range and bearing of a landmark."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.factors.measured import read_columns
from clew.factors.sensor_view import (
    SensorView,
    direction_jacobian,
    direction_of,
    range_jacobian,
    range_of,
    wrapped_after,
)
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class RangeBearing(SensorView):
    """A landmark was seen at a distance and in a direction, in the sensor frame.

    Residual: ``|q| - range``, ``wrap(atan2(q_y, q_x) - bearing)`` and in space
    ``atan2(q_z, hypot(q_x, q_y)) - elevation``, with ``q = R^T (p - t)`` and
    ``(t, R) = T_world_robot T_robot_sensor``. Jacobians by ``q``: ``q^T / |q|`` and
    ``(-q_y, q_x) / (q_x^2 + q_y^2)``, times those of `PointObservation`.
    Measurement: ``(range, bearing)`` or ``(range, bearing, elevation)``, metres and radians.
    """

    native: ClassVar[str | None] = "range_bearing"

    def __init__(
        self,
        pose: ArrayLike,
        point: ArrayLike,
        range: ArrayLike,
        bearing: ArrayLike,
        elevation: ArrayLike | None = None,
        *,
        sigmas: ArrayLike | None = None,
        information: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        T_robot_sensor: Any = None,
        kernel: Kernel | None = None,
        role: Role | str = Role.OBSERVATION,
    ) -> None:
        """One sighting, or ``M`` of them.

        Args:
            pose: key of the robot's pose, or ``(M,)`` keys.
            point: key of the landmark, or ``(M,)`` keys.
            range: distance, metres, or ``(M,)``.
            bearing: angle from the sensor's x axis, counter-clockwise, radians, or ``(M,)``.
            elevation: angle above the sensor's x-y plane, radians; given for `SE3` poses, None for `SE2`.
            sigmas: standard deviations, broadcast to ``(M, 2)`` or ``(M, 3)``; metres, radians.
            information: or information matrices.
            covariance: or covariance matrices.
            T_robot_sensor: the sensor's pose on the robot; the identity if None.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        columns = {"range": range, "bearing": bearing}
        if elevation is not None:
            columns["elevation"] = elevation
        self._set_up_view(
            pose, point, read_columns("RangeBearing", **columns), len(columns), T_robot_sensor,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    def predict(self, q: Array) -> Array:
        """Range and direction, ``(M, space)``."""
        return np.concatenate((range_of(q), direction_of(q)), axis=-1)

    def predict_jacobian(self, q: Array) -> Array:
        """``(M, space, space)``."""
        return np.concatenate((range_jacobian(q), direction_jacobian(q)), axis=-2)

    def residual(self, *values: Array, measurement: Array) -> Array:
        """Predicted minus measured, ``(M, space)``; angles wrapped."""
        return wrapped_after(1, super().residual(*values, measurement=measurement))
