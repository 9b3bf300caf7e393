"""Files: one format a module."""

from clew.io.atomic import atomic_write, atomic_write_binary, ensure_output_folder
from clew.io.bag import Topic, list_topics
from clew.io.feature_drive import UNNAMED, FeatureLog
from clew.io.feature_log import is_feature_log, read_feature_log
from clew.io.graph_file import Features, GraphFile, GraphReport
from clew.io.health import GyroHealth, LaserHealth, LogHealth, StreamHealth, log_health, stream_health
from clew.io.kind import FileKind, file_kind
from clew.io.log import Log, Measurement, ReadReport, Records
from clew.io.mrclam import is_mrclam, mrclam_robots, read_mrclam, read_survey
from clew.io.open_log import open_log
from clew.io.read_graph import read_graph
from clew.io.relations import Relations, read_relations, write_relations
from clew.io.ros_map import RosMap, read_png_map, read_ros_map, write_png_map, write_ros_map
from clew.io.sightings import SightingLog, Sightings, SurveyedLandmarks, Velocities
from clew.io.trajectory import read_csv, read_kitti, read_tum, write_csv, write_kitti, write_tum
from clew.io.write_bag import write_bag
from clew.io.write_carmen import write_carmen_log
from clew.io.write_graph import write_graph

__all__ = [
    "UNNAMED",
    "FeatureLog",
    "Features",
    "FileKind",
    "GraphFile",
    "GraphReport",
    "GyroHealth",
    "LaserHealth",
    "Log",
    "LogHealth",
    "Measurement",
    "ReadReport",
    "Records",
    "Relations",
    "RosMap",
    "SightingLog",
    "Sightings",
    "StreamHealth",
    "SurveyedLandmarks",
    "Topic",
    "Velocities",
    "atomic_write",
    "atomic_write_binary",
    "ensure_output_folder",
    "file_kind",
    "is_feature_log",
    "is_mrclam",
    "list_topics",
    "log_health",
    "mrclam_robots",
    "open_log",
    "read_csv",
    "read_feature_log",
    "read_graph",
    "read_kitti",
    "read_mrclam",
    "read_png_map",
    "read_relations",
    "read_ros_map",
    "read_survey",
    "read_tum",
    "stream_health",
    "write_bag",
    "write_carmen_log",
    "write_csv",
    "write_graph",
    "write_kitti",
    "write_png_map",
    "write_relations",
    "write_ros_map",
    "write_tum",
]
