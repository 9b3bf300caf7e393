"""CARMEN text logs: FLASER, ROBOTLASER1, ODOM and PARAM records (carmen.sourceforge.net, logger)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.errors import InputError
from clew.io.carmen_laser import flaser_beams, laser_offset, longest_return, robotlaser_beams
from clew.io.content import Content
from clew.io.log import ReadReport
from clew.io.recorded import RecordedLog, ScanTable

Array = NDArray[np.float64]

# Columns of the native parser's tables.
_IPC_TIME, _LOGGER_TIME, _LASER, _ROBOT = 0, 1, slice(2, 5), slice(5, 8)
_START, _VIEW, _RESOLUTION, _MAXIMUM = 8, 9, 10, 11


def _numbers(parameters: list[tuple[bytes, bytes]]) -> dict[str, float]:
    """The parameters that are finite numbers, by name."""
    out = {}
    for name, text in parameters:
        try:
            value = float(text)
        except ValueError:
            continue
        if math.isfinite(value):
            out[name.decode("latin-1")] = value
    return out


def _names(report: ReadReport) -> str:
    return ", ".join(sorted(report.skipped)) or "none"


def _use_logger_time(numbers: Array) -> bool:
    """Whether the records carry no time of their own (all zero), but the logger's."""
    ipc, logger = numbers[:, _IPC_TIME], numbers[:, _LOGGER_TIME]
    return bool(np.all(ipc == 0) and np.isfinite(logger).all())


def _clean(ranges: Array, scan: NDArray[np.int64], limit: Array) -> Array:
    """Ranges with ``inf`` at and beyond each scan's limit and ``nan`` where they are no distance."""
    cleaned = np.where(ranges >= limit[scan], np.inf, ranges)
    cleaned[~(ranges > 0)] = np.nan
    return cleaned


def read_carmen(path: Path, content: Content, order: str = "time") -> RecordedLog:
    """Read a CARMEN log.

    Timestamps are those of the measuring process (``ipc_time``). A record's first pose is the laser's, its
    second the robot's; see `laser_offset` for what follows from them. Records that are cut off or damaged are
    left out and counted in the report; rear lasers are not used.

    Raises:
        InputError: there is no scan in it, or most of its lines are damaged.
    """
    records = _native.io.parse_carmen(content.data)
    numbers, integers, odometry = records["scan_numbers"], records["scan_integers"], records["odometry"]
    report = ReadReport()
    report.skipped.update(records["skipped"])
    if content.truncated:
        report.skipped["packed file ends early or is damaged: rest of the file"] += 1
    good = len(numbers) + len(odometry) + len(records["parameters"])
    if records["damaged"] > good:
        raise InputError(f"{path}: {records['damaged']} of {records['damaged'] + good} lines cannot be read "
                         f"({_names(report)}); give a CARMEN log, or get the file again")
    if len(numbers) == 0:
        raise InputError(f"{path}: no laser scan in it (left out: {_names(report)}); "
                         "give a log with FLASER or ROBOTLASER1 lines")

    parameters = _numbers(records["parameters"])
    is_flaser, count, first = integers[:, 0] == 0, integers[:, 1], integers[:, 2]
    flaser = flaser_beams(count, parameters)
    header = robotlaser_beams(count, numbers[:, _START], numbers[:, _VIEW], numbers[:, _RESOLUTION])
    angle_min, increment = (np.where(is_flaser, a, b) for a, b in zip(flaser, header, strict=True))

    scan_of = np.repeat(np.arange(len(count)), count)
    beam = np.arange(len(scan_of)) - first[scan_of]
    piled = longest_return(records["ranges"], beam)
    # The parameter serves collision avoidance and may be less than the laser's reach: second choice.
    of_flaser = parameters.get("robot_front_laser_max", 0.0) if math.isinf(piled) else 0.0
    stated = np.where(is_flaser, of_flaser, numbers[:, _MAXIMUM])
    limit = np.where(np.isfinite(stated) & (stated > 0), np.minimum(piled, stated), piled)
    ranges = _clean(records["ranges"], scan_of, limit)
    longest = float(np.max(ranges, initial=0.0, where=np.isfinite(ranges)))
    limit = np.where(np.isfinite(limit), limit, longest)

    laser, robot = numbers[:, _LASER], numbers[:, _ROBOT]
    T_robot_sensor = laser_offset(laser, robot, parameters)
    T_odom_robot = np.where(np.isfinite(robot), robot, laser)
    by_logger = _use_logger_time(numbers)
    time = _LOGGER_TIME if by_logger else _IPC_TIME
    scans = ScanTable(times=numbers[:, time], first=first, count=count, ranges=ranges, angle_min=angle_min,
                      angle_increment=increment, range_min=np.zeros(len(count)), range_max=limit,
                      T_robot_sensor=T_robot_sensor, T_odom_robot=T_odom_robot,
                      rank=np.where(is_flaser, 1, 0).astype(np.int64), position=integers[:, 3])
    return RecordedLog(path, scans, odometry[:, [time, 2, 3, 4, 5]], report, order)
