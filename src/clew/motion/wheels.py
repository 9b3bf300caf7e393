"""Two driven wheels with encoders (differential drive)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.motion.step import MotionStep, check_positive, constant_twist, read_controls

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WheelEncoders:
    """Where the wheels of a differential drive take the robot.

    The variance of a wheel's travel is proportional to the travel: Chong and Kleeman 1997, "Accurate odometry and
    error modelling for a mobile robot".

    Attributes:
        track: metres between the wheels.
        slip_per_metre: deviation of a wheel's travel after one metre, metres.
        resolution: metres of travel that one tick of the encoder stands for; 0 if it does not matter.
        across_per_metre: deviation sideways after one metre, metres.
    """

    track: float
    slip_per_metre: float = 0.02
    resolution: float = 0.0
    across_per_metre: float = 0.01

    def motion(self, left: ArrayLike, right: ArrayLike) -> MotionStep:
        """Motions from the travel ``(N,)`` of the left and the right wheel, metres.

        The control of the Jacobian is ``(left, right)``.

        Raises:
            InputError: a track that is not positive, numbers that are not finite, lengths that do not fit.
        """
        check_positive("WheelEncoders", track=self.track)
        _, left, right = read_controls("WheelEncoders", 0.0, [("left", left), ("right", right)])
        distance, turn = (left + right) / 2.0, (right - left) / self.track
        increment, by_twist = constant_twist(np.stack([distance, np.zeros_like(turn), turn], axis=1))
        by_wheels = np.array([[0.5, 0.5], [0.0, 0.0], [-1.0 / self.track, 1.0 / self.track]])
        by_control = by_twist @ by_wheels
        variance = np.zeros((len(left), 2, 2))
        rounding = self.resolution**2 / 6.0  # of the difference of two rounded readings, each even over one tick
        variance[:, 0, 0] = self.slip_per_metre**2 * np.abs(left) + rounding
        variance[:, 1, 1] = self.slip_per_metre**2 * np.abs(right) + rounding
        covariance = by_control @ variance @ np.swapaxes(by_control, 1, 2)
        covariance[:, 1, 1] += self.across_per_metre**2 * np.abs(distance)
        return MotionStep(increment, by_control, covariance)
