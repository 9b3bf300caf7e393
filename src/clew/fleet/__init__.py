"""Several robots: where they stand to each other, and all their graphs solved as one."""

from clew.fleet.build import graph_of_run, graphs_of_fleet
from clew.fleet.files import read_landmarks, read_robots, write_landmarks
from clew.fleet.merge import MergedFleet, merge
from clew.fleet.outputs import write_merged
from clew.fleet.relative_pose import MergeOptions, RelativePose, Verdict, relative_pose
from clew.fleet.robot import Encounters, InterRobotEdges, LandmarkMap, RobotGraph, robot_graph

__all__ = [
    "Encounters",
    "InterRobotEdges",
    "LandmarkMap",
    "MergeOptions",
    "MergedFleet",
    "RelativePose",
    "RobotGraph",
    "Verdict",
    "graph_of_run",
    "graphs_of_fleet",
    "merge",
    "read_landmarks",
    "read_robots",
    "relative_pose",
    "robot_graph",
    "write_landmarks",
    "write_merged",
]
