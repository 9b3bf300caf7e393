"""Occupancy grids from scans at known poses."""

from clew.mapping.build import OccupancyGridBuilder, build_occupancy_grid
from clew.mapping.grid import CellState, OccupancyGrid
from clew.mapping.rays import RayBatch, rays_from_scans

__all__ = [
    "CellState",
    "OccupancyGrid",
    "OccupancyGridBuilder",
    "RayBatch",
    "build_occupancy_grid",
    "rays_from_scans",
]
