"""Reflectors: short runs of beams that come back bright, where the sensor tells intensity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import se2
from clew.scan.feature_returns import Index, ReturnOptions, gather_returns, spans
from clew.scan.laser import LaserScan

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ReflectorOptions:
    """What counts as a reflector.

    Attributes:
        threshold: least intensity, in the sensor's unit.
        returns: noise, and where surfaces end.
        minimum_returns: least number of bright beams in a row.
        greatest_width: metres.
        radius: of cylindrical reflectors, metres: their centre is that far behind the return; 0 for flat strips.
    """

    threshold: float
    returns: ReturnOptions = field(default_factory=ReturnOptions)
    minimum_returns: int = 2
    greatest_width: float = 0.4
    radius: float = 0.0


@dataclass(frozen=True, eq=False)
class Reflectors:
    """``K`` reflectors in the frames of the robot.

    Attributes:
        scan: ``(K,)`` index of the scan.
        positions: ``(K, 2)`` metres.
        covariances: ``(K, 2, 2)``.
        intensities: ``(K,)`` mean over the beams.
    """

    scan: Index
    positions: Array
    covariances: Array
    intensities: Array

    def __len__(self) -> int:
        return len(self.scan)


def find_reflectors(scans: Sequence[LaserScan], options: ReflectorOptions) -> Reflectors:
    """Reflectors in scans that carry intensities, all scans at once.

    The position is the mean over the bright beams. Each edge is known to one beam's width, so the bearing has a
    variance of ``increment^2 / 24`` whatever the number of beams; the range has ``sigma_range^2 / n``.

    Raises:
        InputError: a scan without intensities.
    """
    lacking = [number for number, scan in enumerate(scans) if scan.intensities is None]
    if lacking:
        raise InputError(f"scan {lacking[0]} has no intensities, by which reflectors are found; use circles or corners")
    returns = gather_returns(scans, options.returns)
    bright = np.concatenate([np.empty(0), *(scan.intensities for scan in scans if scan.intensities is not None)])
    offsets = np.cumsum([0, *(len(scan.ranges) for scan in scans)])
    intensity = bright[offsets[returns.scan] + returns.beam]
    above = intensity >= options.threshold
    ends = np.zeros(len(above) + 1, dtype=bool)
    ends[returns.starts] = True
    begins = above & ~np.concatenate([[False], above[:-1]]) | above & ends[:-1]
    stops = above & (~np.concatenate([above[1:], [False]]) | ends[1:])
    first, last = np.flatnonzero(begins), np.flatnonzero(stops) + 1
    points = returns.points
    width = np.hypot(*(points[last - 1] - points[first]).T)
    good = (last - first >= options.minimum_returns) & (width <= options.greatest_width)
    first, last = first[good], last[good]
    rows, owner = spans(first, last)
    number = last - first
    middle = (returns.directions[first] + returns.directions[last - 1]) / 2
    bearing = np.arctan2(middle[:, 1], middle[:, 0])
    distance = np.bincount(owner, returns.ranges[rows], len(first)) / number + options.radius
    scan = returns.scan[first]
    place = returns.T_robot_sensor[scan]
    u = np.stack([np.cos(bearing + place[:, 2]), np.sin(bearing + place[:, 2])], axis=1)
    v = np.stack([-u[:, 1], u[:, 0]], axis=1)
    along = options.returns.sigma_range**2 / number
    across = distance**2 * (returns.increments[scan] ** 2 / 24 + options.returns.sigma_bearing**2)
    local = distance[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    return Reflectors(
        scan,
        se2.act(place, local),
        along[:, None, None] * u[:, :, None] * u[:, None] + across[:, None, None] * v[:, :, None] * v[:, None],
        np.bincount(owner, intensity[rows], len(first)) / number,
    )
