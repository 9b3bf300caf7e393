"""The keyframes of a run, as the front end saw them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.graph.growing import Growing
from clew.place import surfels_of
from clew.scan import ScanPoints

Array = NDArray[np.float64]
Index = NDArray[np.int64]


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
    """All keyframes, numbered in the order of time, with what is asked of many at once.

    A keyframe that is dropped (`clew.slam.pruning`) keeps its number, time and path; its returns are gone.
    """

    def __init__(self) -> None:
        self._keyframes: dict[int, Keyframe] = {}
        self._track: Growing[np.float64] = Growing((5,), np.float64)  # T_local_robot, path and time of all
        self._step_covariances: Growing[np.float64] = Growing((3, 3), np.float64)
        self._returns: Growing[np.int32] = Growing((), np.int32)
        self._alive: Growing[np.bool_] = Growing((), np.bool_)

    def __len__(self) -> int:
        """How many have been taken, whether dropped since or not: the number that the next one gets."""
        return len(self._alive)

    def __getitem__(self, index: int) -> Keyframe:
        return self._keyframes[index]

    def __contains__(self, index: int) -> bool:
        return index in self._keyframes

    def add(self, keyframe: Keyframe) -> int:
        """Append a keyframe; returns its number."""
        index = len(self)
        self._track.extend(1)[:] = (*keyframe.T_local_robot, keyframe.path, keyframe.timestamp)
        covariance = np.linalg.inv(keyframe.information) if index else np.zeros((3, 3))
        self._step_covariances.append(covariance[None])
        self._returns.extend(1)[:] = len(keyframe.points)
        self._alive.extend(1)[:] = True
        self._keyframes[index] = keyframe
        return index

    def replace_points(self, index: int, points: ScanPoints) -> None:
        """Give a keyframe other returns: some were found not to stay."""
        self._keyframes[index] = replace(self._keyframes[index], points=points)
        self._returns.rows[index] = len(points)

    def replace_clouds(self, members: Index, clouds: Sequence[ScanPoints]) -> None:
        """Give keyframes other returns: motion within their scans has been taken out otherwise."""
        for index, points in zip(members.tolist(), clouds, strict=True):
            self.replace_points(index, points)

    def drop(self, indices: Iterable[int]) -> None:
        """Forget the returns of keyframes for good."""
        for index in indices:
            del self._keyframes[index]
            self._alive.rows[index] = False

    @property
    def alive(self) -> Index:
        """``(A,)`` numbers of the keyframes that have not been dropped."""
        return np.flatnonzero(self._alive.rows)

    @property
    def is_alive(self) -> NDArray[np.bool_]:
        """``(K,)`` whether each has not been dropped."""
        return self._alive.rows

    @property
    def returns(self) -> NDArray[np.int32]:
        """``(K,)`` how many returns each had."""
        return self._returns.rows

    @property
    def T_local_robot(self) -> Array:
        """``(K, 3)`` poses in the front end's own frame."""
        return self._track.rows[:, :3]

    @property
    def paths(self) -> Array:
        """``(K,)`` metres driven until each keyframe."""
        return self._track.rows[:, 3]

    @property
    def timestamps(self) -> Array:
        """``(K,)`` seconds."""
        return self._track.rows[:, 4]

    def step_covariances(self, indices: Index) -> Array:
        """``(n, 3, 3)`` of the pose of each keyframe seen from the one before it, in its own tangent."""
        return self._step_covariances.rows[indices]

    def between(self, first: int, end: int) -> Index:
        """Those of the keyframes ``first ... end - 1`` that there are."""
        first = max(first, 0)
        return first + np.flatnonzero(self._alive.rows[first:end])

    def clouds(self, members: Index) -> list[ScanPoints]:
        """Points of keyframes, each in its own frame."""
        return [self._keyframes[int(k)].points for k in members]

    def sensors(self, members: Index) -> Array:
        """``(M, 3)`` poses of the laser on the robot."""
        return np.stack([self._keyframes[int(k)].T_robot_sensor for k in members])

    def relative(self, anchor: int, members: Index) -> Array:
        """``(M, 3)`` poses of keyframes seen from another by the front end alone: good over short paths."""
        return se2.between(self._track.rows[anchor, :3], self._track.rows[members, :3])

    def surfels(self, anchor: int, members: Index, voxel: float) -> ScanPoints:
        """Surfels of neighbouring keyframes in the frame of one of them."""
        return surfels_of(self.clouds(members), self.relative(anchor, members), voxel)
