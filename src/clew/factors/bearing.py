"""Direction of a landmark without its distance."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.factors.measured import read_columns
from clew.factors.sensor_view import SensorView, direction_jacobian, direction_of, wrapped_after
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class Bearing(SensorView):
    """A landmark was seen in a direction, in the sensor frame.

    Residual: ``wrap(atan2(q_y, q_x) - bearing)``, in space also ``atan2(q_z, hypot(q_x, q_y)) - elevation``,
    with ``q`` as in `RangeBearing`. Jacobian by ``q``: ``(-q_y, q_x) / (q_x^2 + q_y^2)``, times those of
    `PointObservation`. Measurement: ``(bearing,)`` or ``(bearing, elevation)``, radians.
    """

    native: ClassVar[str | None] = "bearing"

    def __init__(
        self,
        pose: ArrayLike,
        point: ArrayLike,
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
            bearing: angle from the sensor's x axis, counter-clockwise, radians, or ``(M,)``.
            elevation: angle above the sensor's x-y plane, radians; given for `SE3` poses, None for `SE2`.
            sigmas: standard deviations, broadcast to ``(M, 1)`` or ``(M, 2)``; radians.
            information: or information matrices.
            covariance: or covariance matrices.
            T_robot_sensor: the sensor's pose on the robot; the identity if None.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        columns = {"bearing": bearing}
        if elevation is not None:
            columns["elevation"] = elevation
        self._set_up_view(
            pose, point, read_columns("Bearing", **columns), 1 + len(columns), T_robot_sensor,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    def predict(self, q: Array) -> Array:
        """Direction, ``(M, space - 1)``."""
        return direction_of(q)

    def predict_jacobian(self, q: Array) -> Array:
        """``(M, space - 1, space)``."""
        return direction_jacobian(q)

    def residual(self, *values: Array, measurement: Array) -> Array:
        """Predicted minus measured, ``(M, space - 1)``; angles wrapped."""
        return wrapped_after(0, super().residual(*values, measurement=measurement))
