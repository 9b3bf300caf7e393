"""Distance of a landmark without its direction: radio beacons, ultra-wideband."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.factors.measured import read_columns
from clew.factors.sensor_view import SensorView, range_jacobian, range_of
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class Range(SensorView):
    """A landmark was measured at a distance.

    Residual: ``|q| - range`` with ``q`` as in `RangeBearing`. Jacobian by ``q``: ``q^T / |q|``, times those
    of `PointObservation`. Measurement: ``(range,)``, metres.
    """

    native: ClassVar[str | None] = "range"

    def __init__(
        self,
        pose: ArrayLike,
        point: ArrayLike,
        range: ArrayLike,
        *,
        space: int = 2,
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
            space: 2 for `SE2` poses and `Point2` landmarks, 3 for `SE3` and `Point3`.
            sigmas: standard deviations, broadcast to ``(M, 1)``, metres.
            information: or information matrices.
            covariance: or covariance matrices.
            T_robot_sensor: the sensor's pose on the robot; the identity if None.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        if space not in (2, 3):
            raise InputError(f"Range: space must be 2 or 3, got {space}")
        self._set_up_view(
            pose, point, read_columns("Range", range=range), space, T_robot_sensor,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    def predict(self, q: Array) -> Array:
        """Distance, ``(M, 1)``."""
        return range_of(q)

    def predict_jacobian(self, q: Array) -> Array:
        """``(M, 1, space)``."""
        return range_jacobian(q)
