"""Moving returns: native counts against a NumPy twin, simulated worlds with truth, a real building."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from clew import _native
from clew.errors import InputError
from clew.geometry import se2
from clew.io import open_log, read_tum
from clew.mapping import CellState, MovingOptions, build_occupancy_grid, moving_returns, rays_from_scans
from clew.scan import LaserScan
from clew.sim import LaserModel, SimulatedLog, simulate_kind

Array = NDArray[np.float64]
LIDAR = Path(__file__).parents[3] / "shared" / "data" / "lidar"


# --- the native counts ----------------------------------------------------------------------------------------------


def clear_twin(ranges: Array, increment: float, reach: float, free_range: float, width: float, margin: float) -> Array:
    """Clear length of every beam of one scan, from the definition."""
    count = len(ranges)
    returns = np.flatnonzero(np.isfinite(ranges))
    clear = np.empty(count)
    for b in range(count):
        before = ranges[returns[returns <= b][-1]] if (returns <= b).any() else free_range
        after = ranges[returns[returns >= b][0]] if (returns >= b).any() else free_range
        clear[b] = min(before, after, reach, free_range if np.isinf(ranges[b]) else reach)
        if np.isnan(ranges[b]):
            clear[b] = 0.0
        for k in returns:
            near = max(ranges[k] - margin, 0.0)
            if abs(k - b) <= 1 or abs(k - b) * abs(increment) * near <= width:
                clear[b] = min(clear[b], near)
    return clear


def random_looks(seed: int) -> tuple[Array, NDArray[np.int64], Array, Array, Array, NDArray[np.int32]]:
    rng = np.random.default_rng(seed)
    counts = rng.integers(1, 40, 12)
    ranges = np.repeat(rng.uniform(0.5, 6.0, 12), counts) * rng.uniform(0.7, 1.0, counts.sum())
    ranges[rng.random(len(ranges)) < 0.15] = np.inf
    ranges[rng.random(len(ranges)) < 0.05] = np.nan
    poses = np.column_stack([rng.uniform(-3, 3, (12, 2)), rng.uniform(-np.pi, np.pi, 12)])
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return (poses, offsets, rng.uniform(-2, 0, 12), rng.uniform(-0.1, 0.1, 12), ranges,
            np.sort(rng.integers(0, 5, 12)).astype(np.int32))


@pytest.mark.parametrize("seed", range(5))
def test_clear_lengths_against_the_twin(seed: int) -> None:
    poses, offsets, first, increment, ranges, moment = random_looks(seed)
    clear, *_ = _native.mapping.count_looks(poses, offsets, first, increment, ranges, moment,
                                            0.05, 5.0, 3.0, 0.15, 0.2, 8.0)
    for s in range(len(poses)):
        part = slice(offsets[s], offsets[s + 1])
        np.testing.assert_allclose(clear[part], clear_twin(ranges[part], increment[s], 5.0, 3.0, 0.15, 0.2))


@pytest.mark.parametrize("seed", range(5))
def test_counts_against_the_twin(seed: int) -> None:
    """Cells are found by fine sampling of rays; a cell that a ray merely touches at a corner may be missed by it."""
    poses, offsets, first, increment, ranges, moment = random_looks(seed)
    size, reach, sure = 0.3, 5.0, 2.0
    clear, hits, misses, changes, seen_last, both_ways = _native.mapping.count_looks(
        poses, offsets, first, increment, ranges, moment, size, reach, 3.0, 0.15, 0.2, sure)
    scan = np.repeat(np.arange(len(poses)), np.diff(offsets))
    angle = poses[scan, 2] + first[scan] + (np.arange(len(ranges)) - offsets[scan]) * increment[scan]
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    side = np.floor(angle / (2 * np.pi) % 1.0 * 16).astype(int)
    is_return = ranges <= reach
    ends = poses[scan, :2] + np.where(is_return, ranges, 0.0)[:, None] * direction
    cells = np.floor(ends / size)
    events: dict[tuple[float, float], list[tuple[bool, int, int]]] = {}
    for b in range(len(ranges)):
        if is_return[b]:
            for dx in (-1, 0, 1):
                for dy in (-1, 0, 1):
                    events.setdefault((cells[b, 0] + dx, cells[b, 1] + dy), []).append((True, moment[scan[b]], side[b]))
        if clear[b] > 0:
            along = np.linspace(0.0, clear[b], 4000)[:, None]
            for cell in np.unique(np.floor((poses[scan[b], :2] + along * direction[b]) / size), axis=0):
                is_near = np.hypot(*((cell + 0.5) * size - poses[scan[b], :2])) < sure
                events.setdefault((cell[0], cell[1]), []).append(
                    (False, moment[scan[b]], side[b] if is_near and np.isfinite(ranges[b]) else -1))
    expected = np.zeros((len(ranges), 5), dtype=np.int64)
    for b in np.flatnonzero(is_return):
        mine = events[cells[b, 0], cells[b, 1]]
        looks = list(dict.fromkeys((hit, when) for hit, when, _ in mine))  # the first of each kind in each moment
        sides = [{s for hit, _, s in mine if hit == kind} for kind in (True, False)]
        kinds = [hit for hit, _ in looks]
        expected[b] = (sum(kinds), len(kinds) - sum(kinds), sum(x != y for x, y in pairwise(kinds)),
                       kinds[-1], bool(sides[0] & sides[1]))
    np.testing.assert_array_equal(hits, expected[:, 0])
    # Near the sensor every second, fourth, ... ray does for all; hence a few cells more or less there, and at `sure`.
    for got, row in ((misses, 1), (changes, 2), (seen_last, 3)):
        assert np.mean(got != expected[:, row]) < 0.05
    assert np.mean(both_ways != expected[:, 4]) < 0.06
    assert expected[:, 1].sum() > 50
    assert expected[:, 2].sum() > 50
    assert 0 < expected[:, 4].sum() < is_return.sum()


# --- simulated worlds with truth ------------------------------------------------------------------------------------


def noisy(poses: Array, seed: int = 0) -> Array:
    """Poses as a good optimisation leaves them: 2 cm and 0.2 degrees off."""
    return poses + np.random.default_rng(seed).normal(size=poses.shape) * [0.02, 0.02, 0.0035]


def masks_of(log: SimulatedLog, poses: Array) -> NDArray[np.bool_]:
    return np.stack(moving_returns([log.scan(i) for i in range(log.scan_count)], poses))


@pytest.mark.parametrize("kind", ["office", "corridor", "hall"])
@pytest.mark.parametrize("beams", [181, 361])
def test_people_are_found_and_walls_stay(kind: str, beams: int) -> None:
    log = simulate_kind(kind, 3, duration=120.0, people=8, laser=LaserModel(beams=beams))
    found = masks_of(log, noisy(log.T_world_robot))
    still = np.isfinite(log.ranges) & ~log.moving
    assert log.moving.sum() > 1000
    assert found[log.moving].mean() > 0.9
    assert found[still].mean() < 0.005
    assert not found[~np.isfinite(log.ranges)].any()


def test_an_empty_building_stays_whole() -> None:
    log = simulate_kind("office", 5, duration=120.0, laser=LaserModel(beams=181))
    assert masks_of(log, log.T_world_robot).mean() < 1e-4
    assert masks_of(log, noisy(log.T_world_robot)).sum() / np.isfinite(log.ranges).sum() < 0.005


def look_at_a_door(closed: NDArray[np.bool_]) -> tuple[list[LaserScan], Array, NDArray[np.bool_]]:
    """A laser that looks at a door 4 m ahead between walls, and at a wall 9 m behind it while it is open.

    Args:
        closed: ``(N,)`` or ``(N, 101)`` whether the door is, second by second, for each beam.
    """
    angles = np.linspace(-0.5, 0.5, 101)
    scans, truth = [], []
    for i, now in enumerate(closed):
        across = 4.0 * np.tan(angles)
        in_door = np.abs(across) < 0.6
        ranges = np.where(in_door & ~now, 9.0, 4.0) / np.cos(angles)
        scans.append(LaserScan(float(i), ranges, -0.5, 0.01, 0.1, 30.0))
        truth.append(in_door & now & (np.abs(across) < 0.3))
    return scans, np.zeros((len(closed), 3)), np.array(truth)


def corridor_with_door(closed_share: float) -> tuple[list[LaserScan], Array, NDArray[np.bool_]]:
    """A door that closes and opens every 20 s."""
    return look_at_a_door(np.arange(100) % 20 < 20 * closed_share)


@pytest.mark.parametrize("closed_share", [0.2, 0.5, 0.8])
def test_a_door_that_opens_and_closes_moves(closed_share: float) -> None:
    scans, poses, leaf = corridor_with_door(closed_share)
    found = np.stack(moving_returns(scans, poses))
    assert found[leaf].all()
    assert not found[~leaf & (np.abs(np.tan(scans[0].angles) * 4.0) > 0.8)].any()  # the wall beside it


def test_what_is_only_missed_now_and_then_stays() -> None:
    """A grating: each beam goes through by chance, in one look out of three."""
    rng = np.random.default_rng(1)
    scans, poses, leaf = look_at_a_door(rng.random((100, 101)) > 0.33)
    assert np.stack(moving_returns(scans, poses))[leaf].mean() < 0.02


def test_what_was_brought_once_stays_and_what_was_taken_away_goes() -> None:
    brought = np.arange(100) >= 40
    scans, poses, leaf = look_at_a_door(brought)
    assert not np.stack(moving_returns(scans, poses))[leaf].any()
    scans, poses, leaf = look_at_a_door(~brought)
    assert np.stack(moving_returns(scans, poses))[leaf].all()


def test_what_lets_rays_of_other_directions_through_stays() -> None:
    """Glass reflects rays that meet it head on: it is seen from one place, and seen through from another."""
    ahead, _, leaf = look_at_a_door(np.ones(20, np.bool_))
    angles = np.linspace(0.8, 1.2, 81)
    aside = [LaserScan(100.0 + i, np.full(81, 12.0), 0.8, 0.005, 0.1, 30.0) for i in range(20)]
    poses = np.zeros((40, 3))
    poses[20:, :2] = [2.0, -3.5]
    assert abs(np.arctan2(3.5, 2.0) - angles.mean()) < 0.1
    assert not moving_returns([*ahead, *aside], poses)[0][leaf[0]].any()
    glass = np.stack([np.where(leaf[0], 9.0, 4.0)] * 20)  # now from the first place, too
    again = [LaserScan(200.0 + i, ranges, -0.5, 0.01, 0.1, 30.0) for i, ranges in enumerate(glass)]
    assert moving_returns([*ahead, *again], poses * 0.0)[0][leaf[0]].any()


def test_standing_still_gives_no_say_beyond_its_moments() -> None:
    """Ten scans in one moment count as one."""
    scans, poses, leaf = corridor_with_door(closed_share=0.2)
    quick = [LaserScan(s.timestamp / 1000, s.ranges, s.angle_min, s.angle_increment, 0.1, 30.0) for s in scans]
    assert not np.stack(moving_returns(quick, poses))[leaf].any()
    assert np.stack(moving_returns(quick, poses, options=MovingOptions(moment=0.001)))[leaf].all()


# --- maps without them ----------------------------------------------------------------------------------------------


def test_a_map_without_moving_returns() -> None:
    """A person stands before a robot that stands too, for two seconds of quick scans, then walks out of the way."""
    angles = np.linspace(-0.5, 0.5, 101)
    person = np.abs(angles) < 0.05
    times = np.concatenate([np.arange(20) / 10.0, 3.0 + np.arange(12)])
    scans = [LaserScan(float(t), np.where(person & (t < 2), 2.0, 5.0), -0.5, 0.01, 0.1, 30.0) for t in times]
    poses = np.zeros((32, 3))
    spot = np.array([[2.02, 0.0]])

    def state(masks: list[NDArray[np.bool_]] | None) -> int:
        grid = build_occupancy_grid(scans, poses, exclude=masks)
        return int(grid.states()[tuple(grid.world_to_cell(spot).T)][0])

    found = moving_returns(scans, poses)
    assert [bool(mask.any()) for mask in found] == [True] * 20 + [False] * 12
    assert state(None) == CellState.OCCUPIED
    assert state(found) == CellState.FREE
    everything = [np.ones(101, dtype=np.bool_)] * 32
    assert not (build_occupancy_grid(scans, poses, exclude=everything).states() == CellState.OCCUPIED).any()
    rays = rays_from_scans(scans[:20], poses[:20], exclude=[person] * 20)
    kept = np.hypot(*rays.endpoints[~rays.hit].T)
    np.testing.assert_allclose(kept, 1.85)


def test_masks_that_do_not_fit_are_refused() -> None:
    scans, poses, _ = corridor_with_door(0.2)
    with pytest.raises(InputError, match="as many masks"):
        build_occupancy_grid(scans, poses, exclude=[np.zeros(101, np.bool_)])
    with pytest.raises(InputError, match="one flag a beam"):
        rays_from_scans(scans[:1], poses[:1], exclude=[np.zeros(7, np.bool_)])
    with pytest.raises(InputError, match="need poses"):
        moving_returns(scans, poses[:-1])
    with pytest.raises(InputError, match="finite"):
        moving_returns(scans, np.where(np.arange(3) == 0, np.nan, poses))
    assert moving_returns([], np.zeros((0, 3))) == []


def test_bad_native_input_is_refused() -> None:
    poses, offsets, first, increment, ranges, moment = random_looks(0)
    good = (poses, offsets, first, increment, ranges, moment, 0.05, 5.0, 3.0, 0.1, 0.2, 8.0)
    for index, bad in ((1, offsets + 1), (2, first[:-1]), (5, moment - 9), (6, 0.0), (7, np.inf), (9, -1.0)):
        with pytest.raises(ValueError, match="must"):
            _native.mapping.count_looks(*good[:index], bad, *good[index + 1:])


# --- a real building ------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not (LIDAR / "fr079.reference.tum").exists(), reason="needs ../shared/data/lidar (fr079)")
def test_walls_of_a_real_building_stay() -> None:
    times, poses = read_tum(LIDAR / "fr079.reference.tum")
    of_time = {m.timestamp: m for m in open_log(LIDAR / "fr079.clf.bz2").measurements() if isinstance(m, LaserScan)}
    rows = [i for i, t in enumerate(times.tolist()) if t in of_time]
    scans = [of_time[times[i]] for i in rows]
    T_world_robot = np.column_stack([poses[rows, :2], 2.0 * np.arctan2(poses[rows, 5], poses[rows, 6])])
    found = moving_returns(scans, se2.canonical(T_world_robot))
    share = np.concatenate(found).mean()
    assert 0.0005 < share < 0.03
    plain = build_occupancy_grid(scans, T_world_robot)
    cleaned = build_occupancy_grid(scans, T_world_robot, exclude=found)
    kept = (cleaned.states() == CellState.OCCUPIED).sum() / (plain.states() == CellState.OCCUPIED).sum()
    assert kept > 0.99
