"""One planar laser scan."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _identity() -> Array:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class LaserScan:
    """Ranges of one sweep of a planar laser, with where the laser sits on the robot.

    Attributes:
        timestamp: seconds.
        ranges: ``(n,)`` metres; ``inf`` where the beam met nothing within reach, ``nan`` where it is invalid.
        angle_min: direction of the first beam in the sensor frame, radians, counter-clockwise from its x axis.
        angle_increment: angle between neighbouring beams, radians (negative for a laser mounted upside down).
        range_min: shorter ranges are no returns of the world, metres.
        range_max: longest range that the sensor reports as a return, metres.
        T_robot_sensor: ``(3,)`` pose of the laser on the robot (x, y, theta).
        intensities: ``(n,)`` strength of each return in the sensor's own unit, or None where it has none.
        time_increment: seconds from one beam to the next; 0 where all are of one moment or nothing is known. The
            timestamp is that of the first beam.
        bearings: ``(n,)`` direction of each beam where they are not evenly spaced, as after motion within the scan was
            removed (`deskew`); None where they are.
        moments: ``(n,)`` seconds after the timestamp at which each beam was measured, where they do not follow each
            other evenly from the first (`BeamTimes`); None where `time_increment` tells.
    """

    timestamp: float
    ranges: Array
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    T_robot_sensor: Array = field(default_factory=_identity)
    intensities: Array | None = None
    time_increment: float = 0.0
    bearings: Array | None = None
    moments: Array | None = None

    @property
    def angles(self) -> Array:
        """``(n,)`` direction of each beam in the sensor frame, radians."""
        if self.bearings is not None:
            return self.bearings
        return np.asarray(self.angle_min + self.angle_increment * np.arange(self.ranges.shape[0]), dtype=np.float64)

    @property
    def delays(self) -> Array:
        """``(n,)`` seconds after the timestamp at which each beam was measured."""
        if self.moments is not None:
            return self.moments
        return np.asarray(self.time_increment * np.arange(self.ranges.shape[0]), dtype=np.float64)

    @property
    def span(self) -> tuple[float, float]:
        """Seconds after the timestamp of the beams that were measured first and last; zeros where all are of one moment
        or nothing is known."""
        if self.moments is None:
            last = self.time_increment * max(len(self.ranges) - 1, 0)
            return min(last, 0.0), max(last, 0.0)
        return (float(self.moments.min()), float(self.moments.max())) if len(self.moments) else (0.0, 0.0)

    @property
    def is_sweep(self) -> bool:
        """Whether beams are known to be of different moments."""
        return self.moments is not None or self.time_increment != 0.0
