"""Buckets and surfels against plain twins."""

from __future__ import annotations

import numpy as np
import pytest

from clew import _native
from clew.scan import concatenate, index_cloud, join, merge_surfels
from scan.clouds import EMPTY, random_cloud
from scan.twins import merged


@pytest.mark.parametrize("count", [0, 1, 200])
def test_buckets_hold_each_point_once_where_it_lies(count: int) -> None:
    rng = np.random.default_rng(count)
    points = rng.uniform(-3, 3, (count, 2))  # some outside of the grid: they go to its border
    normals, along = rng.normal(size=(count, 2)), rng.uniform(size=count)
    starts, entries = _native.scan.sort_into_buckets(points, normals, along, -2.0, -1.5, 0.5, 7, 5)
    cell = np.clip(np.floor((points - [-2.0, -1.5]) / 0.5), 0, [6, 4]).astype(int)
    bucket = cell[:, 1] * 7 + cell[:, 0]
    rows = np.column_stack([points, normals, along])
    np.testing.assert_array_equal(entries, rows[np.argsort(bucket, kind="stable")])
    np.testing.assert_array_equal(starts, np.concatenate([[0], np.cumsum(np.bincount(bucket, minlength=35))]))


@pytest.mark.parametrize("extent", [1e-9, 0.1, 3.0, 4000.0])
@pytest.mark.parametrize("count", [0, 1, 300])
def test_index_stays_as_small_as_its_cloud(count: int, extent: float) -> None:
    index = index_cloud(random_cloud(np.random.default_rng(0), count, extent))
    assert len(index.starts) == np.prod(index.shapes[0]) + 1
    assert len(index.starts) <= 20 * (count + 10)
    assert index.starts[-1] == count
    np.testing.assert_array_equal(np.sort(index.entries[:, 0]), np.sort(index.cloud.points[:, 0]))


def test_joined_indices_are_those_of_the_parts() -> None:
    rng = np.random.default_rng(0)
    parts = [index_cloud(random_cloud(rng, count)) for count in (40, 0, 1, 70)]
    whole = join(parts)
    for i, part in enumerate(parts):
        own = slice(whole.offsets[i], whole.offsets[i + 1])
        np.testing.assert_array_equal(whole.cloud.points[own], part.cloud.points)
        np.testing.assert_array_equal(whole.entries[own], part.entries)
        starts = whole.starts[whole.starts_offsets[i] : whole.starts_offsets[i + 1]]
        np.testing.assert_array_equal(starts, part.starts)


@pytest.mark.parametrize("extent", [3.0, 4000.0])
@pytest.mark.parametrize("seed", range(3))
def test_merged_surfels_agree_with_the_twin(seed: int, extent: float) -> None:
    cloud = random_cloud(np.random.default_rng(seed), 400, extent)
    surfels, expected = merge_surfels(cloud, extent / 6.0), merged(cloud, extent / 6.0)
    assert 100 < len(expected) < 400
    for got, wanted in zip(vars(surfels).values(), vars(expected).values(), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-13 * extent)


def test_merging_is_idempotent_and_takes_any_cloud() -> None:
    cloud = random_cloud(np.random.default_rng(3), 100)
    once = merge_surfels(cloud, 0.4)
    twice = merge_surfels(concatenate([once, once]), 0.4)
    np.testing.assert_allclose(twice.points, once.points)
    assert len(merge_surfels(EMPTY, 0.05)) == 0
    shuffled = merge_surfels(concatenate([cloud]), 1e-4)  # nothing shares so small a square
    np.testing.assert_allclose(shuffled.points, cloud.points)


def test_both_sides_of_a_thin_wall_stay_apart() -> None:
    one = random_cloud(np.random.default_rng(1), 1)
    other = type(one)(one.points, -one.normals, one.along, one.weights)
    assert len(merge_surfels(concatenate([one, other]), 0.5)) == 2
