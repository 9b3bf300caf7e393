"""Opens a log of any kind, recognised by its content."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from clew.errors import InputError
from clew.io.bag import bag_suffix, read_bag
from clew.io.carmen import read_carmen
from clew.io.content import check_readable, check_text, read_content
from clew.io.log import Log
from clew.io.recorded import ORDERS

_GRAPH_TAGS = (b"VERTEX", b"EDGE", b"FIX", b"PARAMS_")


def open_log(path: str | PathLike[str], *, scan_topic: str | None = None,
             odometry_topic: str | None = None, imu_topic: str | None = None, order: str = "time") -> Log:
    """Open a robot's log, whatever its name is.

    CARMEN text logs, plain or packed with gzip or bzip2; ROS 1 bags; ROS 2 bags (sqlite3 or MCAP), the folder
    with its ``metadata.yaml`` or a single file.

    Args:
        path: the file or folder.
        scan_topic: topic of the laser scans of a bag; by default ``/scan``, else the first of their type.
        odometry_topic: topic of the odometry of a bag; by default ``/odom``, else the first of their type.
        imu_topic: topic of the IMU of a bag; by default the first of ``/imu``, ``/imu/data``, ``/imu/data_raw`` and the
            others by name whose turn rates change in its first messages, or else the first that tells any.
        order: ``"time"`` yields measurements in the order of their timestamps, ``"recorded"`` as they stand
            in the file, ``"auto"`` in the one of the two in which the odometry's path is shorter. Some
            recorders stamped late: in the Intel log the file's order is the true one (508 m; sorted by time
            it zigzags over 661 m). Timestamps are never changed, so they step back in such an order.

    Raises:
        InputError: the file is missing, unreadable, of another kind, mostly damaged, or without a scan; or a
            topic is not in the bag.
        MissingDependencyError: a bag is given and the library `rosbags` is missing or incompatible.
    """
    path = Path(path)
    if order not in ORDERS:
        raise InputError(f"order={order!r}: choose one of {', '.join(ORDERS)}")
    check_readable(path)
    if path.is_dir() and not (path / "metadata.yaml").exists():
        raise InputError(f"{path}: is a folder without metadata.yaml, so no ROS 2 bag; give a log file")
    if path.is_dir() or bag_suffix(path) is not None:
        return read_bag(path, scan_topic, odometry_topic, imu_topic, order)
    if scan_topic is not None or odometry_topic is not None or imu_topic is not None:
        raise InputError(f"{path}: topics are for ROS bags, and this file is none; leave them out")
    content = read_content(path)
    check_text(path, content.data)
    if content.data.lstrip().startswith(_GRAPH_TAGS):
        raise InputError(f"{path}: is a pose graph, not a log; optimise it with `clew optimize`")
    return read_carmen(path, content, order)
