"""Returns of many scans in one array, cut where the surface ends: what all features are found in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.scan.laser import LaserScan

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class ReturnOptions:
    """The sensor's noise, and where a surface ends.

    Attributes:
        sigma_range: standard deviation of a range, rounding included, metres.
        sigma_bearing: of a beam's direction, radians.
        sigma_surface: standard deviation of what all returns of one surface share, metres: walls are not quite straight
            nor trees round, and a laser measures one material too near and another too far. More returns do not
            average it out. Chosen so that normalised errors on real logs are right (`benchmarks/features.py`).
        range_limit: returns further away are left out, metres.
        gap_base, gap_per_metre: neighbouring returns further apart than ``gap_base + gap_per_metre * range`` lie on
            different surfaces.
        missing: beams without a return that a surface may have in between.
    """

    sigma_range: float = 0.015
    sigma_bearing: float = 0.0005
    sigma_surface: float = 0.003
    range_limit: float = 30.0
    gap_base: float = 0.08
    gap_per_metre: float = 0.05
    missing: int = 1


@dataclass(frozen=True, eq=False)
class Returns:
    """``n`` returns of ``S`` scans in the frames of their sensors, scan by scan in the order of the beams.

    Attributes:
        scan: ``(n,)`` index of the scan.
        beam: ``(n,)`` index of the beam.
        ranges: ``(n,)`` metres.
        directions: ``(n, 2)`` unit vectors.
        starts: ``(C + 1,)`` first return of each surface, and ``n``.
        T_robot_sensor: ``(S, 3)``.
        increments: ``(S,)`` angle between beams, radians.
        options: the noise.
    """

    scan: Index
    beam: Index
    ranges: Array
    directions: Array
    starts: Index
    T_robot_sensor: Array
    increments: Array
    options: ReturnOptions

    @property
    def points(self) -> Array:
        """``(n, 2)`` metres."""
        return self.ranges[:, None] * self.directions

    def variance_across(self, normals: Array) -> Array:
        """Variance ``(n,)`` of each return along a unit vector ``(n, 2)``, m^2."""
        along = (normals * self.directions).sum(axis=1)
        side = self.ranges * self.options.sigma_bearing
        return np.asarray((along * self.options.sigma_range) ** 2 + (1 - along**2) * side**2)


def gather_returns(scans: Sequence[LaserScan], options: ReturnOptions) -> Returns:
    """Valid returns of scans, cut into surfaces."""
    numbers, beams = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    ranges, angles = [np.empty(0)], [np.empty(0)]
    for number, scan in enumerate(scans):
        limit = min(scan.range_max, options.range_limit)
        valid = np.flatnonzero((scan.ranges >= scan.range_min) & (scan.ranges <= limit))
        numbers.append(np.full(len(valid), number))
        beams.append(valid)
        ranges.append(scan.ranges[valid])
        angles.append(scan.angles[valid])
    scan_of, beam = np.concatenate(numbers), np.concatenate(beams)
    r, angle = np.concatenate(ranges), np.concatenate(angles)
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = r[:, None] * directions
    step = np.hypot(*(points[1:] - points[:-1]).T)
    cut = step > options.gap_base + options.gap_per_metre * np.minimum(r[1:], r[:-1])
    cut |= (scan_of[1:] != scan_of[:-1]) | (beam[1:] - beam[:-1] > 1 + options.missing)
    starts = np.concatenate([[0], np.flatnonzero(cut) + 1, [len(r)]]) if len(r) else np.array([0])
    places = np.array([scan.T_robot_sensor for scan in scans], dtype=np.float64).reshape(-1, 3)
    increments = np.array([scan.angle_increment for scan in scans], dtype=np.float64)
    return Returns(scan_of, beam, r, directions, starts.astype(np.int64), places, increments, options)


def spans(first: Index, last: Index) -> tuple[Index, Index]:
    """Rows of all spans ``first[k] .. last[k] - 1`` one after the other, and the span ``k`` of each."""
    lengths = last - first
    owner = np.repeat(np.arange(len(first)), lengths)
    rows = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths) + first[owner]
    return rows, owner


def sum_by(owner: Index, values: Array, count: int) -> Array:
    """Sums ``(count, ...)`` of values ``(m, ...)`` by owner ``(m,)``."""
    flat = values.reshape(len(values), math.prod(values.shape[1:]))
    out = np.empty((count, flat.shape[1]))
    for place, column in enumerate(flat.T):
        out[:, place] = np.bincount(owner, weights=column, minlength=count)
    return out.reshape(count, *values.shape[1:])
