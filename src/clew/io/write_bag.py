"""Writes logs as ROS bags with the `rosbags` library: LaserScan, Odometry, Imu and the laser's place on the robot."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from clew.errors import InputError, MissingDependencyError
from clew.io.bag import load_rosbags
from clew.io.log import Log
from clew.motion import Odometry, TurnRates
from clew.scan import LaserScan

_SCAN, _ODOMETRY, _IMU = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
_TRANSFORM, _TRANSFORMS = "geometry_msgs/msg/TransformStamped", "tf2_msgs/msg/TFMessage"
STYLES = ("ros1", "sqlite3", "mcap")


def write_bag(path: str | PathLike[str], log: Log, style: str) -> None:
    """Write ``/scan``, ``/odom``, ``/tf_static``, and ``/imu`` if there are turn rates.

    Ranges become 32-bit floats, times whole nanoseconds.

    Args:
        path: file to write, or for a ROS 2 bag without the ending ``.db3`` or ``.mcap`` the folder.
        log: any log.
        style: "ros1", "sqlite3" or "mcap".

    Raises:
        InputError: a style that does not exist, the folder exists, a time before 1970, or it cannot be written.
        MissingDependencyError: the library `rosbags` is missing or does not fit.
    """
    path = Path(path)
    if style not in STYLES:
        raise InputError(f"style={style!r}: choose {', '.join(STYLES)}")
    load_rosbags(path)
    with _aside(path, style) as place:
        try:
            writer = _Writer(place, style)
        except (ImportError, AttributeError) as error:
            raise MissingDependencyError(f"{path}: the installed version of rosbags does not fit ({error}); install it "
                                         "with: pip install 'clew[bags]'") from error
        with writer.bag:
            writer.write(log)


@contextmanager
def _aside(path: Path, style: str) -> Iterator[Path]:
    """A place beside `path` for a bag, which takes the name when the block ends without an error."""
    single = style == "ros1" or path.suffix in (".db3", ".mcap")
    if path.exists() and (path.is_dir() or not single):
        raise InputError(f"{path}: is there already; remove it or choose another name")
    try:
        with tempfile.TemporaryDirectory(prefix=f".{path.name[:100]}.", dir=path.resolve().parent) as folder:
            place = Path(folder) / ("bag" if single else path.name)  # the bag may hold its name
            yield place
            if style != "ros1" and single:
                place = next(file for file in place.iterdir() if file.suffix == path.suffix)
            if single:
                os.replace(place, path)
            else:
                shutil.move(place, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); choose another place or make "
                         "room") from error


@dataclass(frozen=True)
class _Frames:
    robot: str = "base_link"
    laser: str = "laser"
    odometry: str = "odom"


class _Writer:
    """Messages into one bag."""

    def __init__(self, place: Path, style: str) -> None:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.types = get_typestore(Stores.ROS1_NOETIC if style == "ros1" else Stores.ROS2_HUMBLE)
        self.ros1 = style == "ros1"
        if _TRANSFORMS not in self.types.fielddefs:
            self.types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", _TRANSFORMS))
        self.bag: Any
        if self.ros1:
            self.bag = Writer1(place)
        else:
            plugin = StoragePlugin.MCAP if style == "mcap" else StoragePlugin.SQLITE3
            self.bag = Writer2(place, version=9, storage_plugin=plugin)
        self.frames = _Frames()
        self.sequence = 0

    def write(self, log: Log) -> None:
        """All measurements in the order of the log, the laser's place with the first scan."""
        kinds = [("/scan", _SCAN), ("/odom", _ODOMETRY), ("/tf_static", _TRANSFORMS)]
        kinds += [("/imu", _IMU)] if log.has_gyro else []
        topics = {name: self.bag.add_connection(name, kind, typestore=self.types) for name, kind in kinds}
        pack = self.types.serialize_ros1 if self.ros1 else self.types.serialize_cdr
        placed, received = False, 0
        for measurement in log.measurements():
            if measurement.timestamp < 0:
                raise InputError(f"{log.path}: has the time {measurement.timestamp:.6f} s; bags hold none before 1970")
            if isinstance(measurement, TurnRates):
                for timestamp, rate in zip(measurement.timestamps.tolist(), measurement.rates.tolist(), strict=True):
                    received = max(round(timestamp * 1e9), received + 1)
                    self.bag.write(topics["/imu"], received, pack(self._turn_rate(timestamp, rate), _IMU))
                continue
            # Readers sort by the time of arrival: where clocks step back, what is recorded later arrives later.
            received = max(round(measurement.timestamp * 1e9), received + 1)
            if isinstance(measurement, LaserScan):
                if not placed:
                    message = self._place(measurement)
                    self.bag.write(topics["/tf_static"], received, pack(message, _TRANSFORMS))
                    placed = True
                self.bag.write(topics["/scan"], received, pack(self._scan(measurement), _SCAN))
            else:
                self.bag.write(topics["/odom"], received, pack(self._reading(measurement), _ODOMETRY))

    def make(self, name: str, **fields: Any) -> Any:
        return self.types.types[name](**fields)

    def _header(self, timestamp: float, frame: str) -> Any:
        # A stamp of zero says that there is none.
        seconds, nanoseconds = divmod(max(round(timestamp * 1e9), 1), 1_000_000_000)
        stamp = self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        self.sequence += 1
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame,
                         **({"seq": self.sequence} if self.ros1 else {}))

    def _vector(self, kind: str, x: float = 0.0, y: float = 0.0) -> Any:
        return self.make(f"geometry_msgs/msg/{kind}", x=float(x), y=float(y), z=0.0)

    def _turn(self, yaw: float) -> Any:
        sine, cosine = float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
        return self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=sine, w=cosine)

    def _place(self, scan: LaserScan) -> Any:
        x, y, yaw = scan.T_robot_sensor.tolist()
        transform = self.make("geometry_msgs/msg/Transform", translation=self._vector("Vector3", x, y),
                              rotation=self._turn(yaw))
        stamped = self.make(_TRANSFORM, header=self._header(scan.timestamp, self.frames.robot),
                            child_frame_id=self.frames.laser, transform=transform)
        return self.make(_TRANSFORMS, transforms=[stamped])

    def _scan(self, scan: LaserScan) -> Any:
        last = scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1)
        strengths = np.zeros(0) if scan.intensities is None else scan.intensities
        return self.make(_SCAN, header=self._header(scan.timestamp, self.frames.laser), angle_min=scan.angle_min,
                         angle_max=last, angle_increment=scan.angle_increment, time_increment=scan.time_increment,
                         scan_time=scan.time_increment * len(scan.ranges),
                         range_min=scan.range_min, range_max=scan.range_max, ranges=scan.ranges.astype(np.float32),
                         intensities=np.asarray(strengths, dtype=np.float32))

    def _turn_rate(self, timestamp: float, rate: float) -> Any:
        """About the robot's own vertical axis; orientation and acceleration are said to be unknown."""
        turn = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=rate)
        unknown = np.array([-1.0, *np.zeros(8)])
        return self.make(_IMU, header=self._header(timestamp, self.frames.robot), orientation=self._turn(0.0),
                         orientation_covariance=unknown, angular_velocity=turn,
                         angular_velocity_covariance=np.zeros(9), linear_acceleration=self._vector("Vector3"),
                         linear_acceleration_covariance=unknown)

    def _reading(self, odometry: Odometry) -> Any:
        x, y, yaw = odometry.T_odom_robot.tolist()
        pose = self.make("geometry_msgs/msg/Pose", position=self._vector("Point", x, y), orientation=self._turn(yaw))
        twist = self.make("geometry_msgs/msg/Twist", linear=self._vector("Vector3"), angular=self._vector("Vector3"))
        unknown = np.zeros(36)
        return self.make(
            _ODOMETRY, header=self._header(odometry.timestamp, self.frames.odometry), child_frame_id=self.frames.robot,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=unknown))
