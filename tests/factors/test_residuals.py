"""Residuals by hand: zero at the measurement, the stated sign, the stated frames."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clew.factors import Bearing, Between, PointObservation, Position, Prior, Range, RangeBearing
from clew.geometry import SE2, SE3, Point2, Point3
from clew.graph import Factor
from clew.testing import random_elements

QUARTER = np.pi / 2


def residual(factor: Factor, *values: Any) -> Any:
    arrays = [np.atleast_2d(np.asarray(getattr(value, "array", value), dtype=float)) for value in values]
    return factor.residual(*arrays, measurement=factor.measurement)[0]


def test_between_is_predicted_minus_measured_in_the_frame_of_the_measurement() -> None:
    a, b = SE2(1.0, 0.0, QUARTER), SE2(1.0, 2.0, np.pi)
    assert np.abs(residual(Between(0, 1, SE2(2.0, 0.0, QUARTER), sigmas=1.0), a, b)).max() < 1e-15
    # predicted (2, 0), measured (1, 0) turned by a quarter: the surplus of one along x is -y there
    factor = Between(0, 1, SE2(1.0, 0.0, QUARTER), sigmas=1.0)
    np.testing.assert_allclose(residual(factor, a, b), [0.0, -1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("kind", [SE2, SE3])
def test_between_follows_the_formula_of_the_conventions(kind: type[Any]) -> None:
    rng = np.random.default_rng(1)
    a, b, z = (kind.from_array(random_elements(kind, (), rng)) for _ in range(3))
    n = kind.space
    R_a, R_b, R_z = (pose.matrix()[:n, :n] for pose in (a, b, z))
    t_a, t_b, t_z = (pose.translation for pose in (a, b, z))
    error = residual(Between(0, 1, z, sigmas=1.0), a, b)
    np.testing.assert_allclose(error[:n], R_z.T @ (R_a.T @ (t_b - t_a) - t_z), atol=1e-13)
    turn = error[n:]
    exponential = kind.identity().retract(np.concatenate((np.zeros(n), turn))).matrix()[:n, :n]
    np.testing.assert_allclose(exponential, R_z.T @ R_a.T @ R_b, atol=1e-13)


def test_prior_is_in_the_frame_of_the_prior() -> None:
    factor = Prior(0, SE2(1.0, 1.0, QUARTER), sigmas=1.0)
    np.testing.assert_allclose(residual(factor, SE2(1.0, 3.0, QUARTER + 0.1)), [2.0, 0.0, 0.1], atol=1e-15)
    np.testing.assert_allclose(residual(Prior(0, Point3(1, 2, 3), sigmas=1.0), [1.5, 2, 3]), [0.5, 0, 0])


def test_landmarks_are_seen_from_the_sensor() -> None:
    robot, landmark = SE2(1.0, 1.0, QUARTER), Point2(1.0, 5.0)  # four metres straight ahead
    sensor = SE2(1.0, 0.0, -QUARTER)  # at the front, looking right: sees it three metres to its left
    common: dict[str, Any] = {"sigmas": 1.0, "T_robot_sensor": sensor}
    assert np.abs(residual(PointObservation(0, 1, [4.0, 0.0], sigmas=1.0), robot, landmark)).max() < 1e-15
    assert np.abs(residual(PointObservation(0, 1, [0.0, 3.0], **common), robot, landmark)).max() < 1e-15
    assert np.abs(residual(RangeBearing(0, 1, 3.0, QUARTER, **common), robot, landmark)).max() < 1e-15
    np.testing.assert_allclose(residual(Range(0, 1, 2.5, **common), robot, landmark), [0.5])
    np.testing.assert_allclose(residual(Bearing(0, 1, 0.5, **common), robot, landmark), [QUARTER - 0.5])


def test_directions_in_space() -> None:
    robot, landmark = SE3([0, 0, 1]), Point3(1.0, 1.0, 1.0 + np.sqrt(2.0))
    factor = RangeBearing(0, 1, 2.0, QUARTER / 2, QUARTER / 2, sigmas=1.0)
    assert np.abs(residual(factor, robot, landmark)).max() < 1e-15
    factor = Bearing(0, 1, 0.0, 0.0, sigmas=1.0)
    np.testing.assert_allclose(residual(factor, robot, landmark), [QUARTER / 2, QUARTER / 2], atol=1e-15)


def test_angles_are_wrapped() -> None:
    behind = Point2(-1.0, -1e-3)
    error = residual(Bearing(0, 1, np.pi - 1e-3, sigmas=1.0), SE2.identity(), behind)
    np.testing.assert_allclose(error, [2e-3], atol=1e-9)
    error = residual(Prior(0, SE2(0, 0, 3.1), sigmas=1.0), SE2(0, 0, -3.1))
    np.testing.assert_allclose(error, [0, 0, 2 * np.pi - 6.2], atol=1e-14)


def test_position_knows_the_lever_arm() -> None:
    robot = SE2(10.0, 20.0, QUARTER)
    assert (
        np.abs(
            residual(Position(0, [10.0, 22.0], sigmas=1.0, T_robot_sensor=SE2(2.0, 0.0, 0.3)), robot)
        ).max()
        < 1e-14
    )
    error = residual(Position(0, [10.0, 19.0, 5.0], sigmas=1.0), SE3([10.0, 20.0, 5.0]))
    np.testing.assert_allclose(error, [0, 1, 0])


def test_a_landmark_in_the_sensor_does_not_warn() -> None:
    for factor in (
        RangeBearing(0, 1, 0.0, 0.0, sigmas=1.0),
        Bearing(0, 1, 0.0, sigmas=1.0),
        Range(0, 1, 0.0, sigmas=1.0),
    ):
        error, jacobians = factor.linearise(np.zeros((1, 3)), np.zeros((1, 2)))
        assert np.all(error == 0)
        assert all(np.isfinite(jacobian).all() for jacobian in jacobians)
