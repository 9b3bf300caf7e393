"""Angles and the series that keep rotations exact near the identity.

All functions here and in the group modules take plain arrays or dual arrays (`clew.geometry.dual`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry.dual import primal

Array = NDArray[np.float64]

TWO_PI = 2.0 * np.pi
#: Below this squared angle the series are exact to the last digit, and closed forms would cancel.
SMALL = 1e-2


def wrap(angle: Array) -> Array:
    """Bring angles into ``(-pi, pi]``, any shape, radians; the derivative is one everywhere."""
    value = primal(angle)
    turns = np.ceil((value - np.pi) / TWO_PI)
    # Just above -pi the division rounds to a whole turn; without this line the result exceeds pi by one ulp.
    turns = turns + (value - TWO_PI * turns > np.pi)
    wrapped: Array = angle - TWO_PI * turns
    return wrapped


def away_from_zero(squared: Array) -> tuple[NDArray[np.bool_], Array]:
    """Where a squared angle is small, and the squared angle with those entries replaced by one.

    A closed form evaluated on the second array stays finite, so that neither branch of a `numpy.where`
    warns or spoils a derivative.
    """
    small = primal(squared) < SMALL
    return small, np.where(small, 1.0, squared)


def sinc(squared: Array) -> Array:
    """``sin(t) / t`` as a function of ``t^2``."""
    small, safe = away_from_zero(squared)
    angle = np.sqrt(safe)
    s = squared
    series = 1.0 - s / 6.0 * (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0))))
    return np.where(small, series, np.sin(angle) / angle)


def versine_ratio(squared: Array) -> Array:
    """``(1 - cos(t)) / t^2`` as a function of ``t^2``."""
    half_sinc = sinc(0.25 * squared)
    return 0.5 * half_sinc * half_sinc


def sine_defect_ratio(squared: Array) -> Array:
    """``(t - sin(t)) / t^3`` as a function of ``t^2``."""
    small, safe = away_from_zero(squared)
    angle = np.sqrt(safe)
    s = squared
    series = (1.0 - s / 20.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0)))) / 6.0
    return np.where(small, series, (angle - np.sin(angle)) / (safe * angle))


def half_cotangent(squared: Array) -> Array:
    """``(t / 2) cot(t / 2)`` as a function of ``t^2``, for ``|t| < 2 pi``."""
    return 1.0 - squared * half_cotangent_defect_ratio(squared)


def half_cotangent_defect_ratio(squared: Array) -> Array:
    """``(1 - (t / 2) cot(t / 2)) / t^2`` as a function of ``t^2``, for ``|t| < 2 pi``."""
    small, safe = away_from_zero(squared)
    half = 0.5 * np.sqrt(safe)
    s = squared
    series = 1 / 12 + s * (1 / 720 + s * (1 / 30240 + s * (1 / 1209600 + s / 47900160)))
    return np.where(small, series, (1.0 - half * np.cos(half) / np.sin(half)) / safe)
