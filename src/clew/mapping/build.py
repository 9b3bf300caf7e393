"""Occupancy grids from scans at known poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.errors import InputError
from clew.mapping.grid import OccupancyGrid
from clew.mapping.rays import FREE_RANGE, RayBatch, rays_from_scans
from clew.scan import LaserScan

Array = NDArray[np.float64]

#: Log-odds that one scan adds to a cell where a ray ends or passes, and the bounds of their sum. A hit speaks
#: for 0.7, a miss for 0.4, within [0.12, 0.97] (Hornung et al., OctoMap, Autonomous Robots 2013).
LOG_ODDS_HIT = float(np.log(0.7 / 0.3))
LOG_ODDS_MISS = float(np.log(0.4 / 0.6))
LOG_ODDS_BOUNDS = (-2.0, 3.5)

_SCANS_AT_ONCE = 512
_MAX_CELLS = 2**29  # 3 GB of counts; a larger grid comes from poses gone astray
_SLACK = 0.125  # of the grid's side that is added at each end when it grows


class OccupancyGridBuilder:
    """Counts hits and misses of rays in a grid that grows as they come.

    Each scan touches a cell at most once, and a hit wins over a miss: neighbouring beams that graze a wall do
    not erase it. The last half cell before a hit is not called free. Only counts are kept, so the map does
    not depend on the order of the scans. Cell borders lie at whole multiples of the resolution, in every map.

    Args:
        resolution: side of a cell, metres.

    Raises:
        InputError: the resolution is not positive.
    """

    def __init__(self, resolution: float = 0.05) -> None:
        if not (np.isfinite(resolution) and resolution > 0.0):
            raise InputError(f"the resolution of an occupancy grid must be positive, not {resolution}")
        self.resolution = float(resolution)
        # Hits, misses and the number of the last scan that touched the cell (native/mapping/raycast.hpp).
        self._cells = np.zeros((0, 0, 3), dtype=np.uint16)
        self._corner = np.zeros(2, dtype=np.int64)  # row and column of the first cell in the infinite grid
        self._stamp = 0

    def add(self, rays: RayBatch) -> None:
        """Cast rays into the grid.

        Raises:
            InputError: the rays spread over more cells than fit into memory.
        """
        if len(rays) == 0:
            return
        self._cover(rays)
        self._stamp = _native.mapping.cast_rays(
            self._cells, int(self._corner[0]), int(self._corner[1]), self.resolution, rays.T_world_sensor,
            rays.offsets, rays.endpoints, rays.hit, 0.5 * self.resolution, self._stamp)

    def grid(self, padding: float = 1.0) -> OccupancyGrid:
        """The map so far: `OccupancyGrid.cropped` to what was observed, with `padding` metres around."""
        hits, misses = self._cells[..., 0], self._cells[..., 1]
        log_odds = hits * np.float32(LOG_ODDS_HIT)
        log_odds += misses * np.float32(LOG_ODDS_MISS)
        np.clip(log_odds, *LOG_ODDS_BOUNDS, out=log_odds)
        origin: Array = self._corner[::-1].astype(np.float64) * self.resolution
        return OccupancyGrid(log_odds, self.resolution, origin).cropped(padding)

    def _cover(self, rays: RayBatch) -> None:
        """Grow the grid until it holds all rays."""
        x_min, y_min, x_max, y_max = _native.mapping.ray_bounds(
            rays.T_world_sensor, rays.offsets, rays.endpoints, rays.hit)
        # One cell more all around: rounding may put a point on a border into either cell.
        low = np.floor(np.array([y_min, x_min]) / self.resolution) - 1.0
        high = np.floor(np.array([y_max, x_max]) / self.resolution) + 2.0
        shape = np.array(self._cells.shape[:2])
        if shape.any():
            low = np.minimum(low, self._corner)
            high = np.maximum(high, self._corner + shape)
            if (low == self._corner).all() and (high == self._corner + shape).all():
                return
        rows, cols = high - low
        if rows > _MAX_CELLS / cols:
            width, height = cols * self.resolution, rows * self.resolution
            raise InputError(f"a map of {width:.0f} m x {height:.0f} m with cells of {self.resolution} m "
                             "does not fit into memory: check the poses, or take larger cells")
        slack = np.ceil(_SLACK * (high - low))
        corner = np.where(low < self._corner, low - slack, low).astype(np.int64)
        end = np.where(high > self._corner + shape, high + slack, high).astype(np.int64)
        grown = np.zeros((*(end - corner), 3), dtype=np.uint16)
        row, col = self._corner - corner if shape.any() else (0, 0)
        grown[row:row + shape[0], col:col + shape[1]] = self._cells
        self._cells, self._corner = grown, corner


def build_occupancy_grid(
    scans: Sequence[LaserScan],
    T_world_robot: Array,
    *,
    resolution: float = 0.05,
    max_range: float | None = None,
    free_range: float = FREE_RANGE,
    padding: float = 1.0,
    exclude: Sequence[NDArray[np.bool_]] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> OccupancyGrid:
    """Map of all scans at known robot poses.

    Args:
        scans: ``N`` scans.
        T_world_robot: ``(N, 3)`` pose of the robot at each scan.
        resolution: side of a cell, metres.
        max_range: longest ray, metres (see `rays_from_scans`).
        free_range: longest free ray of a beam without return, metres.
        padding: border around the map, metres.
        exclude: for each scan a mask over its beams, True where the return is left out (see `moving_returns`).
        progress: called with the number of scans done and of all scans.

    Raises:
        InputError: the arguments do not fit together, or the map does not fit into memory.
    """
    poses = np.asarray(T_world_robot, dtype=np.float64)
    if poses.shape != (len(scans), 3):
        raise InputError(f"{len(scans)} scans need poses of shape ({len(scans)}, 3), not {poses.shape}")
    if exclude is not None and len(exclude) != len(scans):
        raise InputError(f"{len(scans)} scans need as many masks of returns to exclude, not {len(exclude)}")
    builder = OccupancyGridBuilder(resolution)
    for begin in range(0, len(scans), _SCANS_AT_ONCE):
        part = slice(begin, begin + _SCANS_AT_ONCE)
        masks = None if exclude is None else exclude[part]
        builder.add(rays_from_scans(scans[part], poses[part], max_range=max_range, free_range=free_range,
                                    exclude=masks))
        if progress is not None:
            progress(min(begin + _SCANS_AT_ONCE, len(scans)), len(scans))
    return builder.grid(padding)
