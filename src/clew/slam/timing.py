"""When the beams of the log's scans were measured: found out while the robot drives, and again with all there is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from clew.motion import are_regular, body_velocities
from clew.scan import BeamTimes, CleaningOptions, LaserScan, find_beam_times

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FIRST_LOOK = 40  # keyframes; then at twice as many, and so on
SHARE_OF_A_LOOK = 0.4  # of the scans and pairs that are compared at the end


def look_now(keyframes: int) -> bool:
    """Whether with so many keyframes it is time to look, if nothing has been found before."""
    rounds, rest = divmod(keyframes, FIRST_LOOK)
    return rest == 0 and rounds > 0 and rounds & (rounds - 1) == 0


def beam_times_of(
    timestamps: Array, poses: Array, numbers: Index, scans: Sequence[LaserScan], cleaning: CleaningOptions,
    share: float = 1.0, start: BeamTimes | None = None, period: float | None = None,
) -> BeamTimes:
    """Moments of beams, as far as a trajectory and some of its scans tell them for sure (`find_beam_times`).

    Nothing is found where the times of the scans are those of their arrival after they were held up: how fast the robot
    moved within a scan cannot be told from them.

    Args:
        timestamps: ``(N,)`` of scans, seconds,
        poses: ``(N, 3)`` and where the robot was.
        numbers: ``(S,)`` which of them
        scans: are given, as they were recorded; moments that they have do not count.
        cleaning: how returns are made of scans.
        share, start: as in `find_beam_times`.
        period: seconds from one scan to the next, where `timestamps` are not those of all scans.
    """
    if not are_regular(timestamps):
        return BeamTimes()
    moved = body_velocities(timestamps, poses)
    period = float(np.median(np.diff(timestamps))) if period is None else period
    return find_beam_times(
        scans, poses[numbers], moved.velocity[numbers], moved.steady[numbers], period, cleaning, share, start
    )
