"""Small ROS bags, written with the `rosbags` library."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


class Bag:
    """Writes one small bag of a kind."""

    def __init__(self, path: Path, kind: str) -> None:
        self.types = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
        self.ros1 = kind == "ros1"
        if self.ros1:
            text = "geometry_msgs/TransformStamped[] transforms"
            self.types.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
        self.writer: Any
        if self.ros1:
            self.writer = Writer1(path)
        else:
            plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
            self.writer = Writer2(path, version=9, storage_plugin=plugin)
        self.writer.open()
        self.connections: dict[str, Any] = {}

    def make(self, name: str, **fields: Any) -> Any:
        return self.types.types[name](**fields)

    def put(self, topic: str, message: Any, time: float) -> None:
        if topic not in self.connections:
            added = self.writer.add_connection(topic, message.__msgtype__, typestore=self.types)
            self.connections[topic] = added
        pack: Callable[..., Any] = self.types.serialize_ros1 if self.ros1 else self.types.serialize_cdr
        self.writer.write(self.connections[topic], int(time * 1e9), pack(message, message.__msgtype__))

    def header(self, time: float, frame: str) -> Any:
        stamp = self.make("builtin_interfaces/msg/Time", sec=int(time), nanosec=round(time % 1 * 1e9))
        sequence = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **sequence)

    def scan(self, time: float, ranges: list[float], topic: str = "/scan",
             received: float | None = None, time_increment: float = 0.0) -> None:
        self.put(topic, self.make(
            "sensor_msgs/msg/LaserScan", header=self.header(time, "laser"), angle_min=-1.0, angle_max=1.0,
            angle_increment=0.5, time_increment=time_increment, scan_time=0.0, range_min=0.1, range_max=8.0,
            ranges=np.array(ranges, dtype=np.float32), intensities=np.zeros(0, dtype=np.float32),
        ), time if received is None else received)

    def odometry(self, time: float, x: float, yaw: float, topic: str = "/odom") -> None:
        vector = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        point = self.make("geometry_msgs/msg/Point", x=x, y=0.0, z=0.0)
        self.put(topic, self.make(
            "nav_msgs/msg/Odometry", header=self.header(time, "odom"), child_frame_id="base_footprint",
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", covariance=np.zeros(36), pose=self.make(
                "geometry_msgs/msg/Pose", position=point, orientation=self.quaternion(yaw))),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", covariance=np.zeros(36), twist=self.make(
                "geometry_msgs/msg/Twist", linear=vector, angular=vector))), time)

    def imu(self, time: float, rates: tuple[float, float, float], topic: str = "/imu", frame: str = "imu", *,
            force: tuple[float, float, float] | None = None, known: bool = True) -> None:
        turn, push = (self.make("geometry_msgs/msg/Vector3", x=float(v[0]), y=float(v[1]), z=float(v[2]))
                      for v in (rates, force or (0.0, 0.0, 0.0)))
        unknown = np.array([-1.0, *np.zeros(8)])
        self.put(topic, self.make(
            "sensor_msgs/msg/Imu", header=self.header(time, frame), orientation=self.quaternion(0.0),
            orientation_covariance=unknown, angular_velocity=turn,
            angular_velocity_covariance=np.zeros(9) if known else unknown, linear_acceleration=push,
            linear_acceleration_covariance=unknown if force is None else np.zeros(9)), time)

    def quaternion(self, yaw: float, roll: float = 0.0) -> Any:
        cr, sr, cy, sy = math.cos(roll / 2), math.sin(roll / 2), math.cos(yaw / 2), math.sin(yaw / 2)
        return self.make("geometry_msgs/msg/Quaternion", x=sr * cy, y=sr * sy, z=cr * sy, w=cr * cy)

    def transform(self, parent: str, child: str, x: float, y: float, yaw: float, roll: float = 0.0,
                  topic: str = "/tf_static") -> None:
        move = self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=0.2)
        stamped = self.make("geometry_msgs/msg/TransformStamped", header=self.header(0.5, parent),
                            child_frame_id=child, transform=self.make(
                                "geometry_msgs/msg/Transform", translation=move,
                                rotation=self.quaternion(yaw, roll)))
        self.put(topic, self.make("tf2_msgs/msg/TFMessage", transforms=[stamped]), 0.5)

    def close(self) -> None:
        self.writer.close()


KINDS = ["ros1", "sqlite3", "mcap"]


def new_bag(tmp_path: Path, kind: str) -> tuple[Path, Bag]:
    path = tmp_path / ("log.bag" if kind == "ros1" else "log")
    return path, Bag(path, kind)
