"""How good a gyro is, learnt from turns that were measured otherwise."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.motion.calibration import FREEDOM, explain_variances

Array = NDArray[np.float64]

WINDOW = 300  # turns that the estimate rests on: biases wander with temperature
EVERY = 4  # turns between two estimates
FLOOR = 0.0005  # radians; deviation of any turn (time stamps)
ALONG = (0.8, 1.25)  # slopes of the turns of a gyro that works over those of the robot
TURNED = 0.7  # radians; root of the sum of squared turns of the robot from which that can be told


@dataclass(frozen=True)
class GyroNoise:
    """What is believed of a gyro before it has been compared: that of a cheap one.

    Attributes:
        density: radians after one second (angle random walk).
        per_radian: radians after a turn of one radian, its variance growing with the turn (time stamps that jitter).
        bias: deviation of the bias, radians a second.
        scale: deviation of the share by which rates are wrong.
        delay: deviation of the time by which readings are stamped too early or too late, seconds.
    """

    density: float = 0.005
    per_radian: float = 0.02
    bias: float = 0.05
    scale: float = 0.02
    delay: float = 0.02


@dataclass(frozen=True)
class GyroQuality:
    """What is known of a gyro. A turn is told as ``(3,)`` seconds, radians, and change of the rate (`GyroHeading`).

    Attributes:
        coefficients: ``(3,)`` bias in radians a second, share by which turns are too large, and seconds by which
            readings are stamped too early.
        covariance: ``(3, 3)`` of them.
        variances: ``(2,)`` of a turn, radians^2: by second and by radian turned.
        steps: how many turns these rest on.
    """

    coefficients: Array
    covariance: Array
    variances: Array
    steps: int

    @staticmethod
    def assumed(noise: GyroNoise) -> GyroQuality:
        """What is believed before any turn."""
        return GyroQuality(np.zeros(3), np.diag(np.square([noise.bias, noise.scale, noise.delay])),
                           np.square([noise.density, noise.per_radian]), 0)  # fmt: skip

    def correct(self, told: Array) -> float:
        """The turn without the gyro's systematic errors, radians."""
        return float(told[1] - told @ self.coefficients)

    def rate(self, rate: float) -> float:
        """A rate without the gyro's systematic errors, radians a second."""
        return float(rate - self.coefficients[0] - self.coefficients[1] * rate)

    def variance(self, told: Array) -> float:
        """Variance of the corrected turn, radians^2: noise, and what is not known of the systematic errors."""
        noise = self.variances @ np.abs(told[:2]) + FLOOR**2
        return float(noise + told @ self.covariance @ told)

    def to_dict(self) -> dict[str, object]:
        """Plain numbers for a report."""
        deviation = np.sqrt(np.diag(self.covariance))
        return {
            "turns": self.steps,
            "noise_rad_per_sqrt_second": round(float(np.sqrt(self.variances[0])), 6),
            "noise_rad_per_sqrt_radian": round(float(np.sqrt(self.variances[1])), 6),
            "bias_rad_per_second": round(float(self.coefficients[0]), 6),
            "bias_deviation_rad_per_second": round(float(deviation[0]), 6),
            "scale_error": round(float(self.coefficients[1]), 5),
            "stamped_late_seconds": round(-float(self.coefficients[2]), 4),
        }


class GyroCalibration:
    """Estimates bias, scale, time offset and noise of a gyro from turns of known size, again and again.

    As `OdometryCalibration` does for odometry: Bayesian linear regression with Student's t weights, and variances by
    multiplicative updates of their likelihood. A robot that stood for long gives one turn over many seconds, which
    tells the bias best.

    Args:
        noise: what is believed until turns tell otherwise.

    Attributes:
        quality: what is known so far.
        slope: how much the gyro tells for each radian that the robot turns, None before it has turned enough. Near one
            for any gyro that works, -1 for one mounted upside down that nobody told of.
    """

    def __init__(self, noise: GyroNoise) -> None:
        self._assumed = GyroQuality.assumed(noise)
        self._rows: deque[Array] = deque(maxlen=WINDOW)
        self._count = 0
        self.quality = self._assumed
        self.slope: float | None = None

    def add(self, told: Array, measured: float, known: float, variance: float) -> None:
        """Take a turn.

        Args:
            told: ``(3,)`` what the gyro says: seconds, radians, change of the rate.
            measured: radians that the robot turned.
            known: in [0, 1], how much `measured` counts.
            variance: of `measured`, radians^2.
        """
        self._rows.append(np.array([*told, measured, known, variance]))
        self._count += 1
        if self._count % EVERY == 0:
            self._estimate()

    @property
    def proven(self) -> bool:
        """Whether the gyro has been seen to turn as the robot does."""
        return self.slope is not None and self.turns_along

    @property
    def turns_along(self) -> bool:
        """Whether the gyro turns as the robot does, as far as is known."""
        return self.slope is None or ALONG[0] < self.slope < ALONG[1]

    def _find_slope(self, told: Array, measured: Array, known: Array) -> float | None:
        squares = float(known @ measured**2)
        if squares < TURNED**2:
            return None
        return float(known @ ((told[:, 1] - told[:, 0] * self.quality.coefficients[0]) * measured)) / squares

    def _estimate(self) -> None:
        rows = np.array(self._rows)
        told, measured, known, variance = rows[:, :3], rows[:, 3], rows[:, 4], rows[:, 5]
        error = told[:, 1] - measured
        base = variance + FLOOR**2
        size = np.abs(told[:, :2])
        quality = self.quality
        for _ in range(2):
            total = size @ quality.variances + base
            rest = error - told @ quality.coefficients
            weights = known * (FREEDOM + 1) / (FREEDOM + rest**2 / total) / total
            normal = told.T @ (weights[:, None] * told) + np.linalg.inv(self._assumed.covariance)
            covariance = np.linalg.inv(normal)
            coefficients = covariance @ (told.T @ (weights * error))
            rest = error - told @ coefficients
            variances = explain_variances(size, rest[:, None] ** 2, known[:, None], base[:, None],
                                          quality.variances[None], self._assumed.variances[None])[0]  # fmt: skip
            quality = replace(quality, coefficients=coefficients, covariance=covariance, variances=variances,
                              steps=self._count)  # fmt: skip
        self.quality = quality
        self.slope = self._find_slope(told, measured, known)
