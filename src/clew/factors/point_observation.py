"""Position of a landmark as seen from a pose."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.factors.measured import read_element
from clew.factors.sensor_view import SensorView
from clew.geometry import Point2, Point3
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class PointObservation(SensorView):
    """A landmark was seen at ``z`` in the sensor frame.

    Residual: ``q - z`` with ``q = R^T (p - t)``, ``(t, R) = T_world_robot T_robot_sensor``.
    Jacobians: ``[-I, [q]x] Ad(T_robot_sensor^-1)`` by the pose (in the plane the last column is
    ``(q_y, -q_x)``), ``R^T`` by the landmark. Measurement: ``(x, y)`` or ``(x, y, z)``, metres.
    """

    native: ClassVar[str | None] = "point"

    def __init__(
        self,
        pose: ArrayLike,
        point: ArrayLike,
        measurement: Point2 | Point3 | ArrayLike,
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
            measurement: landmark in the sensor frame, ``(2,)`` or ``(3,)``, or a batch ``(M, 2)`` or ``(M,
                3)``.
            sigmas: standard deviations, broadcast to ``(M, space)``, metres.
            information: or information matrices.
            covariance: or covariance matrices.
            T_robot_sensor: the sensor's pose on the robot; the identity if None.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        kind, array = read_element(measurement, (Point2, Point3), "PointObservation: measurement")
        self._set_up_view(
            pose, point, array, kind.space, T_robot_sensor,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    def predict(self, q: Array) -> Array:
        """``q``, ``(M, space)``, metres."""
        return q

    def predict_jacobian(self, q: Array) -> Array:
        """The identity, ``(M, space, space)``."""
        return np.broadcast_to(np.eye(q.shape[-1]), (*q.shape, q.shape[-1]))
