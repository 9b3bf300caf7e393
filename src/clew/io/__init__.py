"""Files: one format a module."""

from clew.io.atomic import atomic_write, atomic_write_binary, ensure_output_folder
from clew.io.log import Log, Measurement, ReadReport
from clew.io.open_log import open_log
from clew.io.relations import Relations, read_relations, write_relations
from clew.io.ros_map import RosMap, read_ros_map, write_ros_map
from clew.io.trajectory import read_tum, write_kitti, write_tum

__all__ = [
    "Log",
    "Measurement",
    "ReadReport",
    "Relations",
    "RosMap",
    "atomic_write",
    "atomic_write_binary",
    "ensure_output_folder",
    "open_log",
    "read_relations",
    "read_ros_map",
    "read_tum",
    "write_kitti",
    "write_relations",
    "write_ros_map",
    "write_tum",
]
