"""Occupancy grids from scans at known poses."""

from clew.mapping.build import OccupancyGridBuilder, build_occupancy_grid
from clew.mapping.grid import CellState, OccupancyGrid
from clew.mapping.moving import MovingOptions, moving_returns
from clew.mapping.rays import RayBatch, rays_from_scans

__all__ = [
    "CellState",
    "MovingOptions",
    "OccupancyGrid",
    "OccupancyGridBuilder",
    "RayBatch",
    "build_occupancy_grid",
    "moving_returns",
    "rays_from_scans",
]
