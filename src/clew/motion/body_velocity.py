"""How fast a robot moved at any moment of a trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2

Array = NDArray[np.float64]

LEAST_SECONDS = 0.1  # that a velocity is measured over; over less, noise of the poses is all there is
MOST_SECONDS = 1.0  # and over more, the robot has done something else meanwhile
UNSTEADY, UNSTEADY_SHARE = 0.05, 0.25  # radians a second, and share of the turn rate, that it may change by
#: Times of poses tell velocities where so many of the gaps between them are about as long as the median one.
REGULAR_SHARE, REGULAR_FACTOR = 0.7, 2.0


@dataclass(frozen=True)
class BodyVelocities:
    """Velocities along a trajectory.

    Attributes:
        velocity: ``(N, 3)`` body velocity, metres and radians a second; zero where it is not known.
        steady: ``(N,)`` whether the robot turned as fast before as after, so that the velocity is known well.
    """

    velocity: Array
    steady: NDArray[np.bool_]


def body_velocities(timestamps: Array, T_world_robot: Array, delay: float = 0.0) -> BodyVelocities:
    """Velocities at moments `delay` after each pose, from the motion to the poses before and after it.

    Args:
        timestamps: ``(N,)`` seconds, ascending.
        T_world_robot: ``(N, 3)``.
        delay: seconds.
    """
    count = len(timestamps)
    rows = np.arange(count)
    before = np.maximum(np.searchsorted(timestamps, timestamps - LEAST_SECONDS, side="right") - 1, 0)
    after = np.minimum(np.searchsorted(timestamps, timestamps + LEAST_SECONDS), count - 1)
    since, until = timestamps - timestamps[before], timestamps[after] - timestamps
    seconds = np.stack([since, until])
    known = (np.stack([before, after]) != rows) & (seconds > 0.0) & (seconds <= MOST_SECONDS)
    seconds = np.where(known, seconds, 1.0)
    poses = T_world_robot
    moved = np.stack([se2.between(poses[before], poses), se2.between(poses, poses[after])])
    velocities = np.where(known[..., None], se2.log(moved) / seconds[..., None], 0.0)
    # Each is that of the middle of its piece of way; between the two it changes evenly.
    share = np.clip((delay + 0.5 * seconds[0]) / (0.5 * seconds.sum(axis=0)), 0.0, 1.0)
    share = np.where(known.all(axis=0), share, np.where(known[1], 1.0, 0.0))
    velocity = (1.0 - share)[:, None] * velocities[0] + share[:, None] * velocities[1]
    turn = velocities[..., 2]
    change = np.abs(turn[1] - turn[0])
    steady = known.all(axis=0) & (change <= UNSTEADY + UNSTEADY_SHARE * np.abs(turn).max(axis=0))
    return BodyVelocities(velocity, steady)


def are_regular(timestamps: Array) -> bool:
    """Whether times ``(N,)`` follow each other so evenly that velocities can be told from them.

    Records that were held up on their way, and came with the time of their arrival, do not.
    """
    if len(timestamps) < 3:
        return False
    gaps = np.diff(timestamps)
    median = float(np.median(gaps))
    alike = (gaps >= median / REGULAR_FACTOR) & (gaps <= median * REGULAR_FACTOR)
    return bool(np.mean(alike) >= REGULAR_SHARE)
