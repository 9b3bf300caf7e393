"""Where the robot was, scan by scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trajectory:
    """Poses of the robot, one for every scan.

    Attributes:
        timestamps: ``(N,)`` seconds.
        T_world_robot: ``(N, 3)``.
    """

    timestamps: Array
    T_world_robot: Array

    def __len__(self) -> int:
        return int(self.timestamps.shape[0])
