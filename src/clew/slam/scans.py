"""What is kept of the scans of a run: where each was taken, and the ranges that the map needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.graph.growing import Growing
from clew.mapping import moving_returns
from clew.scan import BeamTimes, CleaningOptions, LaserScan, ScanPoints, deskew, extract_points

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class KeptScan:
    """A scan as it was recorded.

    Attributes:
        number: of all scans.
        scan: with the moments of its beams, where they are known.
        velocity: ``(3,)`` body velocity of the robot meanwhile.
    """

    number: int
    scan: LaserScan
    velocity: Array

    @property
    def still(self) -> LaserScan:
        """As it would have been measured all at once."""
        return deskew(self.scan, self.velocity)


class ScanStore:
    """One row a scan for the trajectory, and the scans themselves, keyframe by keyframe, as long as these are kept.

    A row is 64 bytes; it stays. Ranges are kept in single precision (a hundredth of the noise of any laser), and of a
    robot that stands for long only some: memory for them goes with the keyframes, not with time.

    Args:
        most: scans of one keyframe that are kept; beyond that every second, fourth, ... one.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._timestamps: Growing[np.float64] = Growing((), np.float64)
        self._keyframes: Growing[np.int64] = Growing((), np.int64)
        self._T_keyframe_robot: Growing[np.float64] = Growing((3,), np.float64)
        self._T_odom_robot: Growing[np.float64] = Growing((3,), np.float64)
        self._kept: dict[int, list[KeptScan]] = {}  # by keyframe
        self._stride: dict[int, int] = {}
        self._seen = 0  # scans of the newest keyframe

    def __len__(self) -> int:
        return len(self._timestamps)

    def add(
        self, scan: LaserScan, keyframe: int, T_keyframe_robot: Array, T_odom_robot: Array | None, velocity: Array
    ) -> None:
        """Append a scan as it was recorded, with its pose seen from a keyframe and, where it is known, by odometry, and
        the body velocity ``(3,)`` meanwhile."""
        number = len(self)
        self._timestamps.extend(1)[:] = scan.timestamp
        self._keyframes.extend(1)[:] = keyframe
        self._T_keyframe_robot.append(T_keyframe_robot[None])
        if T_odom_robot is not None:
            self._T_odom_robot.append(T_odom_robot[None])
        kept = self._kept.setdefault(keyframe, [])
        self._seen = self._seen + 1 if kept else 1
        stride = self._stride.get(keyframe, 1)
        if (self._seen - 1) % stride:
            return
        single = replace(scan, ranges=np.asarray(scan.ranges, dtype=np.float32), intensities=None)
        kept.append(KeptScan(number, single, velocity))
        if len(kept) > self._most:
            self._kept[keyframe] = kept[::2]
            self._stride[keyframe] = 2 * stride

    def forget(self, keyframe: int) -> None:
        """Give up the ranges of a keyframe's scans."""
        self._kept.pop(keyframe, None)
        self._stride.pop(keyframe, None)

    @property
    def timestamps(self) -> Array:
        """``(N,)`` seconds."""
        return self._timestamps.rows

    @property
    def keyframes(self) -> Index:
        """``(N,)`` keyframe that each scan's pose is seen from."""
        return self._keyframes.rows

    @property
    def T_keyframe_robot(self) -> Array:
        """``(N, 3)``."""
        return self._T_keyframe_robot.rows

    @property
    def T_odom_robot(self) -> Array:
        """``(N, 3)`` by odometry alone, or ``(0, 3)`` without it."""
        return self._T_odom_robot.rows

    def still_returns(
        self, keyframes: Index, clouds: Sequence[ScanPoints] | None, T_world_robot: Array, cleaning: CleaningOptions
    ) -> list[ScanPoints]:
        """Returns of keyframes without those from things that moved, by what the keyframes saw of their places.

        Args:
            keyframes: ``(K,)`` numbers of keyframes that are kept.
            clouds: their returns, None to make them anew,
            T_world_robot: ``(K, 3)`` and poses.
            cleaning: how returns are made of scans.
        """
        scans = [kept.still for kept in self.of_keyframes(keyframes)]
        still = [extract_points(scan, cleaning) for scan in scans] if clouds is None else list(clouds)
        for row, moved in enumerate(moving_returns(scans, T_world_robot)):
            if moved.any():
                ranges = np.where(moved, np.nan, scans[row].ranges).astype(np.float64)
                still[row] = extract_points(replace(scans[row], ranges=ranges), cleaning)
        return still

    def of_keyframes(self, keyframes: Index) -> list[KeptScan]:
        """The scans that became keyframes."""
        return [self._kept[int(k)][0] for k in keyframes]

    def retime(self, times: BeamTimes, velocities: Array) -> None:
        """Give all scans moments of their beams, and body velocities ``(N, 3)``."""
        for key, all_kept in self._kept.items():
            self._kept[key] = [
                replace(kept, scan=times.of(kept.scan), velocity=velocities[kept.number])
                for kept in all_kept
            ]

    def kept(self) -> tuple[Index, list[LaserScan]]:
        """Numbers ``(S,)`` and scans that the map is made of, in the order of time, without motion within them."""
        all_kept = [kept for key in sorted(self._kept) for kept in self._kept[key]]
        return np.array([kept.number for kept in all_kept], dtype=np.int64), [kept.still for kept in all_kept]
