"""Odometry's noise and systematic errors from steps of known motion."""

from __future__ import annotations

import numpy as np
import pytest

from clew.geometry import se2
from clew.motion import OdometryCalibration, OdometryNoise, OdometryQuality

CERTAIN = np.full(3, 1e-8)


def calibrated(times: float, bias: np.ndarray, slips: float = 0.0, steps: int = 400) -> OdometryQuality:
    """What is found of odometry whose deviations are so many times (3, 1, 2 cm and so on) after a metre or radian."""
    rng = np.random.default_rng(5)
    deviation = times * np.array([[0.03, 0.02], [0.01, 0.01], [0.02, 0.04]])
    calibration = OdometryCalibration(OdometryNoise())
    for _ in range(steps):
        told = np.array([rng.uniform(0.0, 0.5), 0.0, rng.uniform(-0.4, 0.4)])
        sigma = np.sqrt(np.square(deviation) @ np.abs(told[[0, 2]]))
        error = bias @ told[[0, 2]] + sigma * rng.standard_normal(3)
        if rng.random() < slips:
            error += np.array([-0.3, 0.0, 0.2])
        calibration.add(told, se2.compose(told, error), np.ones(3), CERTAIN)
    return calibration.quality


@pytest.mark.parametrize("times", [1.0, 2.0, 5.0])
def test_noise_is_found_however_bad(times: float) -> None:
    found = np.sqrt(calibrated(times, np.zeros((3, 2))).variances) / times
    np.testing.assert_allclose(found[:, 0], [0.03, 0.01, 0.02], rtol=0.65)  # 40 m of way, and what was assumed, 8 cm
    assert found[2, 1] == pytest.approx(0.04, rel=0.3)


def test_slips_do_not_pass_for_noise() -> None:
    found = np.sqrt(calibrated(1.0, np.zeros((3, 2)), slips=0.02).variances)
    assert found[0, 0] < 0.06


def test_systematic_errors_are_found_and_taken_out() -> None:
    bias = np.array([[-0.02, 0.0], [0.05, 0.04], [0.01, -0.03]])
    quality = calibrated(1.0, bias)
    assert (np.abs(quality.bias - bias) <= 4 * quality.bias_deviation).all()
    told = np.array([0.5, 0.0, 0.1])
    np.testing.assert_allclose(quality.correct(told), se2.compose(told, bias @ told[[0, 2]]), atol=0.004)


def test_steps_that_tell_nothing_change_nothing() -> None:
    calibration = OdometryCalibration(OdometryNoise())
    before = calibration.quality
    for _ in range(50):
        calibration.add(np.array([0.4, 0.0, 0.0]), np.array([0.9, 0.3, 0.1]), np.zeros(3), CERTAIN)
    np.testing.assert_allclose(calibration.quality.variances, before.variances, rtol=1e-6)
    np.testing.assert_allclose(calibration.quality.bias, 0.0, atol=1e-9)
