"""Wrapping, and the series against extended precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clew.geometry import angles, wrap

NEAR_PI = [
    np.pi,
    -np.pi,
    np.nextafter(np.pi, 4),
    np.nextafter(-np.pi, 0),
    np.nextafter(-np.pi, -4),
    3 * np.pi,
    0.0,
]


@given(st.one_of(st.floats(-1e6, 1e6), st.sampled_from(NEAR_PI)))
def test_wrap_keeps_the_angle_and_ends_in_the_half_open_interval(angle: float) -> None:
    wrapped = float(wrap(np.array(angle)))
    assert -np.pi < wrapped <= np.pi
    assert abs(np.exp(1j * wrapped) - np.exp(1j * angle)) < 1e-9
    assert float(wrap(np.array(wrapped))) == wrapped


def test_minus_pi_becomes_pi() -> None:
    np.testing.assert_array_equal(wrap(np.array([-np.pi, np.pi])), [np.pi, np.pi])


def _precise(name: str, t: Any) -> Any:
    half = t / 2
    return {
        "sinc": lambda: np.sin(t) / t,
        "versine_ratio": lambda: 2 * np.sin(half) ** 2 / t**2,
        "sine_defect_ratio": lambda: (t - np.sin(t)) / t**3,
        "half_cotangent": lambda: half * np.cos(half) / np.sin(half),
        "half_cotangent_defect_ratio": lambda: (1 - half * np.cos(half) / np.sin(half)) / t**2,
    }[name]()


@pytest.mark.parametrize(
    ("function", "limit"),
    [
        (angles.sinc, 1.0),
        (angles.versine_ratio, 0.5),
        (angles.sine_defect_ratio, 1 / 6),
        (angles.half_cotangent, 1.0),
        (angles.half_cotangent_defect_ratio, 1 / 12),
    ],
)
def test_ratios_are_exact_on_both_sides_of_the_branch(function: Callable[[Any], Any], limit: float) -> None:
    # around the change of branch extended precision has digits to spare; below, the limit is the answer
    t = np.concatenate((np.linspace(0.05, 0.2, 301), np.linspace(0.2, 6.0, 100)))
    expected = _precise(function.__name__, t.astype(np.longdouble)).astype(np.float64)
    np.testing.assert_allclose(function(t * t), expected, rtol=2e-13)
    tiny = np.array([0.0, 1e-300, 1e-24, 1e-14])
    np.testing.assert_allclose(function(tiny), limit, rtol=1e-14)
