"""Factors whose calibration is estimated too: laws, and agreement with the plain ones."""

from __future__ import annotations

import numpy as np
import pytest

from clew.errors import InputError
from clew.factors import Bearing, Between, CalibratedBearing, CalibratedRange, PreintegratedMotion, Range
from clew.geometry import SE2, Point2
from clew.testing import check_factor, random_elements

COUNT = 20
FIRST = np.arange(COUNT)
RNG = np.random.default_rng(11)
MOTION = SE2.from_array(random_elements(SE2, (COUNT,), RNG))
SLOPES = RNG.standard_normal((COUNT, 3, 4))
RANGES, BEARINGS = RNG.uniform(1.0, 9.0, COUNT), RNG.uniform(-np.pi, np.pi, COUNT)
F1, F2 = RNG.uniform(-0.5, 0.5, (2, COUNT))


def preintegrated(slopes: np.ndarray = SLOPES) -> PreintegratedMotion:
    return PreintegratedMotion(FIRST, FIRST + 1, (FIRST, FIRST), MOTION, slopes, np.full(4, 0.3), sigmas=0.1)


@pytest.mark.parametrize("sees", [Point2, SE2])
def test_laws_of_sightings(sees: type) -> None:
    keys = (FIRST + 100, FIRST + 200)
    check_factor(CalibratedRange(FIRST, FIRST + 50, keys, RANGES, F1, F2, sees=sees, sigmas=0.1))
    check_factor(CalibratedBearing(FIRST, FIRST + 50, keys, BEARINGS, F1, F2, sees=sees, sigmas=0.1))


def test_laws_of_the_motion() -> None:
    check_factor(preintegrated())


def test_without_deviations_they_are_the_plain_factors() -> None:
    pose, other = (random_elements(SE2, (COUNT,), RNG) for _ in range(2))
    point, none = random_elements(Point2, (COUNT,), RNG), np.zeros((COUNT, 2))
    pairs = [
        (CalibratedRange(FIRST, FIRST, (FIRST, FIRST), RANGES, F1, F2, sigmas=1.0),
         Range(FIRST, FIRST, RANGES, sigmas=1.0)),
        (CalibratedBearing(FIRST, FIRST, (FIRST, FIRST), BEARINGS, F1, F2, sigmas=1.0),
         Bearing(FIRST, FIRST, BEARINGS, sigmas=1.0)),
    ]  # fmt: skip
    for mine, plain in pairs:
        expected = plain.residual(pose, point, measurement=plain.measurement)
        np.testing.assert_allclose(mine.residual(pose, point, none, none, measurement=mine.measurement), expected)
    motion, between = preintegrated(), Between(FIRST, FIRST + 1, MOTION, sigmas=0.1)
    at = np.full((COUNT, 2), 0.3)
    np.testing.assert_allclose(
        motion.residual(pose, other, at, at, measurement=motion.measurement),
        between.residual(pose, other, measurement=between.measurement),
    )


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="needs 2"):
        CalibratedRange(0, 1, (2,), 1.0, 0.0, 0.0, sigmas=1.0)
    with pytest.raises(InputError, match="derivatives"):
        preintegrated(SLOPES[:, :, :3])
    with pytest.raises(InputError, match="sees"):
        CalibratedBearing(0, 1, (2, 3), 1.0, 0.0, 0.0, sees=int, sigmas=1.0)
