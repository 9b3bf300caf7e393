"""Absolute position of a pose: satellite navigation, total stations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.factors.measured import POSES, Measured, read_element, read_keys, read_sensor
from clew.geometry import Point2, Point3
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class Position(Measured):
    """The sensor on a pose was measured at ``z`` in the world frame.

    Residual: ``t + R l - z`` with ``(t, R) = T_world_robot`` and the lever arm ``l``, the translation of
    ``T_robot_sensor``. Jacobian: ``R [I, -[l]x]`` (in the plane the last column is ``R (-l_y, l_x)``).
    Measurement: ``(x, y)`` or ``(x, y, z)``, metres.
    """

    def __init__(
        self,
        pose: ArrayLike,
        measurement: Point2 | Point3 | ArrayLike,
        *,
        sigmas: ArrayLike | None = None,
        information: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        T_robot_sensor: Any = None,
        kernel: Kernel | None = None,
        role: Role | str = Role.OBSERVATION,
    ) -> None:
        """One fix, or ``M`` of them.

        Args:
            pose: key of the robot's pose, or ``(M,)`` keys.
            measurement: position of the sensor in the world frame, ``(2,)`` or ``(3,)``, or a batch.
            sigmas: standard deviations along the world axes, broadcast to ``(M, space)``, metres.
            information: or information matrices.
            covariance: or covariance matrices.
            T_robot_sensor: the sensor's pose on the robot; the identity if None.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        kind, array = read_element(measurement, (Point2, Point3), "Position: measurement")
        pose_kind = POSES[kind.space]
        self._set_up(
            read_keys((pose,), "Position"), (pose_kind,), array, kind.dim,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip
        self.T_robot_sensor = read_sensor(T_robot_sensor, pose_kind, "Position")

    def _lever_arm(self) -> Array:
        space = self.measurement.shape[1]
        return np.zeros(space) if self.T_robot_sensor is None else self.T_robot_sensor[:space]

    def residual(self, *values: Array, measurement: Array) -> Array:
        """``t + R l - z``, ``(M, space)``, metres."""
        moved: Array = self.kinds[0].functions.act(values[0], self._lever_arm())
        return moved - measurement

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, space, dim)``."""
        return (self.kinds[0].functions.act_jacobians(values[0], self._lever_arm())[0],)
