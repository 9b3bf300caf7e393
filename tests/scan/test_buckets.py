"""Buckets and surfels against plain twins."""

from __future__ import annotations

import numpy as np
import pytest

from clew import _native
from clew.scan import concatenate, index_cloud, join, merge_surfels
from scan.clouds import EMPTY, random_cloud


@pytest.mark.parametrize("count", [0, 1, 200])
def test_buckets_hold_each_point_once_where_it_lies(count: int) -> None:
    rng = np.random.default_rng(count)
    points = rng.uniform(-3, 3, (count, 2))  # some outside of the grid: they go to its border
    starts, order = _native.scan.sort_into_buckets(points, -2.0, -1.5, 0.5, 7, 5)
    cell = np.clip(np.floor((points - [-2.0, -1.5]) / 0.5), 0, [6, 4]).astype(int)
    bucket = cell[:, 1] * 7 + cell[:, 0]
    np.testing.assert_array_equal(order, np.argsort(bucket, kind="stable"))
    np.testing.assert_array_equal(starts, np.concatenate([[0], np.cumsum(np.bincount(bucket, minlength=35))]))


@pytest.mark.parametrize("extent", [1e-9, 0.1, 3.0, 4000.0])
@pytest.mark.parametrize("count", [0, 1, 300])
def test_index_stays_as_small_as_its_cloud(count: int, extent: float) -> None:
    index = index_cloud(random_cloud(np.random.default_rng(0), count, extent))
    assert len(index.starts) == np.prod(index.shapes[0]) + 1
    assert len(index.starts) <= 20 * (count + 10)
    assert index.starts[-1] == count
    np.testing.assert_array_equal(np.sort(index.order), np.arange(count))


def test_joined_indices_are_those_of_the_parts() -> None:
    rng = np.random.default_rng(0)
    parts = [index_cloud(random_cloud(rng, count)) for count in (40, 0, 1, 70)]
    whole = join(parts)
    for i, part in enumerate(parts):
        own = slice(whole.offsets[i], whole.offsets[i + 1])
        np.testing.assert_array_equal(whole.cloud.points[own], part.cloud.points)
        np.testing.assert_array_equal(whole.order[own], part.order)
        starts = whole.starts[whole.starts_offsets[i] : whole.starts_offsets[i + 1]]
        np.testing.assert_array_equal(starts, part.starts)


@pytest.mark.parametrize("seed", range(3))
def test_surfels_group_by_square_and_facing(seed: int) -> None:
    cloud = random_cloud(np.random.default_rng(seed), 400)
    group, count = _native.scan.group_surfels(cloud.points, cloud.normals, 0.5)
    names: dict[tuple[int, ...], int] = {}
    expected = [names.setdefault((*(int(c) for c in np.floor(p / 0.5)), *(int(v > 0) for v in n)), len(names))
                for p, n in zip(cloud.points, cloud.normals, strict=True)]
    np.testing.assert_array_equal(group, expected)
    assert count == len(names)


def test_merged_surfels_are_weighted_means() -> None:
    cloud = random_cloud(np.random.default_rng(7), 300)
    merged = merge_surfels(cloud, 0.5)
    group, count = _native.scan.group_surfels(cloud.points, cloud.normals, 0.5)
    assert len(merged) == count < 300
    for g in range(count):
        w = cloud.weights[group == g]
        np.testing.assert_allclose(merged.points[g], w @ cloud.points[group == g] / w.sum())
        np.testing.assert_allclose(merged.along[g], w @ cloud.along[group == g] / w.sum())
        normal = w @ cloud.normals[group == g]
        np.testing.assert_allclose(merged.normals[g], normal / np.linalg.norm(normal))
    np.testing.assert_array_equal(merged.weights, 1.0)


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
