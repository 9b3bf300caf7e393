"""How far wheel odometry can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OdometryNoise:
    """Standard deviations of an odometry increment, growing with distance and turn.

    Increments are short, so their variances (not deviations) grow linearly with the distance: errors of successive
    increments are taken as independent (Thrun, Burgard, Fox 2005, section 5.4).

    Attributes:
        translation_per_metre: metres after one metre.
        translation_per_radian: metres after a turn of one radian.
        rotation_per_metre: radians after one metre.
        rotation_per_radian: radians after a turn of one radian.
        translation_floor, rotation_floor: deviation of any increment, metres and radians (quantisation, time stamps).
    """

    translation_per_metre: float = 0.08
    translation_per_radian: float = 0.04
    rotation_per_metre: float = 0.04
    rotation_per_radian: float = 0.08
    translation_floor: float = 0.004
    rotation_floor: float = 0.002

    def covariance(self, increment: Array) -> Array:
        """Covariance ``(..., 3, 3)`` of increments ``(..., 3)``, in the tangent at their end."""
        distance = np.hypot(increment[..., 0], increment[..., 1])
        turn = np.abs(increment[..., 2])
        translation = (
            self.translation_per_metre**2 * distance + self.translation_per_radian**2 * turn + self.translation_floor**2
        )
        rotation = self.rotation_per_metre**2 * distance + self.rotation_per_radian**2 * turn + self.rotation_floor**2
        out = np.zeros((*increment.shape, 3))
        out[..., 0, 0] = out[..., 1, 1] = translation
        out[..., 2, 2] = rotation
        return out
