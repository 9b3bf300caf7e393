"""Writes logs as CARMEN text: ROBOTLASER1 and ODOM records (carmen.sourceforge.net, logger)."""

from __future__ import annotations

import bz2
import gzip
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import se2, wrap
from clew.io.atomic import atomic_write_binary
from clew.io.log import Log
from clew.io.recorded import RecordedLog

Array = NDArray[np.float64]

_LASER_TYPE, _ACCURACY, _REMISSION_MODE = 0, "0.01", 0


def write_carmen_log(path: str | PathLike[str], log: Log) -> None:
    """Write a log such that `open_log` reads it again: times to the microsecond, ranges as 32-bit floats.

    Records stand in the order of recording.

    A record holds the scan, where the laser is and where the robot is by its odometry; for scans that have no odometry
    of their own it is interpolated, held beyond its ends.

    Args:
        path: file to write; packed if its name ends in ``.gz`` or ``.bz2``.
        log: any log.

    Raises:
        InputError: the log has no odometry, a scan is upside down, or the file cannot be written.
    """
    path = Path(path)
    recorded = RecordedLog.of(log)
    scans, odometry = recorded.scans, recorded.odometry
    if not recorded.has_odometry:
        raise InputError(f"{path}: CARMEN records hold the odometry with each scan, and {log.path} has none; "
                         "convert it to a bag")
    if np.any(scans.angle_increment < 0):
        raise InputError(f"{path}: CARMEN records cannot describe a laser that is mounted upside down; "
                         "convert it to a bag")
    poses = _odometry_at(scans.times, scans.T_odom_robot, odometry)
    lasers = se2.compose(poses, np.asarray(scans.T_robot_sensor))
    limit = np.where(np.isfinite(scans.range_max), scans.range_max, _beyond(scans.ranges))
    lines: list[tuple[int, float, str]] = []
    for i in range(len(scans.times)):
        ranges = scans.ranges[scans.first[i] : scans.first[i] + scans.count[i]].astype(np.float32)
        clean = np.where(np.isnan(ranges), np.float32(0), np.where(np.isinf(ranges), np.float32(limit[i]), ranges))
        view = scans.angle_increment[i] * max(scans.count[i] - 1, 0)
        header = np.array([scans.angle_min[i], view, scans.angle_increment[i], limit[i]])
        fields = [_LASER_TYPE, *_numbers(header), _ACCURACY, _REMISSION_MODE, len(clean), *map(str, clean), 0,
                  *_numbers(lasers[i]), *_numbers(poses[i]), 0, 0, 0, 0, 0]
        lines.append((int(scans.position[i]), float(scans.times[i]), "ROBOTLASER1 " + " ".join(map(str, fields))))
    of_scans = set(map(tuple, np.column_stack([scans.times, poses]).tolist()))
    for time, *pose, position in odometry.tolist():
        if (time, *pose) not in of_scans:  # those stand in the records of the scans
            lines.append((int(position), time, "ODOM " + " ".join([*_numbers(np.array(pose)), "0", "0", "0"])))
    lines.sort(key=lambda line: line[0])
    start = min(time for _, time, _ in lines)
    text = "".join(f"{line} {time:.6f} clew {time - start:.6f}\n" for _, time, line in lines)
    data = ("# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp\n" + text).encode("ascii")
    if path.suffix == ".gz":
        data = gzip.compress(data, mtime=0)
    elif path.suffix == ".bz2":
        data = bz2.compress(data)
    with atomic_write_binary(path) as file:
        file.write(data)


def _numbers(values: Array) -> list[str]:
    return [repr(value) for value in (values + 0.0).tolist()]


def _beyond(ranges: Array) -> float:
    """A range that stands for no return where the sensor names no limit: a metre beyond the longest return."""
    return float(np.max(ranges, initial=0.0, where=np.isfinite(ranges))) + 1.0


def _odometry_at(times: Array, own: Array, apart: Array) -> Array:
    """Poses ``(N, 3)`` at the scans: their own, else between the readings around them."""
    known = ~np.isnan(own[:, 0])
    rows = np.concatenate([np.column_stack([times[known], own[known]]), apart[:, :4]])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    after = np.clip(np.searchsorted(rows[:, 0], times, side="right"), 1, max(len(rows) - 1, 1))
    before, after = rows[after - 1], rows[np.minimum(after, len(rows) - 1)]
    gap = np.maximum(after[:, 0] - before[:, 0], 1e-9)
    share = np.clip((times - before[:, 0]) / gap, 0.0, 1.0)[:, None]
    step = after[:, 1:] - before[:, 1:]
    step[:, 2] = wrap(step[:, 2])
    between = before[:, 1:] + share * step
    return np.where(known[:, None], own, between)
