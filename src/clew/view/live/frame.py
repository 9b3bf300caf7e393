"""What a viewer shows at one moment, and where the newest of it is handed over."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.scan import LaserScan
from clew.slam import Slam

Array = NDArray[np.float64]

MOST_POINTS = 180  # of a keyframe or a scan that are shown
_NONE = np.zeros((0, 2))
_REACH = 300.0  # metres; what is further away does not fit into the centimetres of 16 bits


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """One moment of a run.

    Attributes:
        stage: what goes on: "mapping", "refining", "writing", "finished" or another word.
        poses: ``(K, 3)`` keyframes in the world.
        clouds: returns of the keyframes, ``(n, 2)`` int16 centimetres in the robot's frame; may hold more than `K`.
        sensor: ``(3,)`` pose of the laser on the robot.
        robot: ``(3,)`` pose of the robot.
        scan: ``(n, 2)`` its last returns, as `clouds`.
        closures: ``(C, 2)`` keyframes tied by loop closures.
        scans, total: scans taken, and in the log (0 if that is not known).
        rejected: candidate closures that were turned down.
        log_seconds: time of the log so far.
        last: whether no other will follow.
    """

    stage: str
    poses: Array
    clouds: Sequence[NDArray[np.int16]]
    sensor: Array
    robot: Array
    scan: NDArray[np.int16]
    closures: NDArray[np.int32]
    scans: int
    total: int
    rejected: int
    log_seconds: float
    last: bool = False


EMPTY = LiveFrame("waiting", np.zeros((0, 3)), [], np.zeros(3), np.zeros(3), np.zeros((0, 2), np.int16),
                  np.zeros((0, 2), np.int32), 0, 0, 0, 0.0)


class FrameMaker:
    """Takes frames of a `Slam`; the returns of a keyframe are looked at once."""

    def __init__(self, total: int = 0) -> None:
        self.total = total
        self._clouds: list[NDArray[np.int16]] = []

    def take(self, slam: Slam, stage: str) -> LiveFrame:
        """The present moment."""
        poses = slam.every_keyframe.T_world_robot
        if len(poses) > len(self._clouds):
            numbers = slam.keyframe_numbers
            fresh = int(np.searchsorted(numbers, len(self._clouds)))
            new = dict(zip(numbers[fresh:].tolist(), slam.keyframe_points[fresh:], strict=True))
            self._clouds += [_thinned(new.get(k, _NONE)) for k in range(len(self._clouds), len(poses))]
        scan = slam.last_scan
        closures = np.array([(c.source, c.target) for c in slam.closures], dtype=np.int32).reshape(-1, 2)
        begin, end = slam.time_span
        return LiveFrame(
            stage, poses, self._clouds, np.zeros(3) if scan is None else np.asarray(scan.T_robot_sensor),
            slam.pose.array.copy(), np.zeros((0, 2), np.int16) if scan is None else _thinned(_returns(scan)),
            closures, slam.scan_count, self.total, slam.turned_down_count, end - begin)  # fmt: skip


def _returns(scan: LaserScan) -> Array:
    """Points ``(n, 2)`` of a scan in the robot's frame."""
    good = np.isfinite(scan.ranges) & (scan.ranges > scan.range_min)
    angles, ranges = scan.angles[good], scan.ranges[good]
    points = np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)
    return se2.act(np.asarray(scan.T_robot_sensor, dtype=np.float64), points)


def _thinned(points: Array) -> NDArray[np.int16]:
    """At most `MOST_POINTS` of them, in centimetres."""
    points = points[:: -(-len(points) // MOST_POINTS) or 1]
    near = np.abs(points).max(axis=1, initial=0.0) < _REACH
    return np.asarray(np.round(100.0 * points[near]), dtype=np.int16)


class Feed:
    """The newest frame; who comes for it late finds the newest one, and those between are gone."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frame = EMPTY
        self._version = 0

    def publish(self, frame: LiveFrame) -> None:
        """Put a frame in the place of the last one; never waits for anybody."""
        with self._changed:
            self._frame = frame
            self._version += 1
            self._changed.notify_all()

    def newest(self) -> LiveFrame:
        """The frame that was published last."""
        return self._frame

    def wait(self, seen: int, seconds: float) -> tuple[int, LiveFrame] | None:
        """Version and frame as soon as there is one newer than version `seen`; None if none comes in time."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._version > seen, seconds):
                return None
            return self._version, self._frame
