"""Where laser and IMU sit on the robot, from the transforms of a ROS bag."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.geometry import so3

Array = NDArray[np.float64]

#: Frames that stand for the robot's centre when the odometry names none, in this order.
_BASES = ("base_footprint", "base_link", "base")


class Transforms:
    """A tree of frames: the first transform seen from each frame to its parent."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Array]] = {}

    def add(self, stamped: Iterable[Any]) -> None:
        """Take in the ``geometry_msgs/TransformStamped`` of a ``tf2_msgs/TFMessage``."""
        for transform in stamped:
            child = transform.child_frame_id.lstrip("/")
            move, turn = transform.transform.translation, transform.transform.rotation
            quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
            matrix = np.eye(4)
            matrix[:3, 3] = move.x, move.y, move.z
            length = float(np.linalg.norm(quaternion))
            if np.isfinite(matrix).all() and 0.5 < length < 2.0:
                matrix[:3, :3] = so3.matrix(so3.canonical(quaternion))
                self._parents.setdefault(child, (transform.header.frame_id.lstrip("/"), matrix))

    def _way_up(self, frame: str) -> dict[str, Array]:
        """Matrices from `frame` to itself and to each frame above it."""
        above = {frame: np.eye(4)}
        while frame in self._parents:
            parent, matrix = self._parents[frame]
            if parent in above:  # a loop, which a tree has not
                break
            above[parent] = matrix @ above[frame]
            frame = parent
        return above

    def between(self, base: str, sensor: str) -> Array | None:
        """Matrix ``(4, 4)`` from `sensor` to `base` coordinates, or None where no way leads."""
        from_base, from_sensor = self._way_up(base.lstrip("/")), self._way_up(sensor.lstrip("/"))
        for frame, matrix in from_sensor.items():
            if frame in from_base:
                return np.asarray(np.linalg.inv(from_base[frame]) @ matrix, dtype=np.float64)
        return None

    def to_base(self, base: str, sensor: str) -> Array | None:
        """Matrix ``(4, 4)`` from `sensor` to the robot's coordinates, or None where no way leads.

        `base` is the robot's frame; where that is unknown, the usual names are tried.
        """
        for frame in (base, *_BASES):
            matrix = self.between(frame, sensor) if frame else None
            if matrix is not None:
                return matrix
        return None

    def sensor_pose(self, base: str, sensor: str) -> tuple[Array, bool]:
        """Pose ``(3,)`` of the laser on the robot seen from above, and whether it is mounted upside down.

        The identity where the bag has no transform between the two.
        """
        matrix = self.to_base(base, sensor)
        if matrix is None:
            return np.zeros(3), False
        yaw = np.arctan2(matrix[1, 0], matrix[0, 0])
        return np.array([matrix[0, 3], matrix[1, 3], yaw]), bool(matrix[2, 2] < 0)
