"""The pipeline from measurements to trajectory, graph and map; the only stateful room."""

from clew.slam.config import ClosingOptions, RefinementOptions, SlamConfig, TrackingOptions
from clew.slam.slam import Slam, Trajectory

__all__ = ["ClosingOptions", "RefinementOptions", "Slam", "SlamConfig", "TrackingOptions", "Trajectory"]
