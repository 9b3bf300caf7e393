"""Trajectories as text: TUM (RGB-D benchmark), CSV with a header line, and KITTI odometry files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import so3
from clew.io.content import check_text, read_content
from clew.io.poses import to_spatial
from clew.io.table import parse_rows, read_table, time_format, write_table

Array = NDArray[np.float64]

_FIELDS = "timestamp x y z qx qy qz qw"


def write_tum(path: str | PathLike[str], timestamps: Array, poses: Array) -> None:
    """Write lines ``timestamp x y z qx qy qz qw``.

    Args:
        path: file to write.
        timestamps: ``(N,)`` seconds.
        poses: ``T_world_robot`` in SE2 ``(N, 3)`` or SE3 ``(N, 7)`` storage.

    Raises:
        InputError: shapes do not fit, a value is not finite, or the file cannot be written.
    """
    rows, formats = _rows(path, timestamps, poses)
    write_table(Path(path), rows, formats, _FIELDS)


def _rows(path: str | PathLike[str], timestamps: Array, poses: Array) -> tuple[Array, list[str]]:
    """Rows ``(N, 8)`` of a trajectory and the format of each column."""
    spatial = to_spatial(poses)
    timestamps = np.asarray(timestamps, dtype=np.float64)
    if timestamps.shape != (len(spatial),) or not np.isfinite(timestamps).all():
        raise InputError(f"{path}: {len(spatial)} poses need as many finite timestamps, "
                         f"given: shape {timestamps.shape}")
    formats = [time_format(timestamps)] + ["%.9f"] * 3 + ["%.12f"] * 4
    return np.column_stack([timestamps, spatial]), formats


def read_tum(path: str | PathLike[str]) -> tuple[Array, Array]:
    """Timestamps ``(N,)`` and poses ``(N, 7)`` in SE3 storage, in the order of the file.

    Raises:
        InputError: the file cannot be read, or a line is not eight numbers with a quaternion of length one.
    """
    rows, lines = read_table(Path(path), 8, _FIELDS)
    return _stamped(Path(path), rows, lines)


def _stamped(path: Path, rows: Array, lines: NDArray[np.int64]) -> tuple[Array, Array]:
    """Timestamps and poses of rows ``(N, 8)``, each from its line."""
    length = np.linalg.norm(rows[:, 4:], axis=1)
    bad = np.flatnonzero(np.abs(length - 1) > 0.01)
    if len(bad):
        raise InputError(f"{path}, line {lines[bad[0]]}: the quaternion has length {length[bad[0]]:.6g}, "
                         f"not 1; the order of the fields is {_FIELDS}")
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


def read_kitti(path: str | PathLike[str]) -> Array:
    """Poses ``(N, 7)`` in SE3 storage of lines of twelve numbers; the format has no timestamps.

    Raises:
        InputError: the file cannot be read, or a line is not twelve numbers with a rotation matrix.
    """
    rows, lines = read_table(Path(path), 12, "the first three rows of a pose's matrix")
    matrices = rows.reshape(-1, 3, 4)
    rotation = matrices[:, :, :3]
    error = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    bad = np.flatnonzero((error > 0.01) | (np.linalg.det(rotation) < 0))
    if len(bad):
        raise InputError(f"{path}, line {lines[bad[0]]}: columns 1-3, 5-7 and 9-11 are no rotation matrix; give a "
                         "KITTI file of poses")
    return np.column_stack([matrices[:, :, 3], so3.canonical(so3.from_matrix(rotation))])


def write_csv(path: str | PathLike[str], timestamps: Array, poses: Array) -> None:
    """As `write_tum`, with commas and a header line, for spreadsheets and data frames."""
    rows, formats = _rows(path, timestamps, poses)
    write_table(Path(path), rows, formats, _FIELDS.replace(" ", ","), comma=True)


def read_csv(path: str | PathLike[str]) -> tuple[Array, Array]:
    """As `read_tum`, of a file with commas and a header line as `write_csv` writes it; z and quaternion in full.

    Raises:
        InputError: the file cannot be read, its header is another, or a line is not eight such numbers.
    """
    path = Path(path)
    data = read_content(path).data
    check_text(path, data)
    header, _, body = data.partition(b"\n")
    names = header.decode("latin-1").strip().lstrip("#").lower().replace(" ", "").split(",")
    if names != _FIELDS.split():
        raise InputError(f"{path}: the first line is not {_FIELDS.replace(' ', ',')}; correct it")
    rows, lines = parse_rows(path, body.replace(b",", b" "), 8, _FIELDS)
    return _stamped(path, rows, lines + 1)
