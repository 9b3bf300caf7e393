"""The keyframes of a run, as the front end saw them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place import surfels_of
from clew.scan import ScanPoints

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Keyframe:
    """A scan that the map is made of.

    Attributes:
        timestamp: seconds.
        points: its returns in the robot's frame.
        T_robot_sensor: ``(3,)``.
        T_local_robot: ``(3,)`` pose in the front end's own frame, never corrected by closures: smooth, but it drifts.
        path: metres driven since the start.
        T_previous_this: ``(3,)`` measured pose seen from the previous keyframe,
        information: ``(3, 3)`` and its information.
    """

    timestamp: float
    points: ScanPoints
    T_robot_sensor: Array
    T_local_robot: Array
    path: float
    T_previous_this: Array
    information: Array


class KeyframeStore:
    """All keyframes in the order of time, with what is asked of many at once."""

    def __init__(self) -> None:
        self._keyframes: list[Keyframe] = []
        self._local = np.zeros((64, 4))  # T_local_robot and path of all, doubled when full

    def __len__(self) -> int:
        return len(self._keyframes)

    def __getitem__(self, index: int) -> Keyframe:
        return self._keyframes[index]

    def add(self, keyframe: Keyframe) -> int:
        """Append a keyframe; returns its index."""
        count = len(self._keyframes)
        if count == len(self._local):
            self._local = np.concatenate([self._local, np.zeros_like(self._local)])
        self._local[count] = (*keyframe.T_local_robot, keyframe.path)
        self._keyframes.append(keyframe)
        return len(self._keyframes) - 1

    @property
    def paths(self) -> Array:
        """``(K,)`` metres driven until each keyframe."""
        return self._local[: len(self), 3]

    def clouds(self, members: NDArray[np.int64]) -> list[ScanPoints]:
        """Points of keyframes, each in its own frame."""
        return [self._keyframes[int(k)].points for k in members]

    def sensors(self, members: NDArray[np.int64]) -> Array:
        """``(M, 3)`` poses of the laser on the robot."""
        return np.stack([self._keyframes[int(k)].T_robot_sensor for k in members])

    def relative(self, anchor: int, members: NDArray[np.int64]) -> Array:
        """``(M, 3)`` poses of keyframes seen from another by the front end alone: good over short paths."""
        return se2.between(self._local[anchor, :3], self._local[members, :3])

    def surfels(self, anchor: int, members: NDArray[np.int64], voxel: float) -> ScanPoints:
        """Surfels of neighbouring keyframes in the frame of one of them."""
        return surfels_of(self.clouds(members), self.relative(anchor, members), voxel)
