"""Trajectories as text: TUM (RGB-D benchmark) and KITTI odometry files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import so3
from clew.io.poses import to_spatial
from clew.io.table import read_table, time_format, write_table

Array = NDArray[np.float64]


def write_tum(path: str | PathLike[str], timestamps: Array, poses: Array) -> None:
    """Write lines ``timestamp x y z qx qy qz qw``.

    Args:
        path: file to write.
        timestamps: ``(N,)`` seconds.
        poses: ``T_world_robot`` in SE2 ``(N, 3)`` or SE3 ``(N, 7)`` storage.

    Raises:
        InputError: shapes do not fit, a value is not finite, or the file cannot be written.
    """
    spatial = to_spatial(poses)
    timestamps = np.asarray(timestamps, dtype=np.float64)
    if timestamps.shape != (len(spatial),) or not np.isfinite(timestamps).all():
        raise InputError(f"{path}: {len(spatial)} poses need as many finite timestamps, "
                         f"given: shape {timestamps.shape}")
    formats = [time_format(timestamps)] + ["%.9f"] * 3 + ["%.12f"] * 4
    write_table(Path(path), np.column_stack([timestamps, spatial]), formats, "timestamp x y z qx qy qz qw")


def read_tum(path: str | PathLike[str]) -> tuple[Array, Array]:
    """Timestamps ``(N,)`` and poses ``(N, 7)`` in SE3 storage, in the order of the file.

    Raises:
        InputError: the file cannot be read, or a line is not eight numbers with a quaternion of length one.
    """
    rows, lines = read_table(Path(path), 8, "timestamp x y z qx qy qz qw")
    length = np.linalg.norm(rows[:, 4:], axis=1)
    bad = np.flatnonzero(np.abs(length - 1) > 0.01)
    if len(bad):
        raise InputError(f"{path}, line {lines[bad[0]]}: the quaternion has length {length[bad[0]]:.6g}, "
                         "not 1; the order of the fields is timestamp x y z qx qy qz qw")
    return rows[:, 0].copy(), np.column_stack([rows[:, 1:4], so3.canonical(rows[:, 4:])])


def write_kitti(path: str | PathLike[str], poses: Array) -> None:
    """Write each pose as the first three rows of its matrix, row by row: twelve numbers, no timestamp.

    Args:
        path: file to write.
        poses: ``T_world_robot`` in SE2 ``(N, 3)`` or SE3 ``(N, 7)`` storage.

    Raises:
        InputError: the shape does not fit, a value is not finite, or the file cannot be written.
    """
    spatial = to_spatial(poses)
    matrices = np.concatenate([so3.matrix(spatial[:, 3:]), spatial[:, :3, None]], axis=2)
    write_table(Path(path), matrices.reshape(-1, 12), ["%.12g"] * 12)
