"""Worlds: same seed, same world; paths are free; the office has what the demo needs."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.sim import (
    World,
    campus,
    cast_rays,
    drive,
    hall,
    identical_doors,
    long_corridor,
    loop,
    office_building,
    tour,
)

Array = NDArray[np.float64]
BARE = World("bare", np.zeros((0, 2, 2)), np.zeros((1, 2)), np.zeros((0, 2), dtype=np.int64))
BUILDINGS = [office_building, long_corridor, hall, loop, partial(office_building, alike=True), identical_doors]
WORLDS = [*BUILDINGS, campus]


def clearance(points: Array, segments: Array) -> float:
    """Least distance between points and segments, metres."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    to_start = points[:, None] - start
    share = np.clip((to_start * along).sum(-1) / (along ** 2).sum(-1), 0, 1)
    return float(np.linalg.norm(to_start - share[..., None] * along, axis=-1).min())


@pytest.mark.parametrize("make", WORLDS)
def test_same_seed_same_world(make: Callable[[int], World]) -> None:
    first, second, other = make(3), make(3), make(4)
    np.testing.assert_array_equal(first.segments, second.segments)
    np.testing.assert_array_equal(first.places, second.places)
    np.testing.assert_array_equal(first.links, second.links)
    assert first.segments.shape != other.segments.shape or not np.array_equal(first.segments, other.segments)


@pytest.mark.parametrize("make", WORLDS)
@pytest.mark.parametrize("seed", range(4))
def test_links_and_drives_are_free(make: Callable[[int], World], seed: int) -> None:
    world = make(seed)
    ends = world.places[world.links]
    share = np.linspace(0, 1, 40)[:, None, None]
    assert clearance((ends[:, 0] + share * (ends[:, 1] - ends[:, 0])).reshape(-1, 2), world.segments) > 0.45
    driven = drive(tour(world, seed, 300.0), rate=2.0)
    assert clearance(driven.T_world_robot[:, :2], world.segments) > 0.3


@pytest.mark.parametrize("make", BUILDINGS)
def test_buildings_are_closed(make: Callable[[int], World]) -> None:
    """From no place does a ray escape."""
    world = make(1)
    poses = np.column_stack([world.places + 0.01, np.zeros(len(world.places))])
    assert np.isfinite(cast_rays(world.segments, poses, np.linspace(-np.pi, np.pi, 1000))).all()


def test_office_has_loops_and_a_long_corridor() -> None:
    world = office_building(1)
    poses = np.column_stack([world.places, np.zeros(len(world.places))])
    assert cast_rays(world.segments, poses, np.zeros(1)).max() > 60.0
    corridor_links = ~np.isin(world.links, world.rooms).any(axis=1)
    corridor_places = len(world.places) - len(world.rooms)
    assert corridor_links.sum() - corridor_places + 1 == 2  # independent cycles of a connected graph
    assert len(world.rooms) > 10


def test_rooms_that_are_alike_look_alike() -> None:
    """From inside each room that can be entered the same walls are near, seen towards its door."""
    world = office_building(2, alike=True)
    rooms = world.places[world.rooms]
    south = rooms[np.abs(rooms[:, 1] - rooms[0, 1]) < 0.1]
    seen = cast_rays(world.segments, np.column_stack([south, np.zeros(len(south))]), np.linspace(0.2, 2.9, 300))
    assert len(south) > 4
    near = np.minimum(seen, 2.0)
    assert np.median(np.abs(near[1:] - near[:1])) < 1e-6


def test_doors_are_identical() -> None:
    """A robot sees the same beside it wherever it stands along the corridor, one spacing further on each time."""
    world = identical_doors(1, spacing=4.0)
    poses = np.column_stack([np.arange(20.0, 45.0, 4.0), np.zeros(7), np.zeros(7)])
    seen = cast_rays(world.segments, poses, np.linspace(-2.3, -0.8, 200))
    assert np.median(np.abs(seen[1:] - seen[:1])) < 1e-9


def test_outdoors_some_rays_escape() -> None:
    world = campus(1)
    poses = np.column_stack([world.places, np.zeros(len(world.places))])
    escaped = ~np.isfinite(cast_rays(world.segments, poses, np.linspace(-np.pi, np.pi, 1000)))
    assert 0.02 < escaped.mean() < 0.8


def test_tour_closes_loops_in_both_directions() -> None:
    """Places are seen again, long after, with the heading turned round as well as with the same one."""
    driven = drive(tour(office_building(1), 1, 480.0), rate=1.0, duration=400.0)
    poses = driven.T_world_robot
    near = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=-1) < 0.5
    later = driven.timestamps[None] - driven.timestamps[:, None] > 60.0
    turn = np.abs(np.angle(np.exp(1j * (poses[:, None, 2] - poses[None, :, 2]))))
    assert (near & later & (turn < 0.3)).sum() > 20
    assert (near & later & (turn > 2.8)).sum() > 20


@pytest.mark.parametrize("make", [
    lambda: office_building(1, crossings=1),
    lambda: office_building(1, length=15.0),
    lambda: long_corridor(1, length=5.0),
    lambda: hall(1, width=5.0),
    lambda: loop(1, length=20.0),
    lambda: identical_doors(1, spacing=1.0),
    lambda: campus(1, rows=0),
    lambda: tour(hall(1), 1, 0.0),
    lambda: tour(BARE, 1, 10.0),
])
def test_impossible_requests_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(InputError):
        make()
