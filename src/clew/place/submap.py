"""A piece of the map about one keyframe, prepared for being found again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from clew.geometry import se2
from clew.mapping import OccupancyGrid, OccupancyGridBuilder, RayBatch
from clew.scan import (
    IndexedClouds,
    LikelihoodPyramid,
    ScanPoints,
    build_pyramid,
    fill_surfaces,
    gathered,
    index_cloud,
    merge_surfels,
)

Array = NDArray[np.float64]

VOXEL = 0.05  # metres; side of a surfel
SEARCH_RESOLUTION = 0.1  # metres; cell of the correlative search for closures
SEARCH_SIGMA = 0.1  # metres
SEARCH_LEVELS = 6
SEARCH_REACH = 20.0  # metres from the anchor; farther surfels serve alignment alone
FREE_LOG_ODDS = -0.7  # two rays more passed through the cell than ended in it
WALL_MARGIN = 2  # cells about an occupied one that are not called free


@dataclass(frozen=True)
class Submap:
    """Surfels of neighbouring keyframes in the frame of one of them.

    Attributes:
        keyframe: index of the keyframe whose frame it is (its anchor).
        surfels: the points, in the anchor's frame; walls that are sampled sparsely are filled.
        rays: the same returns before merging, with the positions of the sensor.
    """

    keyframe: int
    surfels: ScanPoints
    rays: RayBatch

    @cached_property
    def index(self) -> IndexedClouds:
        """The surfels, indexed for alignment."""
        return index_cloud(self.surfels)

    @cached_property
    def pyramid(self) -> LikelihoodPyramid:
        """The surfels, prepared for the correlative search."""
        near = np.hypot(self.surfels.points[:, 0], self.surfels.points[:, 1]) < SEARCH_REACH
        return build_pyramid(
            self.surfels.points[near], resolution=SEARCH_RESOLUTION, sigma=SEARCH_SIGMA, levels=SEARCH_LEVELS
        )

    @cached_property
    def _free(self) -> tuple[OccupancyGrid, NDArray[np.bool_]]:
        builder = OccupancyGridBuilder(SEARCH_RESOLUTION)
        builder.add(self.rays)
        grid = builder.grid(padding=0.0)
        near_wall = binary_dilation(grid.log_odds > 0, iterations=WALL_MARGIN)
        return grid, (grid.log_odds < FREE_LOG_ODDS) & ~near_wall

    def observes(self, points: Array) -> NDArray[np.bool_]:
        """Which points ``(n, 2)``, in the anchor's frame, lie where rays of the submap passed or ended."""
        grid, _ = self._free
        cells = grid.world_to_cell(points)
        inside = np.all((cells >= 0) & (cells < np.array(grid.shape)), axis=1)
        out = np.zeros(len(points), dtype=np.bool_)
        rows, columns = cells[inside].T
        out[inside] = grid.log_odds[rows, columns] != 0
        return out

    def likelihoods(self, points: Array) -> Array:
        """How likely a return is ``(n,)``, in [0, 1], at each of points ``(n, 2)`` in the anchor's frame."""
        cells = self.pyramid.cells[0]
        at = np.floor((points - self.pyramid.origin) / self.pyramid.resolution).astype(np.int64)[:, ::-1]
        inside = np.all((at >= 0) & (at < np.array(cells.shape)), axis=1)
        out = np.zeros(len(points))
        out[inside] = cells[tuple(at[inside].T)] / 255.0
        return out

    def contradicted_share(self, points: Array) -> float:
        """Share of returns ``(n, 2)``, in the anchor's frame, that lie where rays of the submap passed freely."""
        grid, free = self._free
        if not len(points):
            return 0.0
        cells = grid.world_to_cell(points)
        inside = np.all((cells >= 0) & (cells < np.array(grid.shape)), axis=1)
        rows, columns = cells[inside].T
        return float(np.count_nonzero(free[rows, columns]) / len(points))


def surfels_of(clouds: Sequence[ScanPoints], T_anchor_keyframe: Array, voxel: float = VOXEL) -> ScanPoints:
    """Surfels of clouds at their poses ``(M, 3)`` in a common frame."""
    return merge_surfels(gathered(clouds, T_anchor_keyframe), voxel)


def build_submap(
    keyframe: int,
    clouds: Sequence[ScanPoints],
    T_anchor_keyframe: Array,
    T_robot_sensor: Array,
) -> Submap:
    """Submap about `keyframe`.

    Args:
        keyframe: index of the anchor.
        clouds: points of the ``M`` keyframes, each in its robot's frame.
        T_anchor_keyframe: ``(M, 3)`` their poses in the anchor's frame.
        T_robot_sensor: ``(M, 3)`` where the laser sat on the robot.
    """
    endpoints = [
        se2.act(se2.inverse(T), cloud.points) for cloud, T in zip(clouds, T_robot_sensor, strict=True)
    ]
    offsets = np.concatenate([[0], np.cumsum([len(e) for e in endpoints])]).astype(np.int64)
    rays = RayBatch(
        se2.compose(T_anchor_keyframe, T_robot_sensor),
        offsets,
        np.concatenate(endpoints),
        np.ones(offsets[-1], dtype=np.bool_),
    )
    filled = [fill_surfaces(cloud) for cloud in clouds]
    return Submap(keyframe, surfels_of(filled, T_anchor_keyframe), rays)
