"""A map of a real building, from another program's poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.geometry import se2
from clew.io import open_log, read_tum
from clew.mapping import CellState, OccupancyGrid, RayBatch, build_occupancy_grid, rays_from_scans
from clew.scan import LaserScan

LIDAR = Path(__file__).parents[3] / "shared" / "data" / "lidar"

pytestmark = pytest.mark.skipif(
    not (LIDAR / "fr079.reference.tum").exists(),
    reason="needs ../shared/data/lidar/fr079.clf.bz2 and fr079.reference.tum")


@pytest.fixture(scope="module")
def run() -> tuple[OccupancyGrid, RayBatch]:
    """The building, and the rays it was drawn from."""
    log = open_log(LIDAR / "fr079.clf.bz2")
    scans = {m.timestamp: m for m in log.measurements() if isinstance(m, LaserScan)}
    times, poses = read_tum(LIDAR / "fr079.reference.tum")
    found = [i for i, t in enumerate(times) if t in scans]
    T_world_robot = np.column_stack([poses[found, :2], 2.0 * np.arctan2(poses[found, 5], poses[found, 6])])
    chosen = [scans[times[i]] for i in found]
    assert len(chosen) > 1400
    return build_occupancy_grid(chosen, T_world_robot), rays_from_scans(chosen, T_world_robot)


def hit_points(rays: RayBatch) -> NDArray[np.float64]:
    poses = np.repeat(rays.T_world_sensor, np.diff(rays.offsets), axis=0)
    return np.asarray(se2.act(poses, rays.endpoints)[rays.hit])


def test_the_robot_drove_where_the_map_is_free(run: tuple[OccupancyGrid, RayBatch]) -> None:
    grid, rays = run
    row, col = grid.world_to_cell(rays.T_world_sensor[:, :2]).T
    assert np.mean(grid.states()[row, col] == CellState.FREE) > 0.995


def test_returns_lie_on_walls_of_few_cells(run: tuple[OccupancyGrid, RayBatch]) -> None:
    grid, rays = run
    occupied = grid.states() == CellState.OCCUPIED
    cells = grid.world_to_cell(hit_points(rays))
    row, col = cells[((cells >= 0) & (cells < grid.shape)).all(axis=1)].T
    assert np.mean(occupied[row, col]) > 0.7
    # Of the cells that returns fell into, only some are walls: misses have cleared the scatter around them.
    touched = np.zeros_like(occupied)
    touched[row, col] = True
    assert 0.1 < occupied.sum() / touched.sum() < 0.6
    assert not (occupied & ~touched).any()


def test_the_map_is_as_large_as_the_building(run: tuple[OccupancyGrid, RayBatch]) -> None:
    grid, _ = run
    height, width = np.array(grid.shape) * grid.resolution
    assert 40.0 < width < 50.0
    assert 16.0 < height < 22.0
