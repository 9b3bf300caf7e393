"""One reading of a robot's odometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Odometry:
    """Where the odometry believes the robot to be.

    Attributes:
        timestamp: seconds.
        T_odom_robot: ``(3,)`` pose of the robot in the odometry frame: x, y in metres, theta in radians.
    """

    timestamp: float
    T_odom_robot: Array
