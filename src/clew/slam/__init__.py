"""The pipeline from measurements to trajectory, graph and map; the only stateful room."""

from clew.slam.config import ClosingOptions, PruningOptions, RefinementOptions, SlamConfig, TrackingOptions
from clew.slam.pruning import Pruned
from clew.slam.slam import Slam, Trajectory

__all__ = [
    "ClosingOptions",
    "Pruned",
    "PruningOptions",
    "RefinementOptions",
    "Slam",
    "SlamConfig",
    "TrackingOptions",
    "Trajectory",
]
