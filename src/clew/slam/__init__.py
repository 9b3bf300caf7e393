"""The pipeline from measurements to trajectory, graph and map; the only stateful room."""

from clew.slam.config import ClosingOptions, PruningOptions, RefinementOptions, SlamConfig, TrackingOptions
from clew.slam.pruning import Pruned
from clew.slam.slam import Slam
from clew.slam.trajectory import Trajectory
from clew.slam.viewer import NullViewer, Viewer

__all__ = [
    "ClosingOptions",
    "NullViewer",
    "Pruned",
    "PruningOptions",
    "RefinementOptions",
    "Slam",
    "SlamConfig",
    "TrackingOptions",
    "Trajectory",
    "Viewer",
]
