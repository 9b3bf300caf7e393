"""Scans become rays: what counts as a hit, what as free, and what is left out."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.mapping import RayBatch, rays_from_scans
from clew.scan import LaserScan

INF, NAN = np.inf, np.nan


def scan(ranges: list[float], *, range_max: float = 80.0, angle_min: float = 0.0,
         T_robot_sensor: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> LaserScan:
    return LaserScan(0.0, np.array(ranges), angle_min, np.pi / 4, 0.1, range_max, np.array(T_robot_sensor))


def lengths(rays: RayBatch) -> NDArray[np.float64]:
    return np.linalg.norm(rays.endpoints, axis=1)


def test_returns_are_hits_where_the_beam_points() -> None:
    rays = rays_from_scans([scan([1.0, 2.0], angle_min=np.pi / 4)], np.zeros((1, 3)))
    np.testing.assert_allclose(rays.endpoints, [[np.sqrt(0.5), np.sqrt(0.5)], [0.0, 2.0]], atol=1e-15)
    assert rays.hit.all()


def test_invalid_and_too_short_beams_are_left_out() -> None:
    rays = rays_from_scans([scan([NAN, 0.05, 3.0, -1.0])], np.zeros((1, 3)))
    np.testing.assert_allclose(lengths(rays), [3.0])


@pytest.mark.parametrize(("ranges", "expected"), [
    ([2.0, INF, 3.0], 2.0),  # between two returns: the shorter one
    ([3.0, NAN, INF, INF, 2.0], 2.0),  # neither an invalid nor a missing neighbour says anything
    ([INF, 4.0], 4.0),  # at the rim: the only one
    ([9.0, INF, 8.0], 5.0),  # never farther than free_range
    ([INF, INF], 5.0),  # nothing seen at all
])
def test_a_beam_without_return_is_free_as_far_as_its_neighbours(ranges: list[float], expected: float) -> None:
    rays = rays_from_scans([scan(ranges)], np.zeros((1, 3)), free_range=5.0)
    np.testing.assert_allclose(lengths(rays)[~rays.hit], expected)
    assert (~rays.hit).sum() == np.isinf(ranges).sum()
    assert rays.hit.sum() == np.isfinite(ranges).sum()


def test_a_sensor_of_short_reach_claims_no_more_than_its_reach() -> None:
    rays = rays_from_scans([scan([INF], range_max=4.0)], np.zeros((1, 3)))
    np.testing.assert_allclose(lengths(rays), 4.0)


def test_free_range_zero_leaves_beams_without_return_out() -> None:
    assert rays_from_scans([scan([INF, 1.0])], np.zeros((1, 3)), free_range=0.0).hit.tolist() == [True]


def test_returns_beyond_max_range_are_free_rays_of_that_length() -> None:
    rays = rays_from_scans([scan([3.0, 12.0])], np.zeros((1, 3)), max_range=10.0)
    np.testing.assert_allclose(lengths(rays), [3.0, 10.0])
    assert rays.hit.tolist() == [True, False]
    # By default a map reaches 30 m.
    assert rays_from_scans([scan([29.0, 31.0])], np.zeros((1, 3))).hit.tolist() == [True, False]


def test_sensor_poses_are_robot_poses_composed_with_the_mounting() -> None:
    mounted = scan([1.0], T_robot_sensor=(0.5, 0.0, np.pi / 2))
    rays = rays_from_scans([mounted], np.array([[1.0, 2.0, np.pi / 2]]))
    np.testing.assert_allclose(rays.T_world_sensor, [[1.0, 2.5, np.pi]], atol=1e-15)


def test_scans_of_different_sensors_keep_their_order_and_beams() -> None:
    scans = [scan([1.0, 2.0]), scan([3.0]), scan([NAN]), scan([4.0, 5.0, 6.0]), scan([7.0])]
    rays = rays_from_scans(scans, np.zeros((5, 3)))
    assert rays.offsets.tolist() == [0, 2, 3, 3, 6, 7]
    np.testing.assert_allclose(lengths(rays), [1, 2, 3, 4, 5, 6, 7])


def test_no_scans_give_an_empty_batch() -> None:
    assert len(rays_from_scans([], np.zeros((0, 3)))) == 0


@pytest.mark.parametrize(("poses", "options"), [
    (np.zeros((2, 3)), {}),
    (np.zeros((1, 2)), {}),
    (np.array([[0.0, NAN, 0.0]]), {}),
    (np.zeros((1, 3)), {"max_range": 0.0}),
    (np.zeros((1, 3)), {"free_range": -1.0}),
    (np.zeros((1, 3)), {"free_range": NAN}),
])
def test_bad_arguments_are_refused(poses: NDArray[np.float64], options: dict[str, float]) -> None:
    with pytest.raises(InputError):
        rays_from_scans([scan([1.0])], poses, **options)


@pytest.mark.parametrize("change", [
    {"T_world_sensor": np.zeros((1, 2))},
    {"T_world_sensor": np.full((1, 3), NAN)},
    {"offsets": np.array([0, 1])},
    {"offsets": np.array([0, 1, 2])},
    {"endpoints": np.full((2, 2), INF)},
    {"hit": np.array([True])},
])
def test_a_batch_whose_arrays_do_not_fit_is_refused(change: dict[str, NDArray[np.float64]]) -> None:
    arrays = {"T_world_sensor": np.zeros((1, 3)), "offsets": np.array([0, 2]), "endpoints": np.ones((2, 2)),
              "hit": np.array([True, False])}
    RayBatch(**arrays)
    with pytest.raises(InputError, match="ray batch"):
        RayBatch(**(arrays | change))
