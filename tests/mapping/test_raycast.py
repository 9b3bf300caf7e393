"""The native ray caster against a slow twin that follows each ray by its border crossings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from clew import _native
from clew.geometry import se2
from clew.mapping import RayBatch

RESOLUTION = 0.1


def cells_on_segment(start: NDArray[np.float64], end: NDArray[np.float64]) -> set[tuple[int, int]]:
    """Cells (row, column) that a segment in cell units runs through: one a piece between two borders."""
    crossings = [0.0, 1.0]
    for axis in (0, 1):
        low, high = sorted((start[axis], end[axis]))
        borders = np.arange(np.ceil(low), np.floor(high) + 1.0)
        if high > low:
            crossings += list((borders - start[axis]) / (end[axis] - start[axis]))
    t = np.unique(np.clip(crossings, 0.0, 1.0))
    middles = start + 0.5 * (t[:-1] + t[1:])[:, None] * (end - start)
    points = [*middles, start, end]
    return {(int(np.floor(y)), int(np.floor(x))) for x, y in points}


def twin(rays: RayBatch, shape: tuple[int, int], first: tuple[int, int], margin: float) -> NDArray[np.int64]:
    """Hits and misses ``(rows, cols, 2)``."""
    counts = np.zeros((*shape, 2), dtype=np.int64)
    for scan, pose in enumerate(rays.T_world_sensor):
        beams = slice(rays.offsets[scan], rays.offsets[scan + 1])
        corner = np.array([first[1], first[0]])
        sensor = pose[:2] / RESOLUTION - corner
        hit_cells, passed = set(), set()
        for p, hit in zip(rays.endpoints[beams], rays.hit[beams], strict=True):
            length = np.hypot(*p)
            keep = 1.0 if not hit else 1.0 - margin / length if length > margin else None
            end = se2.act(pose, p) / RESOLUTION - corner
            if hit:
                hit_cells.add((int(np.floor(end[1])), int(np.floor(end[0]))))
            if keep is not None:
                passed |= cells_on_segment(sensor, sensor + keep * (end - sensor))
        for kind, cells in enumerate((hit_cells, passed - hit_cells)):
            for row, col in cells:
                if 0 <= row < shape[0] and 0 <= col < shape[1]:
                    counts[row, col, kind] += 1
    return counts


def cast(rays: RayBatch, shape: tuple[int, int], first: tuple[int, int], margin: float,
         stamp: int = 0) -> tuple[NDArray[np.uint16], int]:
    cells = np.zeros((*shape, 3), dtype=np.uint16)
    stamp = _native.mapping.cast_rays(cells, *first, RESOLUTION, rays.T_world_sensor, rays.offsets,
                                      rays.endpoints, rays.hit, margin, stamp)
    return cells, stamp


def one_ray(T_world_sensor: Sequence[float], endpoint: Sequence[float]) -> RayBatch:
    return RayBatch(np.array([T_world_sensor], dtype=np.float64), np.array([0, 1]),
                    np.array([endpoint], dtype=np.float64), np.array([True]))


def random_rays(rng: np.random.Generator, scans: int, beams: int) -> RayBatch:
    poses = np.column_stack([rng.uniform(-1.0, 1.0, (scans, 2)), rng.uniform(-np.pi, np.pi, scans)])
    counts = rng.integers(0, beams + 1, scans)
    total = counts.sum()
    length, angle = rng.uniform(0.0, 3.0, total), rng.uniform(-np.pi, np.pi, total)
    endpoints = length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return RayBatch(poses, np.concatenate([[0], np.cumsum(counts)]), endpoints, rng.random(total) < 0.7)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scans=st.integers(0, 5), beams=st.integers(0, 12))
def test_native_caster_equals_its_twin(seed: int, scans: int, beams: int) -> None:
    rays = random_rays(np.random.default_rng(seed), scans, beams)
    # The window is smaller than the reach: rays that leave it are cut.
    shape, first, margin = (50, 40), (-25, -20), 0.05
    cells, _ = cast(rays, shape, first, margin)
    np.testing.assert_array_equal(cells[..., :2], twin(rays, shape, first, margin))


@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_rays_along_a_border_and_from_a_corner_stay_on_one_side(direction: tuple[int, int]) -> None:
    rays = one_ray([0.0, 0.0, 0.0], direction)
    cells, _ = cast(rays, (40, 40), (-20, -20), 0.0)
    touched = np.argwhere(cells[..., :2].any(axis=-1)) - 20
    along = 0 if direction[1] else 1
    assert set(touched[:, 1 - along]) == {0}
    assert touched[:, along].tolist() == list(range(11) if sum(direction) > 0 else range(-10, 1))
    assert cells[20 + 10 * direction[1], 20 + 10 * direction[0], 0] == 1


def test_a_ray_of_no_length_is_a_hit_in_the_cell_of_the_sensor() -> None:
    rays = one_ray([0.05, 0.05, 1.0], [0.0, 0.0])
    cells, _ = cast(rays, (3, 3), (-1, -1), 0.05)
    expected = np.zeros((3, 3, 2), dtype=int)
    expected[1, 1, 0] = 1
    np.testing.assert_array_equal(cells[..., :2], expected)


def test_a_sensor_outside_of_the_window_only_leaves_its_hits() -> None:
    rays = one_ray([-1.0, 0.05, 0.0], [1.25, 0.0])
    cells, _ = cast(rays, (5, 5), (0, 0), 0.05)
    assert cells[0, 2, 0] == 1
    assert cells[..., :2].sum() == 1


def test_scan_numbers_wrap_without_a_trace() -> None:
    rays = random_rays(np.random.default_rng(3), 6, 10)
    plain, end = cast(rays, (60, 60), (-30, -30), 0.05)
    wrapped, wrapped_end = cast(rays, (60, 60), (-30, -30), 0.05, stamp=2**16 - 3)
    np.testing.assert_array_equal(plain[..., :2], wrapped[..., :2])
    assert (end, wrapped_end) == (6, 4)


def test_counts_stop_at_their_largest_value() -> None:
    rays = one_ray([0.05, 0.05, 0.0], [0.2, 0.0])
    cells = np.full((1, 3, 3), 2**16 - 1, dtype=np.uint16)
    cells[..., 2] = 0
    _native.mapping.cast_rays(cells, 0, 0, RESOLUTION, rays.T_world_sensor, rays.offsets, rays.endpoints,
                              rays.hit, 0.05, 0)
    assert (cells[..., :2] == 2**16 - 1).all()


def test_bounds_hold_sensors_and_endpoints_exactly() -> None:
    rays = random_rays(np.random.default_rng(5), 8, 10)
    poses = np.repeat(rays.T_world_sensor, np.diff(rays.offsets), axis=0)
    points = np.concatenate([rays.T_world_sensor[:, :2], se2.act(poses, rays.endpoints)])
    box = _native.mapping.ray_bounds(rays.T_world_sensor, rays.offsets, rays.endpoints, rays.hit)
    np.testing.assert_allclose(box, [*points.min(axis=0), *points.max(axis=0)], atol=1e-12)


@pytest.mark.parametrize("broken", [
    {"offsets": np.array([0, 1, 3])}, {"offsets": np.array([1, 1, 2])}, {"offsets": np.array([0, 2])},
    {"offsets": np.array([0, 3, 2])}, {"hit": np.array([True])}, {"margin": -1.0}, {"resolution": 0.0},
])
def test_the_binding_refuses_arrays_that_do_not_fit(broken: dict[str, object]) -> None:
    arguments: dict[str, object] = {
        "cells": np.zeros((2, 2, 3), np.uint16), "first_row": 0, "first_col": 0, "resolution": 0.1,
        "T_world_sensor": np.zeros((2, 3)), "offsets": np.array([0, 1, 2]), "endpoints": np.zeros((2, 2)),
        "hit": np.array([True, False]), "margin": 0.0, "stamp": 0}
    _native.mapping.cast_rays(**arguments)
    with pytest.raises(ValueError, match=r"must|differ"):
        _native.mapping.cast_rays(**(arguments | broken))
