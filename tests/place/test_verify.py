"""Every verdict on a candidate, in a world that deserves it."""

from __future__ import annotations

import numpy as np
import pytest

from clew.geometry import se2
from clew.place import Verdict, build_submap
from clew.scan import ScanPoints
from place.places import CORRIDOR, OTHER, PERIODIC, ROOM, matched, points_of, submap_of


@pytest.mark.parametrize(("truth", "error"), [
    ((0.2, 0.1, 0.3), (0.6, -0.5, 0.2)), ((-0.8, 0.4, -2.8), (-0.9, 0.7, -0.3)), ((0.0, -0.6, 3.1), (0.0, 1.2, 0.1)),
])
def test_the_right_place_is_found_to_centimetres(truth: tuple[float, ...], error: tuple[float, ...]) -> None:
    T = np.array(truth)
    predicted = se2.compose(T, np.array(error))
    closure = matched(submap_of(ROOM), points_of(ROOM, T, 50), predicted)
    assert closure.verdict is Verdict.WAITING
    assert (closure.source, closure.target, closure.similarity) == (30, 7, 0.9)
    off = se2.between(T, closure.T_target_source)
    assert np.hypot(off[0], off[1]) < 0.02
    assert abs(off[2]) < 0.01
    assert closure.overlap > 0.9
    assert closure.rms < 0.02
    assert closure.contradiction < 0.03
    assert np.all(np.linalg.eigvalsh(closure.information) > 1e3)
    moved = se2.between(predicted, closure.T_target_source)
    assert closure.innovation == pytest.approx((np.hypot(moved[0], moved[1]), abs(moved[2])))


def test_another_place_does_not_match() -> None:
    closure = matched(submap_of(ROOM), points_of(OTHER, np.zeros(3), 1), np.zeros(3), likelihood=0.7)
    assert closure.verdict is Verdict.NO_MATCH
    np.testing.assert_array_equal(closure.T_target_source, np.zeros(3))
    assert not closure.information.any()


@pytest.mark.parametrize("world", [CORRIDOR, PERIODIC], ids=["bare", "periodic"])
def test_a_place_that_fits_at_several_poses_is_ambiguous(world: np.ndarray) -> None:
    closure = matched(submap_of(world), points_of(world, np.array([0.1, 0.1, 0.0]), 1), np.zeros(3), (5.0, 0.5, 0.2))
    assert closure.verdict is Verdict.AMBIGUOUS


def test_the_ambiguous_place_is_clear_in_a_window_that_holds_one_pose() -> None:
    T = np.array([0.1, 0.1, 0.0])
    closure = matched(submap_of(PERIODIC), points_of(PERIODIC, T, 1), np.zeros(3), (0.5, 0.5, 0.2))
    assert closure.verdict is Verdict.WAITING
    np.testing.assert_allclose(closure.T_target_source, T, atol=0.03)


@pytest.mark.parametrize("world", [CORRIDOR, PERIODIC], ids=["bare", "periodic"])
@pytest.mark.parametrize("turn", [-0.13, 0.0, 0.1, 0.37, 0.5])
def test_a_place_that_fits_all_along_a_line_holds_across_that_line_alone(world: np.ndarray, turn: float) -> None:
    """The line is the corridor's: one askew by a degree would claim to know centimetres a metre along it."""
    turned = se2.act(np.array([0.0, 0.0, turn]), world.reshape(-1, 2)).reshape(-1, 2, 2)
    T = np.array([0.1, 0.1, 0.05])
    closure = matched(submap_of(turned), points_of(turned, T, 1), np.array([0.2, 0.0, 0.05]), (2.6, 2.6, 0.2),
                      may_slide=True)
    assert closure.verdict is Verdict.WAITING
    assert closure.is_partial
    axis = np.array([np.cos(turn - T[2]), np.sin(turn - T[2]), 0.0])  # of the corridor, in the robot's frame
    across = np.array([-axis[1], axis[0], 0.0])
    assert axis @ closure.information @ axis < 1e-4 * (across @ closure.information @ across)


