"""Velocities along a trajectory."""

from __future__ import annotations

import numpy as np
import pytest

from clew.geometry import se2
from clew.motion import are_regular, body_velocities


def test_constant_motion_is_found_exactly_and_is_steady() -> None:
    times = np.cumsum(np.random.default_rng(0).uniform(0.05, 0.3, 40))
    twist = np.array([0.5, -0.1, 0.8])
    moved = body_velocities(times, se2.exp(times[:, None] * twist))
    inner = slice(3, -3)
    np.testing.assert_allclose(moved.velocity[inner], np.tile(twist, (34, 1)), atol=1e-9)
    assert moved.steady[inner].all()
    assert not moved.steady[0]
    assert not moved.steady[-1]


@pytest.mark.parametrize("delay", [-0.08, 0.0, 0.05, 0.1])
def test_a_turn_that_grows_evenly_is_known_at_any_moment_between_neighbours(delay: float) -> None:
    times = 0.2 * np.arange(30)
    poses = np.column_stack([np.zeros((30, 2)), 0.15 * times**2])
    moved = body_velocities(times, poses, delay)
    np.testing.assert_allclose(moved.velocity[1:-1, 2], 0.3 * (times[1:-1] + delay), atol=1e-9)


def test_over_a_long_gap_nothing_is_known() -> None:
    times = np.array([0.0, 0.2, 0.4, 3.0, 3.2, 3.4])
    moved = body_velocities(times, np.column_stack([times, np.zeros((6, 2))]))
    np.testing.assert_array_equal(moved.steady, [False, True, False, False, True, False])
    np.testing.assert_allclose(moved.velocity[:, 0], 1.0)  # from the side that is known
    alone = body_velocities(np.array([0.0, 5.0, 10.0]), np.zeros((3, 3)))
    assert not alone.velocity.any()


def test_scans_that_come_in_bursts_are_not_regular() -> None:
    even = 0.2 * np.arange(100)
    assert are_regular(even + 0.02 * np.random.default_rng(0).standard_normal(100))
    bursts = np.sort(np.concatenate([even + 0.001 * k for k in range(3)]))
    assert not are_regular(bursts)
    assert not are_regular(even[:2])
