"""Motion within a scan: beams of one sweep are measured from different places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
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
    seconds = scan.delays
    at = np.asarray(scan.T_robot_sensor, dtype=np.float64)
    T_sensor_beam = se2.compose(se2.inverse(at), se2.compose(se2.exp(seconds[:, None] * velocity), at))
    directions = T_sensor_beam[:, 2] + scan.angles
    met = np.isfinite(scan.ranges)
    r = np.where(met, scan.ranges, 0.0)
    x, y = T_sensor_beam[:, 0] + r * np.cos(directions), T_sensor_beam[:, 1] + r * np.sin(directions)
    return replace(
        scan,
        ranges=np.where(met, np.hypot(x, y), scan.ranges),
        bearings=np.where(met, np.arctan2(y, x), directions),
        time_increment=0.0,
        moments=None,
    )


def resample(scan: LaserScan) -> tuple[LaserScan, NDArray[np.int64]]:
    """A scan with evenly spaced beams, and the new beam of each old one.

    Of several returns in one direction the nearest is kept; a direction without beam is invalid.
    """
    n = len(scan.ranges)
    if scan.bearings is None:
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
