"""Occupancy grids from scans at known poses."""

from clew.mapping.build import OccupancyGridBuilder, build_occupancy_grid
from clew.mapping.grid import CellState, OccupancyGrid
from clew.mapping.moving import MovingOptions, moving_returns
from clew.mapping.rays import RayBatch, rays_from_scans
from clew.mapping.visibility import View, Views, contradicted, view_of

__all__ = [
    "CellState",
    "MovingOptions",
    "OccupancyGrid",
    "OccupancyGridBuilder",
    "RayBatch",
    "View",
    "Views",
    "build_occupancy_grid",
    "contradicted",
    "moving_returns",
    "rays_from_scans",
    "view_of",
]
