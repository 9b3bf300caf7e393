"""Turn rates about the robot's vertical axis, from the IMU messages of a ROS bag."""

from __future__ import annotations

import math
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.io.bag_transforms import Transforms

Array = NDArray[np.float64]

#: Where IMUs are found; others come after these, by name.
USUAL = ("/imu", "/imu/data", "/imu/data_raw")
GRAVITY = ((9.0, 10.6), (0.92, 1.08))  # what an accelerometer tells of it: metres a second squared, or multiples
LOOKED_AT = 200  # messages that show whether a topic holds turn rates at all
_STILL, _SILENT = "its first turn rates do not change", "tells no turn rates"


def choose_imu(bag: Any, connections: list[Any]) -> tuple[str | None, dict[str, str]]:
    """The topic to read turn rates from, None if none tells any; and what is wrong with those passed over, by name.

    It is the first whose turn rates change in its first messages. Where none do, it is the first that tells any: the
    robot may stand, and a gyro that is stuck is found out later.

    Args:
        bag: the open bag.
        connections: of IMUs.
    """
    faults: dict[str, str] = {}
    names = {c.topic for c in connections}
    for topic in sorted(names, key=lambda name: (USUAL.index(name) if name in USUAL else len(USUAL), name)):
        rates = _first_rates(bag, [c for c in connections if c.topic == topic])
        if (rates != rates[:1]).any():
            return topic, faults
        faults[topic] = _STILL if len(rates) else _SILENT
    still = next((topic for topic, fault in faults.items() if fault == _STILL), None)
    return still, {topic: fault for topic, fault in faults.items() if topic != still}


def _first_rates(bag: Any, connections: list[Any]) -> Array:
    """``(n, 3)`` of the first messages, until one is damaged."""
    rows = []
    try:
        for connection, _, data in islice(bag.messages(connections), LOOKED_AT):
            row = turn_rate_of(bag.deserialize(data, connection.msgtype))
            rows += [] if row is None else [row[:3]]
    except Exception:  # whatever the library meets in a damaged file, as it comes
        pass
    return np.array(rows).reshape(-1, 3)


def tells_rates(message: Any) -> bool:
    """Whether a message does not itself say that it holds no turn rates (REP 145: -1 in the first place)."""
    return bool(message.angular_velocity_covariance[0] != -1)


def turn_rate_of(message: Any) -> Array | None:
    """``(6,)`` turn rates in radians a second and accelerations about the IMU's own axes; None where it tells no rates.

    Accelerations that the driver does not know are nan.
    """
    rate, force = message.angular_velocity, message.linear_acceleration
    row = np.array([rate.x, rate.y, rate.z, force.x, force.y, force.z], dtype=np.float64)
    if not tells_rates(message) or not all(map(math.isfinite, row[:3])):
        return None
    if message.linear_acceleration_covariance[0] == -1:
        row[3:] = np.nan
    return row


def upward(rows: Array, base: str, frame: str, transforms: Transforms) -> Array:
    """Direction ``(3,)`` of the robot's vertical axis in the IMU's frame.

    From the transforms; else from gravity, which an accelerometer shows as a force upwards; else the IMU lies flat.

    Args:
        rows: ``(n, 6)`` as `turn_rate_of` gives them.
        base: frame of the robot.
        frame: of the IMU.
        transforms: of the bag.
    """
    matrix = transforms.to_base(base, frame)
    if matrix is not None:
        return np.asarray(matrix[2, :3], dtype=np.float64)
    forces = rows[np.isfinite(rows[:, 3:]).all(axis=1), 3:]
    if len(forces):
        force = np.median(forces, axis=0)
        size = float(np.linalg.norm(force))
        if any(low <= size <= high for low, high in GRAVITY):
            return np.asarray(force / size, dtype=np.float64)
    return np.array([0.0, 0.0, 1.0])
