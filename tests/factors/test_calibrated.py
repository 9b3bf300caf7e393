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
BASIS = RNG.uniform(-0.5, 0.5, (COUNT, 3))


def preintegrated(slopes: np.ndarray = SLOPES, unit: int | None = None) -> PreintegratedMotion:
    return PreintegratedMotion(FIRST, FIRST + 1, (FIRST, FIRST), MOTION, slopes, np.full(4, 0.3), unit=unit, sigmas=0.1)


@pytest.mark.parametrize("sees", [Point2, SE2])
def test_laws_of_sightings(sees: type) -> None:
    keys = [FIRST + 100 * k for k in (1, 2, 3, 4, 5)]
    check_factor(CalibratedRange(FIRST, FIRST + 50, keys, RANGES, BASIS, sees=sees, sigmas=0.1))
    check_factor(CalibratedBearing(FIRST, FIRST + 50, keys, BEARINGS, BASIS, sees=sees, sigmas=0.1))


def test_an_offset_changes_nothing_at_the_range_that_it_counts_from() -> None:
    q = np.array([[1.0, 0.0], [0.0, 2.0], [-5.0, 0.0]])
    factor = CalibratedRange(FIRST[:3], FIRST[:3], [FIRST[:3]] * 5, [1.0, 2.0, 5.0], [0.0, 0.0, 0.5], sigmas=1.0)
    error = factor.residual(np.zeros((3, 3)), q, np.full((3, 2), [0.0, 0.1]), *np.zeros((4, 3, 2)),
                            measurement=factor.measurement)  # fmt: skip
    np.testing.assert_allclose(error[:, 0], [0.05, 0.0, -0.15])


def test_the_distortion_is_that_of_the_true_direction() -> None:
    q = np.array([[1.0, np.tan(0.3)], [1.0, np.tan(-0.5)]])
    factor = CalibratedBearing(FIRST[:2], FIRST[:2], [FIRST[:2]] * 5, [0.3, -0.5], [0.1, 0.2, 0.0], sigmas=1.0)
    error = factor.residual(np.zeros((2, 3)), q, np.full((2, 2), [0.02, 0.1]), np.full((2, 2), [0.2, 1.0]),
                            *np.zeros((3, 2, 2)), measurement=factor.measurement)  # fmt: skip
    expected = [0.02 + 0.1 * 0.2 + 0.2 * -0.11 + 0.027, 0.02 - 0.1 * 0.6 + 0.2 * 0.05 - 0.125]
    np.testing.assert_allclose(error[:, 0], expected)


def test_the_distortion_does_not_fold_over() -> None:
    """Something behind the robot is not seen ahead, whatever the polynomial is there."""
    factor = CalibratedBearing(0, 1, (2, 3, 4, 5, 6), 0.1, np.zeros(3), sigmas=1.0)
    none, cubic = np.zeros((1, 2)), np.array([[0.0, -0.13]])
    errors = [
        factor.residual(np.zeros((1, 3)), np.array([[np.cos(b), np.sin(b)]]), none, cubic, none, none, none,
                        measurement=factor.measurement)[0, 0]
        for b in (0.1, 2.5, 2.6, 2.7, 3.0)
    ]  # fmt: skip
    assert abs(errors[0]) < 1e-3
    assert min(errors[1:]) > 2.0


def test_the_bias_of_a_view_and_what_sets_a_mark_apart_are_added() -> None:
    pose, point = np.zeros((1, 3)), np.array([[2.0, 0.0]])
    bias, mark, none = np.array([[0.03, -0.02]]), np.array([[0.01, 0.004]]), np.zeros((1, 2))
    for kind, measured, expected in ((CalibratedRange, 2.0, 0.03 + 2.0 * 0.01), (CalibratedBearing, 0.0, -0.016)):
        factor = kind(0, 1, (2, 3, 4, 5, 6), measured, np.zeros(3), sigmas=1.0)
        error = factor.residual(pose, point, none, none, bias, mark, none, measurement=factor.measurement)
        np.testing.assert_allclose(error, [[expected]], atol=1e-12)


def test_laws_of_the_motion() -> None:
    check_factor(preintegrated())
    check_factor(preintegrated(unit=2))


def test_a_map_in_another_unit_costs_the_same() -> None:
    """Straight drives, a second parameter that changes their speed: poses and unit scaled together, the error stays."""
    step = np.column_stack([RNG.uniform(0.5, 1.0, COUNT), np.zeros((COUNT, 2))])
    slopes = np.zeros((COUNT, 3, 2))
    slopes[:, 0, 1] = step[:, 0]
    factor = PreintegratedMotion(FIRST, FIRST, (FIRST,), step, slopes, np.zeros(2), unit=0, sigmas=0.1)
    errors = []
    for scale in (1.0, 1.3):
        there = np.column_stack([scale * (1.2 * step[:, 0] + 0.1), np.full(COUNT, 0.05 * scale), np.full(COUNT, 0.2)])
        errors.append(factor.residual(np.zeros((COUNT, 3)), there, np.full((COUNT, 2), [scale - 1.0, 0.2]),
                                      measurement=factor.measurement))  # fmt: skip
    np.testing.assert_allclose(*errors, atol=1e-12)
    np.testing.assert_allclose(errors[0], np.full((COUNT, 3), [0.1, 0.05, 0.2]), atol=1e-12)
    metres = factor.motion_at(np.full((COUNT, 2), [0.3, 0.2]))
    np.testing.assert_allclose(metres[:, 0], 1.3 * 1.2 * step[:, 0])


def test_without_deviations_they_are_the_plain_factors() -> None:
    pose, other = (random_elements(SE2, (COUNT,), RNG) for _ in range(2))
    point, none = random_elements(Point2, (COUNT,), RNG), np.zeros((COUNT, 2))
    pairs = [
        (CalibratedRange(FIRST, FIRST, [FIRST] * 5, RANGES, BASIS, sigmas=1.0),
         Range(FIRST, FIRST, RANGES, sigmas=1.0)),
        (CalibratedBearing(FIRST, FIRST, [FIRST] * 5, BEARINGS, BASIS, sigmas=1.0),
         Bearing(FIRST, FIRST, BEARINGS, sigmas=1.0)),
    ]  # fmt: skip
    for mine, plain in pairs:
        expected = plain.residual(pose, point, measurement=plain.measurement)
        parameters = [none] * (len(mine.kinds) - 2)
        np.testing.assert_allclose(mine.residual(pose, point, *parameters, measurement=mine.measurement), expected)
    motion, between = preintegrated(), Between(FIRST, FIRST + 1, MOTION, sigmas=0.1)
    at = np.full((COUNT, 2), 0.3)
    np.testing.assert_allclose(
        motion.residual(pose, other, at, at, measurement=motion.measurement),
        between.residual(pose, other, measurement=between.measurement),
    )


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="needs 5"):
        CalibratedRange(0, 1, (2,), 1.0, np.zeros(3), sigmas=1.0)
    with pytest.raises(InputError, match="basis"):
        CalibratedRange(0, 1, (2, 3, 4, 5, 6), 1.0, np.zeros(2), sigmas=1.0)
    with pytest.raises(InputError, match="derivatives"):
        preintegrated(SLOPES[:, :, :3])
    with pytest.raises(InputError, match="unit is 4"):
        preintegrated(unit=4)
    with pytest.raises(InputError, match="sees"):
        CalibratedBearing(0, 1, (2, 3, 4, 5, 6), 1.0, np.zeros(3), sees=int, sigmas=1.0)
