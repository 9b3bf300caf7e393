"""Laws of maps built from scans: walls, free space, the unknown, and what a map does not depend on."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import se2
from clew.mapping import (
    CellState,
    OccupancyGrid,
    OccupancyGridBuilder,
    RayBatch,
    build_occupancy_grid,
    rays_from_scans,
)
from clew.scan import LaserScan

Array = NDArray[np.float64]
ROOM = np.array([8.0, 5.0])  # metres; its walls lie off the cell borders


def scan_of_room(T_world_robot: Array, beams: int = 360) -> LaserScan:
    """What a laser that sees all around measures in an empty room with corners at 0.02 and ROOM + 0.02."""
    angles = -np.pi + 2.0 * np.pi / beams * np.arange(beams)
    heading = angles + T_world_robot[2]
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    wall = np.where(direction > 0.0, ROOM + 0.02, 0.02)
    with np.errstate(divide="ignore"):
        ranges = ((wall - T_world_robot[:2]) / direction).min(axis=1, where=direction != 0.0, initial=np.inf)
    return LaserScan(0.0, ranges, -np.pi, 2.0 * np.pi / beams, 0.05, 30.0)


def run(count: int = 40, seed: int = 0) -> tuple[list[LaserScan], Array]:
    rng = np.random.default_rng(seed)
    poses = np.column_stack([rng.uniform(0.5, ROOM - 0.5, (count, 2)), rng.uniform(-np.pi, np.pi, count)])
    return [scan_of_room(pose) for pose in poses], poses


def state_at(grid: OccupancyGrid, points: Array) -> NDArray[np.uint8]:
    row, col = grid.world_to_cell(points).T
    return grid.states()[row, col]


def test_a_room_has_walls_of_one_cell_and_nothing_else() -> None:
    scans, poses = run()
    grid = build_occupancy_grid(scans, poses, padding=0.5)
    expected = np.full(grid.shape, CellState.UNKNOWN, dtype=np.uint8)
    (bottom, left), (top, right) = grid.world_to_cell(np.array([[0.02, 0.02], ROOM + 0.02]))
    expected[bottom:top + 1, left:right + 1] = CellState.OCCUPIED
    expected[bottom + 1:top, left + 1:right] = CellState.FREE
    wrong = grid.states() != expected
    corners = np.zeros_like(wrong)
    corners[[bottom, bottom, top, top], [left, right, left, right]] = True
    assert not (wrong & ~corners).any()  # the very corner may be missed by every beam


def test_grazing_rays_do_not_erase_a_wall() -> None:
    # Close along a wall every one of its cells is passed at a flat angle in scan after scan.
    x = np.linspace(0.3, 7.7, 60)
    poses = np.column_stack([x, np.full(60, 0.3), np.zeros(60)])
    grid = build_occupancy_grid([scan_of_room(pose, 720) for pose in poses], poses)
    wall = np.column_stack([np.arange(0.525, 7.5, 0.05), np.full(140, 0.021)])
    assert (state_at(grid, wall) == CellState.OCCUPIED).all()


def test_along_one_ray_cells_are_free_then_occupied_then_unknown() -> None:
    scan = LaserScan(0.0, np.array([2.0]), 0.3, 0.1, 0.05, 30.0)
    pose = np.array([1.0, -2.0, 0.5])
    grid = build_occupancy_grid([scan], pose[None])
    direction = np.array([np.cos(0.8), np.sin(0.8)])
    on_ray = pose[:2] + np.array([0.0, 0.5, 1.9, 2.0, 2.08, 2.5])[:, None] * direction
    free, occupied, unknown = CellState.FREE, CellState.OCCUPIED, CellState.UNKNOWN
    assert state_at(grid, on_ray).tolist() == [free, free, free, occupied, unknown, unknown]
    beside = pose[:2] + 1.0 * direction + 0.2 * np.array([-direction[1], direction[0]])
    assert state_at(grid, beside[None]) == [unknown]


def test_what_a_ray_enters_in_the_last_half_cell_is_not_called_free() -> None:
    # The ray crosses y = 0.05 at x = 0.983 and ends at x = 1.003: it spends its last 3 mm in the cell of its
    # end, and 17 mm before in that cell's neighbour.
    start, end = np.array([0.01, 0.0]), np.array([1.003, 0.05 * 0.993 / 0.973])
    length, angle = np.hypot(*(end - start)), np.arctan2(*(end - start)[::-1])
    scan = LaserScan(0.0, np.array([length]), angle, 0.1, 0.05, 30.0)
    grid = build_occupancy_grid([scan], np.array([[*start, 0.0]]))
    free, occupied, unknown = CellState.FREE, CellState.OCCUPIED, CellState.UNKNOWN
    points = np.array([[0.975, 0.025], [0.975, 0.075], end])
    assert state_at(grid, points).tolist() == [free, unknown, occupied]


def test_a_hit_outweighs_a_miss_and_neither_is_forgotten() -> None:
    near, far = (LaserScan(0.0, np.array([r]), 0.0, 0.1, 0.05, 30.0) for r in (1.02, 2.02))

    def log_odds(scans: list[LaserScan]) -> float:
        grid = build_occupancy_grid(scans, np.tile([0.01, 0.01, 0.0], (len(scans), 1)))
        row, col = grid.world_to_cell(np.array([1.03, 0.01]))
        return float(grid.log_odds[row, col])

    hit, miss = log_odds([near]), log_odds([far])
    assert (hit, miss) == pytest.approx((np.log(7.0 / 3.0), np.log(2.0 / 3.0)))
    assert log_odds([near, far]) == pytest.approx(hit + miss)
    assert log_odds([near, *[far] * 5]) < 0.0
    assert log_odds([near] * 100) == 3.5
    assert log_odds([far] * 100) == -2.0


def test_the_map_does_not_depend_on_the_order_of_scans_nor_on_how_they_come() -> None:
    scans, poses = run()
    whole = build_occupancy_grid(scans, poses, max_range=1.5)
    shuffled = np.random.default_rng(1).permutation(len(scans))
    builder = OccupancyGridBuilder()
    for i in shuffled:  # one at a time, of small reach: the grid grows again and again
        builder.add(rays_from_scans([scans[i]], poses[i:i + 1], max_range=1.5))
    assert np.array_equal(builder.grid().log_odds, whole.log_odds)
    assert np.array_equal(builder.grid().origin, whole.origin)


def test_moving_everything_by_whole_cells_moves_the_map() -> None:
    scans, poses = run()
    here = build_occupancy_grid(scans, poses, resolution=0.0625)
    shift = np.array([-37, 411]) * 0.0625  # exact in binary
    there = build_occupancy_grid(scans, poses + np.append(shift, 0.0), resolution=0.0625)
    assert np.array_equal(here.log_odds, there.log_odds)
    np.testing.assert_array_equal(there.origin, here.origin + shift)


def test_where_the_sensor_sits_on_the_robot_makes_no_difference_to_the_world() -> None:
    scans, poses = run()
    T_robot_sensor = np.array([0.3, -0.1, 2.0])
    mounted = [LaserScan(s.timestamp, s.ranges, s.angle_min, s.angle_increment, s.range_min, s.range_max,
                         T_robot_sensor) for s in scans]
    T_world_robot = se2.compose(poses, np.broadcast_to(se2.inverse(T_robot_sensor), poses.shape))
    assert np.mean(build_occupancy_grid(mounted, T_world_robot).states()
                   != build_occupancy_grid(scans, poses).states()) < 1e-3


def test_a_stray_ray_does_not_stretch_the_map() -> None:
    scans, poses = run()
    stray = LaserScan(0.0, np.array([25.0]), 0.1, 0.1, 0.05, 30.0)
    with_stray = build_occupancy_grid([*scans, stray], np.vstack([poses, [[4.0, 2.5, 0.0]]]), padding=1.0)
    assert with_stray.shape == build_occupancy_grid(scans, poses, padding=1.0).shape


def test_progress_counts_scans_to_the_end() -> None:
    scan = LaserScan(0.0, np.array([1.0]), 0.0, 0.1, 0.05, 30.0)
    seen: list[tuple[int, int]] = []
    build_occupancy_grid([scan] * 1200, np.zeros((1200, 3)), progress=lambda *counts: seen.append(counts))
    assert [done for done, _ in seen] == sorted({done for done, _ in seen})
    assert seen[-1] == (1200, 1200)


def test_nothing_observed_gives_an_empty_map() -> None:
    assert build_occupancy_grid([], np.zeros((0, 3))).shape == (0, 0)


def test_poses_gone_astray_are_an_error_and_not_a_crash() -> None:
    for far in (1e6, 1e300):
        rays = RayBatch(np.array([[0.0, 0.0, 0.0], [far, far, 0.0]]), np.array([0, 0, 1]), np.ones((1, 2)),
                        np.array([True]))
        with pytest.raises(InputError, match="does not fit into memory"):
            OccupancyGridBuilder().add(rays)


@pytest.mark.parametrize("resolution", [0.0, -0.1, np.nan, np.inf])
def test_a_resolution_that_is_no_length_is_refused(resolution: float) -> None:
    with pytest.raises(InputError, match="resolution"):
        OccupancyGridBuilder(resolution)


def test_scans_and_poses_must_be_as_many() -> None:
    scans, poses = run(3)
    with pytest.raises(InputError, match="3 scans need poses"):
        build_occupancy_grid(scans, poses[:2])
