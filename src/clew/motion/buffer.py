"""Odometry at any moment, from readings that come at moments of their own."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.motion.odometry import Odometry

Array = NDArray[np.float64]

HISTORY = 4096  # readings kept; a scan is never older than that
EXTRAPOLATION_LIMIT = 0.5  # seconds that the last velocity is trusted for


class OdometryBuffer:
    """The latest odometry readings, interpolated between and carried on after the last for a moment."""

    def __init__(self) -> None:
        self._readings: deque[Odometry] = deque(maxlen=HISTORY)

    def __len__(self) -> int:
        return len(self._readings)

    def add(self, reading: Odometry) -> None:
        """Take a reading; one that is older than the last is left out, one of the same time replaces it."""
        if self._readings and reading.timestamp <= self._readings[-1].timestamp:
            if reading.timestamp == self._readings[-1].timestamp:
                self._readings[-1] = reading
            return
        self._readings.append(reading)

    def at(self, timestamp: float) -> Array | None:
        """``T_odom_robot (3,)`` at a time, or None before any reading has come."""
        if not self._readings:
            return None
        later = None
        for reading in reversed(self._readings):
            if reading.timestamp == timestamp:
                return reading.T_odom_robot
            if reading.timestamp < timestamp:
                return self._carry_on(timestamp) if later is None else _between(reading, later, timestamp)
            later = reading
        return self._readings[0].T_odom_robot

    def _carry_on(self, timestamp: float) -> Array:
        last = self._readings[-1]
        if len(self._readings) < 2:
            return last.T_odom_robot
        before = self._readings[-2]
        ahead = min(timestamp - last.timestamp, EXTRAPOLATION_LIMIT)
        return _between(before, last, last.timestamp + ahead)


def _between(a: Odometry, b: Odometry, timestamp: float) -> Array:
    """The motion from `a` to `b` at constant body velocity, at a time that may lie after `b`."""
    share = (timestamp - a.timestamp) / (b.timestamp - a.timestamp)
    return se2.compose(a.T_odom_robot, se2.exp(share * se2.log(se2.between(a.T_odom_robot, b.T_odom_robot))))
