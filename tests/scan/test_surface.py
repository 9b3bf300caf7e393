"""Surface normals against their twin, and what cleaning a scan promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clew import _native
from clew.geometry import se2
from clew.scan import (
    CleaningOptions,
    LaserScan,
    ScanPoints,
    concatenate,
    extract_points,
    fill_surfaces,
    gathered,
)
from clew.scan.points import FILLING_WEIGHT, FLAT, MOST_NEIGHBOURS, extract_returns
from scan.clouds import CORRIDOR, ROOM, T_ROBOT_SENSOR, random_cloud, scan_of
from scan.twins import between_returns, extracted


@pytest.mark.parametrize("seed", range(6))
def test_returns_agree_with_the_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scan = scan_of(ROOM, np.array([*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)]), sigma=0.02, seed=seed)
    ranges = scan.ranges.copy()
    ranges[rng.choice(361, 60, replace=False)] = np.nan  # gaps of one, two and more beams
    ranges[[3, 50, 51]] = np.inf, 0.01, 99.0  # nothing there, too near, too far
    scan = replace(scan, ranges=ranges, T_robot_sensor=np.array([0.3, -0.1, rng.uniform(-3, 3)]))
    wide = CleaningOptions(radius=1.5, gap_base=0.5, gap_per_metre=0.1, blob=0.1, spacing=0.5)
    for options in (CleaningOptions(), CleaningOptions(blob=0.0), wide):
        cloud, beams = extract_returns(scan, options)
        expected, expected_beams = extracted(scan, options, MOST_NEIGHBOURS)
        np.testing.assert_array_equal(beams, expected_beams)
        assert len(cloud) > 100
        np.testing.assert_allclose(cloud.points, expected.points, atol=1e-12)
        np.testing.assert_allclose(cloud.along, expected.along, atol=1e-5)
        np.testing.assert_allclose(cloud.weights, expected.weights)
        clear = expected.along < 0.9  # a round neighbourhood has no direction of its own
        np.testing.assert_allclose(cloud.normals[clear], expected.normals[clear], atol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1.0)


def test_only_so_many_neighbours_make_a_surface() -> None:
    scan = scan_of(ROOM, np.array([0.3, 0.2, 0.5]), sigma=0.02, seed=0)
    o = CleaningOptions(blob=0.0)
    (points, normals, along, _), _ = _native.scan.extract_returns(
        scan.ranges, scan.angles, scan.T_robot_sensor, scan.range_min, o.range_limit, 3, o.radius, o.gap_base,
        o.gap_per_metre, o.blob, 1.0,
    )  # fmt: skip
    expected, _ = extracted(scan, o, 3)
    np.testing.assert_allclose(points, expected.points, atol=1e-12)
    np.testing.assert_allclose(along, expected.along, atol=1e-5)
    clear = along < 0.9
    np.testing.assert_allclose(normals[clear], expected.normals[clear], atol=1e-5)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_normals_of_hardly_any_points(count: int) -> None:
    scan = LaserScan(0.0, np.full(count, 2.0), 0.0, 0.02, 0.1, 30.0)
    cloud = extract_points(scan)
    assert len(cloud) == (2 if count == 2 else 0)  # a lone one is isolated
    if count == 2:
        np.testing.assert_allclose(cloud.normals, [[-np.cos(0.01), -np.sin(0.01)]] * 2, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_points_between_returns_agree_with_the_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = np.array([*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)])
    cloud = extract_points(scan_of(ROOM, pose, sigma=0.003, seed=seed))
    options = CleaningOptions(filling=0.013, gap_base=0.03, gap_per_metre=0.01)  # so that walls end, too
    filled, expected = fill_surfaces(cloud, options), between_returns(cloud, options, FLAT, FILLING_WEIGHT)
    assert 30 < len(expected) < len(fill_surfaces(cloud, CleaningOptions(filling=0.013))) - len(cloud)
    for got, own, put_in in zip(vars(filled).values(), vars(cloud).values(), vars(expected).values(), strict=True):
        np.testing.assert_array_equal(got[: len(cloud)], own)
        np.testing.assert_allclose(got[len(cloud) :], put_in, atol=1e-12)


def test_nothing_is_put_between_the_two_sides_of_a_wall() -> None:
    points, normals = np.array([[1.0, 0.0], [1.0, 0.1]]), np.array([[-1.0, 0.0], [-1.0, 0.0]])
    one = ScanPoints(points, normals, np.zeros(2), np.ones(2))
    other = ScanPoints(points, normals * [[1.0], [-1.0]], np.zeros(2), np.ones(2))
    options = CleaningOptions(filling=0.04)
    assert len(fill_surfaces(one, options)) == 4
    assert len(fill_surfaces(other, options)) == 2


def test_gathered_clouds_are_those_at_their_poses() -> None:
    rng = np.random.default_rng(3)
    clouds = [random_cloud(rng, count) for count in (5, 0, 8)]
    poses = rng.uniform(-3, 3, (3, 3))
    expected = concatenate([cloud.transformed(pose) for cloud, pose in zip(clouds, poses, strict=True)])
    for got, wanted in zip(vars(gathered(clouds, poses)).values(), vars(expected).values(), strict=True):
        np.testing.assert_allclose(got, wanted, atol=1e-12)


def test_returns_lie_on_the_walls_with_the_walls_normals() -> None:
    cloud = extract_points(scan_of(CORRIDOR, np.array([0.0, 0.2, 0.4])))
    world = cloud.transformed(np.array([0.0, 0.2, 0.4]))
    np.testing.assert_allclose(np.abs(world.points[:, 1]), 1.2, atol=1e-9)
    np.testing.assert_allclose(world.normals, np.stack([np.zeros(len(world)), -np.sign(world.points[:, 1])], axis=1),
                               atol=1e-6)
    assert not world.along.any()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from([np.nan, np.inf, -np.inf, -1.0, 0.0, 0.01, 1.0, 1.02, 1.05, 2.0, 9.0, 29.0, 50.0]),
                max_size=40), st.integers(0, 3))
def test_any_ranges_make_a_sane_cloud(ranges: list[float], mounted: int) -> None:
    scan = LaserScan(0.0, np.array(ranges), -1.0, 0.01, 0.05, 30.0, mounted * T_ROBOT_SENSOR)
    cloud = extract_points(scan)
    assert len(cloud) <= sum(0.05 <= r <= 30.0 for r in ranges)
    sensor = se2.act(se2.inverse(scan.T_robot_sensor), cloud.points)
    distance = np.hypot(*sensor.T)
    assert np.all((distance >= 0.05 - 1e-9) & (distance <= 30.0 + 1e-9))
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1.0)
    assert np.all(np.sum(cloud.normals * (cloud.points - scan.T_robot_sensor[:2]), axis=1) <= 1e-9)
    assert np.all((cloud.weights > 0) & (cloud.weights <= 1))
    assert np.all((cloud.along >= 0) & (cloud.along <= 1))


def test_isolated_returns_and_far_ones_are_left_out() -> None:
    ranges = np.full(50, np.inf)
    ranges[10:20] = 2.0
    ranges[30] = 2.0  # alone
    ranges[35:38] = [5.0, 2.0, 5.0]  # each alone: the step to the next is no surface
    ranges[40:45] = 25.0
    scan = LaserScan(0.0, ranges, 0.0, 0.01, 0.05, 30.0)
    assert len(extract_points(scan)) == 10 + 5
    assert len(extract_points(scan, CleaningOptions(range_limit=20.0))) == 10
    assert len(extract_points(replace(scan, range_max=4.0))) == 10
    assert len(extract_points(replace(scan, range_min=3.0))) == 2 + 5
    assert len(extract_points(replace(scan, ranges=np.full(50, np.inf)))) == 0


def test_laser_mounted_anywhere_sees_the_same_world() -> None:
    T_world_sensor = np.array([0.3, -0.4, 0.9])
    at_sensor = extract_points(scan_of(ROOM, T_world_sensor))
    mounted = extract_points(scan_of(ROOM, T_world_sensor, mounted=T_ROBOT_SENSOR))
    back = mounted.transformed(se2.inverse(T_ROBOT_SENSOR))
    np.testing.assert_allclose(back.points, at_sensor.points, atol=1e-12)
    np.testing.assert_allclose(back.normals, at_sensor.normals, atol=1e-12)
    assert np.hypot(*(mounted.points[0] - at_sensor.points[0])) > 0.05


def test_laser_upside_down_sees_the_same_world() -> None:
    scan = scan_of(ROOM, np.zeros(3))
    flipped = replace(scan, ranges=scan.ranges[::-1].copy(), angle_min=-scan.angle_min,
                      angle_increment=-scan.angle_increment)
    a, b = extract_points(scan), extract_points(flipped)
    np.testing.assert_allclose(b.points[::-1], a.points, atol=1e-12)
    np.testing.assert_allclose(b.normals[::-1], a.normals, atol=1e-6)


def test_dense_returns_share_their_weight() -> None:
    near, far = (scan_of(ROOM * scale, np.zeros(3)) for scale in (0.3, 3.0))
    assert np.median(extract_points(near).weights) < 0.5 < np.median(extract_points(far).weights)


def test_transformed_is_a_group_action() -> None:
    rng = np.random.default_rng(0)
    cloud, (a, b) = random_cloud(rng, 30), rng.uniform(-3, 3, (2, 3))
    twice, once = cloud.transformed(b).transformed(a), cloud.transformed(se2.compose(a, b))
    np.testing.assert_allclose(twice.points, once.points, atol=1e-12)
    np.testing.assert_allclose(twice.normals, once.normals, atol=1e-12)
    np.testing.assert_allclose(once.points, se2.act(se2.compose(a, b), cloud.points), atol=1e-12)
    both = concatenate([cloud, once])
    assert len(both) == 60
    np.testing.assert_array_equal(both.along, np.concatenate([cloud.along, cloud.along]))


def test_a_filled_scan_has_no_holes_in_its_walls_and_nothing_beside_them() -> None:
    cloud = extract_points(scan_of(ROOM, np.array([0.3, -0.2, 0.4]), beams=121))
    filled = fill_surfaces(cloud, CleaningOptions(filling=0.04))
    assert len(filled) > 1.5 * len(cloud)
    for part in ("points", "normals", "along", "weights"):
        np.testing.assert_array_equal(getattr(filled, part)[: len(cloud)], getattr(cloud, part))
    world = filled.transformed(np.array([0.3, -0.2, 0.4]))
    a, b = ROOM[:, 0], ROOM[:, 1]
    way = b - a
    share = np.clip(np.einsum("nsi,si->ns", world.points[:, None] - a, way) / np.sum(way**2, axis=1), 0.0, 1.0)
    off = np.linalg.norm(a + share[..., None] * way - world.points[:, None], axis=2).min(axis=1)
    assert off.max() < 0.01  # the pillar is not quite round
    np.testing.assert_allclose(np.linalg.norm(filled.normals, axis=1), 1.0)
    wall = world.points[np.abs(world.points[:, 0] - 5.0) < 1e-6]
    assert np.diff(np.sort(wall[:, 1])).max() <= 0.04 + 1e-9


def test_filling_does_not_close_doorways_nor_join_what_lies_behind() -> None:
    front = np.array([[[3.0, -4.0], [3.0, -0.5]], [[3.0, 0.5], [3.0, 4.0]]])
    behind = np.array([[[6.0, -4.0], [6.0, 4.0]]])
    for walls in (front, np.concatenate([front, behind])):
        cloud = extract_points(scan_of(walls, np.zeros(3), beams=181, view=np.pi))
        filled = fill_surfaces(cloud, CleaningOptions(filling=0.02))
        x, y = filled.points.T
        assert not np.any((x < 5.0) & (np.abs(y) < 0.45))
        assert not np.any((x > 3.01) & (x < 5.99))


@pytest.mark.parametrize("count", [0, 1])
def test_hardly_a_point_is_left_as_it_is(count: int) -> None:
    cloud = random_cloud(np.random.default_rng(1), count)
    assert len(fill_surfaces(cloud)) == count
