"""Native ray casting against a NumPy twin and hand-worked distances."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from clew.errors import InputError
from clew.sim import cast_rays

Array = NDArray[np.float64]
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
SQUARE = np.stack([CORNERS, np.roll(CORNERS, -1, axis=0)], axis=1)


def twin(segments: Array, poses: Array, angles: Array, reach: float) -> Array:
    """Every ray against every segment: solve origin + t d = start + u e for t and u."""
    direction = poses[:, 2, None] + angles
    d = np.stack([np.cos(direction), np.sin(direction)], axis=-1)[:, :, None]
    start, e = segments[:, 0], segments[:, 1] - segments[:, 0]
    r = start - poses[:, None, None, :2]
    det = d[..., 0] * e[:, 1] - d[..., 1] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (r[..., 0] * d[..., 1] - r[..., 1] * d[..., 0]) / det
        t = (r[..., 0] * e[:, 1] - r[..., 1] * e[:, 0]) / det
    hit = (det != 0) & (u >= -1e-12) & (u <= 1 + 1e-12) & (t >= 0)
    nearest = np.where(hit, t, np.inf).min(axis=2, initial=np.inf)
    return np.where(nearest < reach, nearest, np.inf)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("extent", [0.5, 20.0, 3000.0])
def test_agrees_with_the_twin_on_random_worlds(seed: int, extent: float) -> None:
    rng = np.random.default_rng(seed)
    centre = rng.uniform(-100, 100, 2)
    start = centre + rng.uniform(-extent, extent, (60, 2))
    segments = np.stack([start, start + rng.normal(0, extent / 4, (60, 2))], axis=1)
    segments[:10, 1, 0] = segments[:10, 0, 0]  # upright
    segments[10:20, 1, 1] = segments[10:20, 0, 1]  # level
    segments[20:23, 1] = segments[20:23, 0]  # without length
    origins = centre + rng.uniform(-1.5 * extent, 1.5 * extent, (20, 2))
    poses = np.column_stack([origins, rng.uniform(-4, 4, 20)])
    angles = np.concatenate([np.linspace(-3, 3, 90), [0.0, np.pi / 2]])
    for reach in (np.inf, extent):
        expected = twin(segments, poses, angles, reach)
        np.testing.assert_allclose(cast_rays(segments, poses, angles, reach), expected, rtol=1e-9, atol=1e-9)
        assert np.isfinite(expected).any()


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(*[st.integers(-4, 4)] * 4), min_size=1, max_size=12),
       st.tuples(st.integers(-5, 5), st.integers(-5, 5)))
def test_agrees_with_the_twin_on_lattices(lines: list[tuple[int, ...]], origin: tuple[int, int]) -> None:
    """Corners, walls along cell borders, sensors on walls and at their ends, rays along walls."""
    segments = np.array(lines, dtype=np.float64).reshape(-1, 2, 2)
    pose = np.array([[*origin, 0.0]], dtype=np.float64)
    angles = np.concatenate([np.linspace(-3.1, 3.1, 41), np.array([0.0, 0.5, 1.0, -0.5]) * np.pi])
    expected = twin(segments, pose, angles, np.inf)
    np.testing.assert_allclose(cast_rays(segments, pose, angles), expected, atol=1e-9)


def test_distances_in_a_square() -> None:
    angles = np.array([0.0, np.pi / 2, np.pi, np.arctan2(1, 0.25)])
    ranges = cast_rays(SQUARE, np.array([[0.5, 0.0, 0.0]]), angles)
    np.testing.assert_allclose(ranges, [[0.5, 1.0, 1.5, np.hypot(1, 0.25)]], atol=1e-12)


def test_no_ray_leaks_through_a_corner() -> None:
    angles = np.arctan2([1, 1, -1, -1], [1, -1, 1, -1])
    np.testing.assert_allclose(cast_rays(SQUARE, np.zeros((1, 3)), angles), np.full((1, 4), np.sqrt(2)))


def test_a_sensor_on_a_wall_measures_zero() -> None:
    assert cast_rays(SQUARE, np.array([[1.0, 0.0, 0.3]]), np.zeros(1)) == pytest.approx(0.0)


def test_a_wall_seen_edge_on_and_a_point_are_not_hit() -> None:
    wall = np.array([[[1.0, 0.0], [2.0, 0.0]], [[0.5, 0.0], [0.5, 0.0]]])
    assert np.isinf(cast_rays(wall, np.zeros((1, 3)), np.zeros(1))).all()


def test_reach_is_exclusive() -> None:
    def distance(reach: float) -> float:
        return float(cast_rays(SQUARE, np.zeros((1, 3)), np.zeros(1), reach)[0, 0])

    assert np.isinf(distance(1.0))
    assert distance(1.001) == 1.0


def test_a_sensor_outside_of_the_world_looks_in_and_away() -> None:
    ranges = cast_rays(SQUARE, np.array([[-10.0, 0.0, 0.0]]), np.array([0.0, np.pi]))
    np.testing.assert_allclose(ranges, [[9.0, np.inf]])


def test_empty_world_and_no_poses() -> None:
    assert np.isinf(cast_rays(np.zeros((0, 2, 2)), np.zeros((2, 3)), np.zeros(3))).all()
    assert cast_rays(SQUARE, np.zeros((0, 3)), np.zeros(3)).shape == (0, 3)


@pytest.mark.parametrize(("segments", "poses", "angles", "reach"), [
    (np.zeros((2, 4)), np.zeros((1, 3)), np.zeros(1), 1.0),
    (SQUARE, np.zeros((1, 2)), np.zeros(1), 1.0),
    (SQUARE, np.zeros((1, 3)), np.zeros((1, 1)), 1.0),
    (SQUARE * np.nan, np.zeros((1, 3)), np.zeros(1), 1.0),
    (SQUARE, np.full((1, 3), np.inf), np.zeros(1), 1.0),
    (SQUARE, np.zeros((1, 3)), np.zeros(1), -1.0),
    (SQUARE, np.zeros((1, 3)), np.zeros(1), np.nan),
])
def test_bad_input_is_refused(segments: Array, poses: Array, angles: Array, reach: float) -> None:
    with pytest.raises(InputError, match="cast_rays"):
        cast_rays(segments, poses, angles, reach)
