"""What a gyro is found to be worth."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.motion import GyroCalibration, GyroNoise

Array = NDArray[np.float64]

BIAS, SCALE, LATE, DENSITY, LASER = 0.03, -0.01, 0.015, 0.004, 0.002


def turns(seed: int, count: int, bias: float = BIAS, scale: float = SCALE) -> tuple[Array, Array]:
    """What a gyro tells ``(n, 3)``, and what was measured ``(n,)``."""
    rng = np.random.default_rng(seed)
    seconds = rng.uniform(0.3, 1.5, count)
    true = rng.choice([0.0, 0.35, -0.35], count) + 0.02 * rng.standard_normal(count)
    change = rng.normal(0.0, 0.4, count)
    noise = DENSITY * np.sqrt(seconds) * rng.standard_normal(count)
    told = (1.0 + scale) * true + bias * seconds - LATE * change + noise
    return np.column_stack([seconds, told, change]), true + LASER * rng.standard_normal(count)


def calibrated(told: Array, measured: Array, known: float = 1.0) -> GyroCalibration:
    calibration = GyroCalibration(GyroNoise())
    for row, turn in zip(told, measured, strict=True):
        calibration.add(row, float(turn), known, LASER**2)
    return calibration


def test_bias_scale_and_clock_are_found_within_their_deviations() -> None:
    scores = []
    for seed in range(12):
        quality = calibrated(*turns(seed, 200)).quality
        truth = np.array([BIAS, SCALE / (1.0 + SCALE), -LATE])  # errors are told as shares of what the gyro says
        scores.append((quality.coefficients - truth) / np.sqrt(np.diag(quality.covariance)))
    assert np.abs(scores).max() < 4.0
    assert 0.5 < np.mean(np.square(scores)) < 1.7  # chi-squared of 36 numbers over 36: 95 % within 0.6 and 1.5
    assert quality.to_dict()["stamped_late_seconds"] == pytest.approx(LATE, abs=0.003)


def test_corrected_turns_are_as_good_as_stated() -> None:
    told, measured = turns(20, 400)
    quality = calibrated(told[:200], measured[:200]).quality
    error = np.array([quality.correct(row) - turn for row, turn in zip(told[200:], measured[200:], strict=True)])
    stated = np.array([quality.variance(row) for row in told[200:]]) + LASER**2
    assert 0.6 < np.mean(error**2 / stated) < 1.3
    assert quality.rate(0.5) == pytest.approx((0.5 - BIAS) / (1.0 + SCALE), abs=0.01)


def test_single_wrong_turns_do_not_bend_the_bias() -> None:
    told, measured = turns(3, 200)
    measured[::20] += 0.3
    quality = calibrated(told, measured).quality
    assert quality.coefficients[0] == pytest.approx(BIAS, abs=0.002)


def test_one_long_stand_tells_the_bias() -> None:
    told, measured = turns(4, 3)
    told = np.concatenate([told, [[60.0, 60.0 * BIAS, 0.0]]])
    quality = calibrated(told, np.append(measured, 0.0)).quality
    assert quality.coefficients[0] == pytest.approx(BIAS, abs=0.001)
    assert np.sqrt(quality.covariance[0, 0]) < 0.001


def test_a_gyro_that_is_noise_is_worth_nothing() -> None:
    told, measured = turns(5, 200)
    told[:, 1] = np.random.default_rng(1).standard_normal(200)
    quality = calibrated(told, measured).quality
    assert np.sqrt(quality.variance(np.array([0.5, 0.3, 0.0]))) > 0.2


@pytest.mark.parametrize(("factor", "slope", "along"), [(1.0, 1.0, True), (-1.0, -1.0, False), (0.0, 0.0, False),
                                                         (57.3, 57.3, False)])
def test_whether_it_turns_as_the_robot_does(factor: float, slope: float, along: bool) -> None:
    told, measured = turns(6, 200, bias=0.0, scale=0.0)
    told[:, 1] *= factor
    calibration = calibrated(told, measured)
    assert calibration.slope == pytest.approx(slope, rel=0.02, abs=0.1)
    assert calibration.turns_along is along


def test_turns_that_are_not_known_change_nothing() -> None:
    calibration = calibrated(*turns(7, 100), known=0.0)
    assert calibration.slope is None
    np.testing.assert_allclose(calibration.quality.coefficients, 0.0, atol=1e-12)
    np.testing.assert_allclose(calibration.quality.variances, np.square([0.005, 0.02]))
