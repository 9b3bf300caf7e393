"""Files: one format a module."""

from clew.io.atomic import atomic_write, atomic_write_binary, ensure_output_folder
from clew.io.feature_drive import UNNAMED, FeatureLog
from clew.io.feature_log import is_feature_log, read_feature_log
from clew.io.graph_file import Features, GraphFile, GraphReport
from clew.io.log import Log, Measurement, ReadReport
from clew.io.mrclam import is_mrclam, mrclam_robots, read_mrclam, read_survey
from clew.io.open_log import open_log
from clew.io.read_graph import read_graph
from clew.io.relations import Relations, read_relations, write_relations
from clew.io.ros_map import RosMap, read_ros_map, write_ros_map
from clew.io.sightings import SightingLog, Sightings, SurveyedLandmarks, Velocities
from clew.io.trajectory import read_tum, write_kitti, write_tum
from clew.io.write_graph import write_graph

__all__ = [
    "UNNAMED",
    "FeatureLog",
    "Features",
    "GraphFile",
    "GraphReport",
    "Log",
    "Measurement",
    "ReadReport",
    "Relations",
    "RosMap",
    "SightingLog",
    "Sightings",
    "SurveyedLandmarks",
    "Velocities",
    "atomic_write",
    "atomic_write_binary",
    "ensure_output_folder",
    "is_feature_log",
    "is_mrclam",
    "mrclam_robots",
    "open_log",
    "read_feature_log",
    "read_graph",
    "read_mrclam",
    "read_relations",
    "read_ros_map",
    "read_survey",
    "read_tum",
    "write_graph",
    "write_kitti",
    "write_relations",
    "write_ros_map",
    "write_tum",
]
