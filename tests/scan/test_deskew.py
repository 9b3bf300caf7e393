"""Motion within a scan, and the noise of its ranges."""

from __future__ import annotations

import numpy as np
import pytest

from clew.geometry import se2
from clew.scan import LaserScan, collinearity_residuals, deskew, extract_points, resample, robust_deviation
from scan.twins import deskewed

BEAMS, INCREMENT, SECONDS = 360, np.radians(1.0), 0.1 / 360
WALLS = ((1.0, 0.0, 4.0), (-1.0, 0.0, 3.0), (0.0, 1.0, 2.0), (0.0, -1.0, 5.0))  # outward normal and distance
OFFSET = np.array([0.2, 0.1, 0.3])


def swept(velocity: np.ndarray, offset: np.ndarray = OFFSET) -> LaserScan:
    """A scan of a rectangular room from a robot that starts at its origin and moves meanwhile."""
    time = SECONDS * np.arange(BEAMS)
    sensor = se2.compose(se2.exp(time[:, None] * velocity), offset)
    direction = sensor[:, 2] - np.pi + INCREMENT * np.arange(BEAMS)
    ranges = np.full(BEAMS, np.inf)
    for nx, ny, distance in WALLS:
        towards = nx * np.cos(direction) + ny * np.sin(direction)
        with np.errstate(divide="ignore"):
            hit = (distance - nx * sensor[:, 0] - ny * sensor[:, 1]) / towards
        ranges = np.where(towards > 1e-9, np.minimum(ranges, hit), ranges)
    return LaserScan(7.0, ranges, -np.pi, INCREMENT, 0.1, 30.0, offset, time_increment=SECONDS)


def to_walls(scan: LaserScan) -> np.ndarray:
    """Distance of each return from the nearest wall."""
    ends = scan.ranges[:, None] * np.stack([np.cos(scan.angles), np.sin(scan.angles)], axis=1)
    points = se2.act(scan.T_robot_sensor, ends)
    return np.min([np.abs(points @ np.array([nx, ny]) - d) for nx, ny, d in WALLS], axis=0)


@pytest.mark.parametrize("velocity", [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.8, -0.3, -1.5]])
def test_returns_lie_on_their_walls_once_the_motion_is_out(velocity: list[float]) -> None:
    scan = swept(np.array(velocity))
    still = deskew(scan, np.array(velocity))
    assert to_walls(scan).max() > 0.03
    assert to_walls(still).max() < 1e-9
    assert still.timestamp == scan.timestamp
    assert len(extract_points(still)) > 300


@pytest.mark.parametrize("seed", range(4))
def test_deskewing_agrees_with_the_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    moments = rng.uniform(-0.05, 0.05, BEAMS)  # of beams that do not follow each other
    scan = LaserScan(7.0, rng.uniform(0.5, 20.0, BEAMS), -3.0, INCREMENT, 0.1, 30.0, rng.uniform(-1, 1, 3),
                     moments=moments)
    velocity = rng.uniform(-2, 2, 3)
    still = deskew(scan, velocity)
    ranges, bearings = deskewed(scan, velocity)
    np.testing.assert_allclose(still.ranges, ranges)
    np.testing.assert_allclose(still.angles, bearings)


def test_without_sweep_or_motion_nothing_changes() -> None:
    scan = swept(np.zeros(3))
    assert deskew(scan, np.zeros(3)) is scan
    at_once = LaserScan(7.0, scan.ranges, -np.pi, INCREMENT, 0.1, 30.0)
    assert deskew(at_once, np.array([1.0, 0.0, 1.0])) is at_once


def test_beams_without_return_stay_so() -> None:
    scan = swept(np.array([0.5, 0.0, 1.0]))
    scan.ranges[10], scan.ranges[20] = np.inf, np.nan
    still = deskew(scan, np.array([0.5, 0.0, 1.0]))
    assert np.isposinf(still.ranges[10])
    assert np.isnan(still.ranges[20])
    for beam in (10, 20):  # they are turned with the robot, and no more is known of them
        assert still.angles[beam] == pytest.approx(scan.angles[beam] + 1.0 * scan.delays[beam], abs=1e-12)


def test_resampled_returns_stay_within_half_a_beam() -> None:
    velocity = np.array([0.8, -0.3, -1.5])
    still = deskew(swept(velocity), velocity)
    even, beams = resample(still)
    assert even.bearings is None
    difference = even.angles[beams] - still.angles
    inside = (beams > 0) & (beams < BEAMS - 1)
    assert np.abs(np.angle(np.exp(1j * difference)))[inside].max() <= INCREMENT / 2 + 1e-9
    kept = even.ranges[beams]
    assert (kept <= still.ranges).all()  # of several returns in one direction the nearest


def test_a_scan_of_one_beam_has_nothing_to_resample() -> None:
    scan = LaserScan(0.0, np.array([2.0]), 0.3, 0.0, 0.1, 30.0, time_increment=1e-4)
    still = deskew(scan, np.array([1.0, 0.0, 0.5]))
    even, beams = resample(still)
    assert even is still
    assert beams.tolist() == [0]


@pytest.mark.parametrize("sigma", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("step", [0.0, 0.01])
def test_noise_of_ranges_is_found(sigma: float, step: float) -> None:
    rng = np.random.default_rng(3)
    residuals = []
    for _ in range(30):
        scan = swept(np.zeros(3))
        scan.ranges[:] += sigma * rng.standard_normal(BEAMS)
        if step:
            scan.ranges[:] = step * np.round(scan.ranges / step)
        residuals.append(collinearity_residuals(scan))
    truth = np.hypot(sigma, step / np.sqrt(12.0))
    assert robust_deviation(np.concatenate(residuals)) == pytest.approx(truth, rel=0.12)


def test_no_residuals_of_scans_without_returns() -> None:
    empty = LaserScan(0.0, np.full(20, np.inf), 0.0, 0.01, 0.1, 30.0)
    assert len(collinearity_residuals(empty)) == 0
    assert np.isnan(robust_deviation(np.zeros(0)))
