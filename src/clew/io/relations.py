"""Relations between poses of a log (Kümmerle et al., On measuring the accuracy of SLAM algorithms, 2009)."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.io.poses import angles_of_quaternions, quaternions_of_angles, to_spatial
from clew.io.table import read_table, time_format, write_table

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Relations:
    """``N`` true relative poses.

    Attributes:
        first, second: ``(N,)`` timestamps, seconds.
        T_first_second: ``(N, 7)`` pose of the robot at the second time seen from the first, SE3 storage.
    """

    first: Array
    second: Array
    T_first_second: Array


def read_relations(path: str | PathLike[str]) -> Relations:
    """Read lines ``t1 t2 x y z roll pitch yaw``.

    Raises:
        InputError: the file cannot be read, or a line is not eight finite numbers.
    """
    rows, _ = read_table(Path(path), 8, "t1 t2 x y z roll pitch yaw")
    rotation = quaternions_of_angles(rows[:, 5], rows[:, 6], rows[:, 7])
    return Relations(rows[:, 0].copy(), rows[:, 1].copy(), np.column_stack([rows[:, 2:5], rotation]))


def write_relations(path: str | PathLike[str], relations: Relations) -> None:
    """Write lines ``t1 t2 x y z roll pitch yaw``.

    Raises:
        InputError: a pose is not finite, or the file cannot be written.
    """
    poses = to_spatial(relations.T_first_second)
    angles = angles_of_quaternions(poses[:, 3:])
    rows = np.column_stack([relations.first, relations.second, poses[:, :3], angles])
    time = time_format(np.concatenate([relations.first, relations.second]))
    write_table(Path(path), rows, [time, time] + ["%.9f"] * 3 + ["%.12f"] * 3)
