"""Turn rates about the robot's vertical axis, from the IMU messages of a ROS bag."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.io.bag_transforms import Transforms

Array = NDArray[np.float64]

#: Where IMUs are found; others come after these, by name.
USUAL = ("/imu", "/imu/data", "/imu/data_raw")
GRAVITY = ((9.0, 10.6), (0.92, 1.08))  # what an accelerometer tells of it: metres a second squared, or multiples
LOOKED_AT = 200  # messages that show whether a topic holds turn rates at all


def turn_rate_of(message: Any) -> Array | None:
    """``(6,)`` turn rates in radians a second and accelerations about the IMU's own axes; None where it tells no rates.

    Accelerations that the driver does not know are nan.
    """
    rate, force = message.angular_velocity, message.linear_acceleration
    row = np.array([rate.x, rate.y, rate.z, force.x, force.y, force.z], dtype=np.float64)
    # REP 145 and the message's own text: -1 in the first place says that there is no such measurement.
    if message.angular_velocity_covariance[0] == -1 or not all(map(math.isfinite, row[:3])):
        return None
    if message.linear_acceleration_covariance[0] == -1:
        row[3:] = np.nan
    return row


def upward(rows: Array, base: str, frame: str, transforms: Transforms) -> tuple[Array, str]:
    """Direction ``(3,)`` of the robot's vertical axis in the IMU's frame, and where it is known from.

    From the transforms; else from gravity, which an accelerometer shows as a force upwards; else the IMU lies flat.

    Args:
        rows: ``(n, 6)`` as `turn_rate_of` gives them.
        base: frame of the robot.
        frame: of the IMU.
        transforms: of the bag.
    """
    matrix = transforms.to_base(base, frame)
    if matrix is not None:
        return np.asarray(matrix[2, :3], dtype=np.float64), "transforms"
    forces = rows[np.isfinite(rows[:, 3:]).all(axis=1), 3:]
    if len(forces):
        force = np.median(forces, axis=0)
        size = float(np.linalg.norm(force))
        if any(low <= size <= high for low, high in GRAVITY):
            return np.asarray(force / size, dtype=np.float64), "gravity"
    return np.array([0.0, 0.0, 1.0]), "nothing"
