"""A vehicle that steers like a car."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.motion.step import MotionStep, check_positive, constant_twist, read_controls

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Ackermann:
    """Where a vehicle with steered front wheels goes; the robot frame is at the middle of the rear axle.

    Attributes:
        wheelbase: metres between the axles.
        encoder_offset: metres from the middle of the rear axle to the left to the wheel whose speed is measured
            (Victoria Park's truck: 0.76); 0 if the speed is that of the middle.
        speed_noise: deviation of the travelled distance after one metre, metres.
        steering_noise: deviation of the steering angle, radians, independent over each second.
        across_per_metre: deviation sideways (slip) after one metre, metres.
    """

    wheelbase: float
    encoder_offset: float = 0.0
    speed_noise: float = 0.05
    steering_noise: float = 0.02
    across_per_metre: float = 0.02

    def motion(self, duration: ArrayLike, speed: ArrayLike, steering: ArrayLike) -> MotionStep:
        """Motions at constant speed and steering angle: exact circular arcs.

        Args:
            duration: ``(N,)`` seconds.
            speed: ``(N,)`` of the measured wheel, metres a second.
            steering: ``(N,)`` angle of the (virtual middle) front wheel, radians, counter-clockwise.

        Returns:
            Motions; the control of their Jacobian is ``(speed, steering)``.

        Raises:
            InputError: a wheelbase that is not positive, a steering angle of 90 degrees or more or one at which the
                measured wheel stands still, numbers that are not finite.
        """
        check_positive("Ackermann", wheelbase=self.wheelbase)
        duration, speed, steering = read_controls(
            "Ackermann", duration, [("speed", speed), ("steering", steering)]
        )
        if (np.abs(steering) >= np.pi / 2).any():
            row = int(np.argmax(np.abs(steering)))
            raise InputError(f"Ackermann: steering {row} is {steering[row]:g} rad; give radians below pi / 2")
        curvature = np.tan(steering) / self.wheelbase
        # The measured wheel runs on a circle whose radius is smaller by the offset (Guivant and Nebot 2001, eq. 33).
        slower = 1.0 - self.encoder_offset * curvature
        if (slower <= 0.0).any():
            row = int(np.argmin(slower))
            raise InputError(
                f"Ackermann: steering {row} is {steering[row]:g} rad, at which the measured wheel would stand still or "
                "roll backwards; give the encoder's offset in metres to the left, and angles that the vehicle can steer"
            )
        share = 1.0 / slower
        distance = speed * duration * share
        increment, by_twist = constant_twist(
            np.stack([distance, np.zeros_like(distance), distance * curvature], axis=1)
        )
        curved = (1.0 + np.tan(steering) ** 2) / self.wheelbase
        by_inputs = np.zeros((len(duration), 3, 2))
        by_inputs[:, 0, 0] = duration * share
        by_inputs[:, 0, 1] = distance * share * self.encoder_offset * curved
        by_inputs[:, 2] = by_inputs[:, 0] * curvature[:, None]
        by_inputs[:, 2, 1] += distance * curved
        by_control = by_twist @ by_inputs
        seconds = np.maximum(duration, 1e-12)
        variance = np.zeros((len(duration), 2, 2))
        variance[:, 0, 0] = self.speed_noise**2 * np.abs(speed) / seconds
        variance[:, 1, 1] = self.steering_noise**2 / seconds
        covariance = by_control @ variance @ np.swapaxes(by_control, 1, 2)
        covariance[:, 1, 1] += self.across_per_metre**2 * np.abs(distance)
        return MotionStep(increment, by_control, covariance)
