"""What is kept of the scans of a run: where each was taken, and the ranges that the map needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.graph.growing import Growing
from clew.scan import LaserScan

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
        self._kept: dict[int, list[tuple[int, LaserScan]]] = {}  # by keyframe: number and scan
        self._stride: dict[int, int] = {}
        self._seen = 0  # scans of the newest keyframe

    def __len__(self) -> int:
        return len(self._timestamps)

    def add(self, scan: LaserScan, keyframe: int, T_keyframe_robot: Array, T_odom_robot: Array | None) -> None:
        """Append a scan, with its pose seen from a keyframe and, where it is known, by odometry."""
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
        kept.append((number, replace(scan, ranges=np.asarray(scan.ranges, dtype=np.float32), intensities=None)))
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

    def of_keyframe(self, keyframe: int) -> LaserScan:
        """The scan that became a keyframe."""
        return self._kept[keyframe][0][1]

    def kept(self) -> tuple[Index, list[LaserScan]]:
        """Numbers ``(S,)`` and scans that the map is made of, in the order of time."""
        pairs = [pair for key in sorted(self._kept) for pair in self._kept[key]]
        return np.array([number for number, _ in pairs], dtype=np.int64), [scan for _, scan in pairs]
