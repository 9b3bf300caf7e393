"""Motion within a scan: beams of one sweep are measured from different places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.scan.laser import LaserScan

Array = NDArray[np.float64]


def deskew(scan: LaserScan, velocity: Array) -> LaserScan:
    """The scan as it would have been measured all at once, at its timestamp.

    Args:
        scan: with the moments of its beams; without them it comes back as it is.
        velocity: ``(3,)`` body velocity of the robot during the sweep, metres and radians a second.

    Returns:
        A scan whose ranges and `bearings` hold the same returns seen from where the robot was at the timestamp. A beam
        without return keeps none and is turned with the robot.
    """
    if not scan.is_sweep or not np.any(velocity):
        return scan
    ranges, bearings = _native.scan.deskew(
        np.ascontiguousarray(scan.ranges, dtype=np.float64), scan.angles, scan.delays,
        np.ascontiguousarray(velocity, dtype=np.float64), np.ascontiguousarray(scan.T_robot_sensor, dtype=np.float64),
    )  # fmt: skip
    return replace(scan, ranges=ranges, bearings=bearings, time_increment=0.0, moments=None)


def resample(scan: LaserScan) -> tuple[LaserScan, NDArray[np.int64]]:
    """A scan with evenly spaced beams, and the new beam of each old one.

    Of several returns in one direction the nearest is kept; a direction without beam is invalid. A scan whose beams all
    point one way comes back as it is.
    """
    n = len(scan.ranges)
    if scan.bearings is None or scan.angle_increment == 0.0:
        return scan, np.arange(n)
    steps = (scan.bearings - scan.angle_min) / scan.angle_increment
    turn = 2 * np.pi / abs(scan.angle_increment)
    # As near as a whole turn allows to the beam's own number: a laser may see more or less than the full circle.
    steps -= turn * np.round((steps - np.arange(n)) / turn)
    beams = np.clip(np.round(steps), 0, n - 1).astype(np.int64)
    ranges = np.full(n, np.nan)
    order = np.argsort(-scan.ranges, kind="stable")  # invalid ones last among equals, the nearest written last
    order = order[~np.isnan(scan.ranges[order])]
    ranges[beams[order]] = scan.ranges[order]
    return replace(scan, ranges=ranges, bearings=None), beams
