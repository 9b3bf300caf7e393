"""A simulated gyro about the vertical axis: noise, a bias that wanders, a scale that is off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from clew.errors import InputError
from clew.motion import TurnRates
from clew.sim.drive import Drive
from clew.sim.world import Array


@dataclass(frozen=True)
class GyroModel:
    """What the gyro of an IMU measures: ``(1 + scale) w(t) + bias + noise`` for a true rate ``w``.

    Attributes:
        rate: readings a second, Hz.
        density: radians after one second from white noise (angle random walk).
        bias: at the beginning, radians a second.
        bias_walk: deviation of its change after one second, radians a second.
        scale: share by which rates are too large.
        delay: seconds by which readings are stamped too late.
        limit: larger rates are reported as this, radians a second.
    """

    rate: float = 100.0
    density: float = 0.0005
    bias: float = 0.01
    bias_walk: float = 1e-5
    scale: float = 0.002
    delay: float = 0.0
    limit: float = 8.7

    def __post_init__(self) -> None:
        if not self.rate > 0.0 or self.density < 0.0 or self.bias_walk < 0.0 or not self.limit > 0.0:
            raise InputError("GyroModel: rate and limit must be positive, density and bias_walk not negative")

    def measure(self, driven: Drive, rng: np.random.Generator) -> TurnRates:
        """Readings all along a drive; between its poses the heading is a cubic spline."""
        times = driven.timestamps
        stamps = times[0] + np.arange(int((times[-1] - times[0]) * self.rate) + 1) / self.rate
        rates: Array = np.zeros(len(stamps))
        if len(times) > 1:
            heading = CubicSpline(times, np.unwrap(driven.T_world_robot[:, 2]))
            rates = heading(np.clip(stamps - self.delay, times[0], times[-1]), 1)
        noise = rng.standard_normal((2, len(stamps)))
        bias = self.bias + self.bias_walk * np.sqrt(1.0 / self.rate) * np.cumsum(noise[0])
        rates = (1.0 + self.scale) * rates + bias + self.density * np.sqrt(self.rate) * noise[1]
        return TurnRates(stamps, np.clip(rates, -self.limit, self.limit))
