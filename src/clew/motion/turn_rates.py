"""Readings of a gyro, and the turn between any two moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HISTORY = 4096  # readings kept; a scan is never older than that
LONGEST_GAP = 0.25  # seconds without a reading after which the turn is not known
RATE_SECONDS = 0.05  # that a momentary rate is the mean of


@dataclass(frozen=True, eq=False)
class TurnRates:
    """What a gyro measured about the robot's vertical axis.

    Attributes:
        timestamps: ``(n,)`` seconds, in order.
        rates: ``(n,)`` radians a second, counter-clockwise seen from above.
    """

    timestamps: Array
    rates: Array

    @property
    def timestamp(self) -> float:
        """Seconds of the first reading."""
        return float(self.timestamps[0])

    def part(self, begin: int, end: int) -> TurnRates:
        """Readings `begin` to `end`, the last one left out."""
        return TurnRates(self.timestamps[begin:end], self.rates[begin:end])


@dataclass(frozen=True)
class GyroHeading:
    """The integral of a gyro's rates at a moment.

    Attributes:
        timestamp: seconds.
        angle: radians since the first reading; bias and all.
        rate: radians a second at this moment.
        stretch: number of the stretch without gaps that the moment lies in.
    """

    timestamp: float
    angle: float
    rate: float
    stretch: int

    def since(self, before: GyroHeading | None) -> Array | None:
        """``(3,)`` seconds, turn in radians, and change of the rate since `before`; None across a gap."""
        if before is None or before.stretch != self.stretch:
            return None
        return np.array([self.timestamp - before.timestamp, self.angle - before.angle, self.rate - before.rate])


class GyroBuffer:
    """The latest readings of a gyro, integrated: rates change linearly from one to the next."""

    def __init__(self) -> None:
        self._rows = np.zeros((0, 4))  # time, rate, angle, stretch

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, readings: TurnRates) -> None:
        """Take readings in the order of time; those that are not later than the last one are left out."""
        times, rates = np.asarray(readings.timestamps, np.float64), np.asarray(readings.rates, np.float64)
        before = self._rows[-1] if len(self) else None
        latest = np.maximum.accumulate(np.append(-np.inf if before is None else before[0], times))
        later = times > latest[:-1]
        times, rates = times[later], rates[later]
        if not len(times):
            return
        first = np.array([times[0], rates[0], 0.0, 0.0]) if before is None else before
        seconds = np.diff(times, prepend=first[0])
        mean = 0.5 * (rates + np.append(first[1], rates[:-1]))
        gap = seconds > LONGEST_GAP
        angle = first[2] + np.cumsum(np.where(gap, 0.0, mean * seconds))
        rows = np.column_stack([times, rates, angle, first[3] + np.cumsum(gap)])
        self._rows = np.concatenate([self._rows, rows])[-HISTORY:]

    def at(self, timestamp: float) -> GyroHeading | None:
        """Angle and rate at a time; None in a gap and where no reading is near.

        After the last reading its rate goes on for a moment.
        """
        rows = self._rows
        place = int(np.searchsorted(rows[:, 0], timestamp, side="right"))
        if place == 0 or timestamp - rows[place - 1, 0] > LONGEST_GAP:
            return None
        if place < len(rows) and rows[place, 3] != rows[place - 1, 3]:
            return None
        time, rate, angle, stretch = rows[place - 1]
        if place < len(rows):
            share = (timestamp - time) / (rows[place, 0] - time)
            end = rate + share * (rows[place, 1] - rate)
        else:
            end = rate
        recent = (rows[:place, 0] > timestamp - RATE_SECONDS) & (rows[:place, 3] == stretch)
        mean = float(rows[:place, 1][recent].mean()) if recent.any() else float(end)
        return GyroHeading(timestamp, float(angle + 0.5 * (rate + end) * (timestamp - time)), mean, int(stretch))
