"""Where the wheels and the estimate disagree about how the robot moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2

Array = NDArray[np.float64]

#: Stretches over which motions are compared, seconds: long against the noise of one scan.
WINDOW = 2.0
#: Disagreement that counts as slip: so much in any case, metres and radians, and so large a share of the motion.
LEAST = (0.15, np.radians(8.0))
SHARE = 0.25


@dataclass(frozen=True, eq=False)
class OdometrySlip:
    """Disagreement of odometry and estimate over short stretches.

    Attributes:
        times: ``(W,)`` middle of each stretch, seconds.
        distance: ``(W,)`` metres between the motion by odometry and by the estimate.
        turn: ``(W,)`` radians.
        events: ``(S, 2)`` beginning and end of each stretch of slip, seconds.
        sizes: ``(S, 2)`` the largest disagreement in each, metres and radians.
    """

    times: Array
    distance: Array
    turn: Array
    events: Array
    sizes: Array


def odometry_slip(timestamps: Array, T_odom_robot: Array, T_world_robot: Array) -> OdometrySlip:
    """Compare motions by odometry with those of the estimate, stretch by stretch of 2 s.

    Args:
        timestamps: ``(N,)`` seconds, increasing.
        T_odom_robot: ``(N, 3)``.
        T_world_robot: ``(N, 3)``.
    """
    if len(timestamps) < 2:
        return OdometrySlip(*np.zeros((3, 0)), *np.zeros((2, 0, 2)))
    start = np.arange(len(timestamps))
    end = np.minimum(np.searchsorted(timestamps, timestamps + WINDOW), len(timestamps) - 1)
    whole = (end > start) & (timestamps[end] - timestamps[start] <= 2.0 * WINDOW)
    start, end = start[whole], end[whole]
    by_odometry = se2.between(T_odom_robot[start], T_odom_robot[end])
    by_estimate = se2.between(T_world_robot[start], T_world_robot[end])
    error = se2.between(by_odometry, by_estimate)
    distance, turn = np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])
    moved = np.maximum(*(np.hypot(m[:, 0], m[:, 1]) for m in (by_odometry, by_estimate)))
    turned = np.maximum(np.abs(by_odometry[:, 2]), np.abs(by_estimate[:, 2]))
    slipped = (distance > np.maximum(LEAST[0], SHARE * moved)) | (turn > np.maximum(LEAST[1], SHARE * turned))
    events, sizes = [], []
    rows = np.flatnonzero(slipped)
    for run in np.split(rows, np.flatnonzero(timestamps[start[rows[1:]]] > timestamps[end[rows[:-1]]]) + 1):
        if len(run):
            events.append((timestamps[start[run[0]]], timestamps[end[run[-1]]]))
            sizes.append((distance[run].max(), turn[run].max()))
    middle = 0.5 * (timestamps[start] + timestamps[end])
    return OdometrySlip(middle, distance, turn, np.reshape(events, (-1, 2)), np.reshape(sizes, (-1, 2)))