def test_what_the_submap_has_not_seen_makes_little_overlap() -> None:
    submap, half = submap_of(ROOM), ROOM[:4].mean(axis=1)
    seen = points_of(ROOM, np.zeros(3), 1)
    assert matched(submap, seen, np.zeros(3)).verdict is Verdict.WAITING
    assert len(half) == 4
    beyond = seen.points * 1.04  # walls a little too far: near enough for the search, not for partners
    far = type(seen)(beyond, seen.normals, seen.along, seen.weights)
    closure = matched(submap, far, np.zeros(3), likelihood=0.2, overlap=0.9)
    assert closure.verdict is Verdict.LITTLE_OVERLAP
    assert closure.overlap < 0.9


def test_returns_in_free_space_contradict() -> None:
    """The room has got a partition that the submap knows to be free."""
    furnished = np.concatenate([ROOM, np.array([[[-1.0, -1.5], [1.8, -1.5]], [[1.2, -1.0], [1.2, 0.8]]])])
    query = points_of(furnished, np.array([0.0, -0.2, 0.0]), 1)
    closure = matched(submap_of(ROOM), query, np.zeros(3), likelihood=0.3, overlap=0.2)
    assert closure.verdict is Verdict.CONTRADICTED
    assert closure.contradiction > 0.15


def test_surfaces_that_do_not_lie_on_each_other_are_rough() -> None:
    query = points_of(ROOM, np.zeros(3), 1)
    shaken = query.points + np.random.default_rng(0).normal(0, 0.09, query.points.shape)
    rough = type(query)(shaken, query.normals, query.along, query.weights)
    assert matched(submap_of(ROOM), rough, np.zeros(3)).verdict is Verdict.ROUGH


def test_share_of_returns_that_are_contradicted() -> None:
    submap = submap_of(ROOM)
    free, wall, outside = np.array([[0.5, 0.5]]), np.array([[5.0, 0.0]]), np.array([[400.0, 0.0], [6.0, 0.0]])
    assert submap.contradicted_share(free) == 1.0
    assert submap.contradicted_share(wall) == 0.0
    assert submap.contradicted_share(outside) == 0.0
    assert submap.contradicted_share(np.concatenate([free, wall, outside])) == 0.25
    assert submap.contradicted_share(np.zeros((0, 2))) == 0.0
    assert submap.contradicted_share(points_of(ROOM, np.zeros(3), 9).points) < 0.02


def test_submap_of_a_mounted_laser_is_the_same_place() -> None:
    """Free space is seen from where the laser is, not from the robot's centre."""
    from clew.place import build_submap

    T_robot_sensor = np.array([0.4, 0.2, 0.5])
    at_sensor = points_of(ROOM, np.zeros(3), 0)
    T = np.zeros((1, 3))
    plain = build_submap(0, [at_sensor], T, T)
    mounted = build_submap(0, [at_sensor.transformed(T_robot_sensor)],
                           se2.inverse(T_robot_sensor)[None], T_robot_sensor[None])
    np.testing.assert_allclose(mounted.surfels.points, plain.surfels.points, atol=1e-9)
    np.testing.assert_allclose(mounted.rays.T_world_sensor, plain.rays.T_world_sensor, atol=1e-12)
    np.testing.assert_allclose(mounted.rays.endpoints, plain.rays.endpoints, atol=1e-12)


def near(cloud: ScanPoints) -> ScanPoints:
    """What a laser sees that looks no farther than a metre and a half along."""
    kept = np.abs(cloud.points[:, 0]) < 1.5
    return ScanPoints(cloud.points[kept], cloud.normals[kept], cloud.along[kept], cloud.weights[kept])


@pytest.mark.parametrize("telling", [6, 0])
def test_a_match_that_most_overlap_drew_along_a_bare_corridor_is_partial(telling: int) -> None:
    """Half of what the query sees lies beyond the submap; farther back more of it overlaps, and no rival comes near."""
    short = [near(points_of(CORRIDOR, np.array([x, 0.0, 0.0]), seed)) for seed, x in enumerate((0.0, 0.4, 4.0))]
    submap = build_submap(7, short[:2], np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]), np.zeros((2, 3)))
    T = np.array([1.6, 0.0, 0.0])
    closure = matched(submap, short[2], T, (1.5, 0.3, 0.1), may_slide=True, telling=telling, overlap=0.2)
    assert closure.is_partial == (telling > 0)
    assert (abs(closure.T_target_source[0] - 1.6) < 0.5) == (telling > 0)  # where it is expected
    assert closure.telling < 6
