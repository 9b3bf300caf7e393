"""Speed and turn rate: the velocity model of a robot that cannot move sideways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.motion.step import MotionStep, constant_twist, read_controls

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VelocityNoise:
    """Random walks that disturb a motion; variances grow with the distance, the turn and the time.

    Errors of successive readings are independent, so variances and not deviations add up (Thrun, Burgard, Fox 2005,
    section 5.3, whose variances grow with the square of the velocity and so depend on the rate of the readings).

    Attributes:
        along_per_metre: metres along the path after one metre.
        across_per_metre: metres sideways (slip) after one metre.
        rotation_per_metre: radians after one metre.
        rotation_per_radian: radians after a turn of one radian.
        translation_per_second: metres in each direction after one second, moving or not.
        rotation_per_second: radians after one second, moving or not.
    """

    along_per_metre: float = 0.08
    across_per_metre: float = 0.04
    rotation_per_metre: float = 0.08
    rotation_per_radian: float = 0.1
    translation_per_second: float = 0.002
    rotation_per_second: float = 0.002

    def components(self, duration: Array, speed: Array, turn_rate: Array) -> Array:
        """Covariances ``(6, N, 3, 3)`` of single readings, one a field in the order above; their sum is the whole.

        Each is proportional to the square of its field, which makes the fields easy to estimate.
        """
        metres, radians = np.abs(speed) * duration, np.abs(turn_rate) * duration
        out = np.zeros((6, len(duration), 3, 3))
        out[0, :, 0, 0] = self.along_per_metre**2 * metres
        out[1, :, 1, 1] = self.across_per_metre**2 * metres
        out[2, :, 2, 2] = self.rotation_per_metre**2 * metres
        out[3, :, 2, 2] = self.rotation_per_radian**2 * radians
        out[4, :, 0, 0] = out[4, :, 1, 1] = self.translation_per_second**2 * duration
        out[5, :, 2, 2] = self.rotation_per_second**2 * duration
        return out

    def covariance(self, duration: Array, speed: Array, turn_rate: Array) -> Array:
        """Covariances ``(N, 3, 3)`` of single readings, in the tangent at the end of each."""
        total: Array = self.components(duration, speed, turn_rate).sum(axis=0)
        return total


def velocity_motion(
    duration: ArrayLike, speed: ArrayLike, turn_rate: ArrayLike, noise: VelocityNoise | None = None
) -> MotionStep:
    """Motion at constant speed and turn rate: an exact circular arc, not the Euler step.

    Args:
        duration: ``(N,)`` seconds.
        speed: ``(N,)`` metres a second, forward.
        turn_rate: ``(N,)`` radians a second, counter-clockwise.
        noise: defaults to `VelocityNoise`.

    Returns:
        Motions; the control of their Jacobian is ``(speed, turn_rate)``.

    Raises:
        InputError: numbers that are not finite, negative durations, lengths that do not fit.
    """
    duration, speed, turn_rate = read_controls(
        "velocity_motion", duration, [("speed", speed), ("turn_rate", turn_rate)]
    )
    twist = np.stack([speed * duration, np.zeros_like(speed), turn_rate * duration], axis=1)
    increment, by_twist = constant_twist(twist)
    by_control = by_twist[:, :, [0, 2]] * duration[:, None, None]
    covariance = (noise or VelocityNoise()).covariance(duration, speed, turn_rate)
    return MotionStep(increment, by_control, covariance)
