"""Measurement models written by users."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clew.errors import InputError
from clew.factors import Between, CustomFactor, Prior, RangeBearing
from clew.geometry import SE2, SE3, Point2, Point3, wrap
from clew.graph import Factor, FactorGraph, Role
from clew.noise import Huber
from clew.solve import optimize
from clew.testing import check_factor, random_elements

RNG = np.random.default_rng(9)
M = 30
KEYS = np.arange(M)


def between_in_plain_numpy(a: Any, b: Any, z: Any) -> Any:
    """The relative-pose residual as a user would write it."""
    cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    ex, ey = cos * dx + sin * dy - z[:, 0], -sin * dx + cos * dy - z[:, 1]
    cos_z, sin_z = np.cos(z[:, 2]), np.sin(z[:, 2])
    turn = np.mod(b[:, 2] - a[:, 2] - z[:, 2] + np.pi, 2 * np.pi) - np.pi
    return np.stack((cos_z * ex + sin_z * ey, -sin_z * ex + cos_z * ey, turn), axis=1)


def range_bearing_with_assignment(pose: Any, point: Any, z: Any) -> Any:
    seen = SE2.from_array(pose).inverse().act(point)
    error = np.stack((np.linalg.norm(seen, axis=1), np.arctan2(seen[:, 1], seen[:, 0])), axis=1) - z
    error[:, 1] = wrap(error[:, 1])
    return error


def test_a_between_factor_of_your_own_equals_the_built_in_one() -> None:
    measured = random_elements(SE2, (M,), RNG)
    own = CustomFactor(
        (KEYS, KEYS + 1), between_in_plain_numpy, kinds=(SE2, SE2), measurement=measured, sigmas=[1, 1, 2]
    )
    built_in = Between(KEYS, KEYS + 1, measured, sigmas=[1, 1, 2])
    values = [random_elements(SE2, (M,), RNG) for _ in range(2)]
    (ours, our_jacobians), (theirs, their_jacobians) = own.linearise(*values), built_in.linearise(*values)
    np.testing.assert_allclose(ours, theirs, atol=1e-13)
    for left, right in zip(our_jacobians, their_jacobians, strict=True):
        np.testing.assert_allclose(left, right, atol=1e-12)
    np.testing.assert_array_equal(own.information, built_in.information)
    check_factor(own)


def test_objects_and_assignment_in_a_residual() -> None:
    z = np.stack((RNG.uniform(1, 5, M), RNG.uniform(-3, 3, M)), axis=1)
    own = CustomFactor(
        [KEYS, KEYS], range_bearing_with_assignment, kinds=(SE2, Point2), measurement=z, sigmas=[0.1, 0.2]
    )
    built_in = RangeBearing(KEYS, KEYS, z[:, 0], z[:, 1], sigmas=[0.1, 0.2])
    values = [random_elements(SE2, (M,), RNG), random_elements(Point2, (M,), RNG)]
    for left, right in zip(own.linearise(*values)[1], built_in.linearise(*values)[1], strict=True):
        np.testing.assert_allclose(left, right, atol=1e-11)
    check_factor(own)


def test_one_key_no_measurement_and_an_array_of_keys() -> None:
    upright = CustomFactor(
        4, lambda pose: SE3.from_array(pose).matrix()[:, :2, 2], kinds=(SE3,), sigmas=[0.1, 0.1]
    )
    assert upright.keys.tolist() == [[4]]
    assert upright.measurement.shape == (1, 0)
    check_factor(upright)
    many = CustomFactor(
        KEYS, lambda point: point[:, 2:], kinds=(Point3,), sigmas=0.1, role="prior", kernel=Huber()
    )
    assert len(many) == M
    assert many.residual_dim == 1
    assert many.role is Role.PRIOR
    check_factor(many)
    table = CustomFactor(
        np.stack((KEYS, KEYS + 1), axis=1), lambda a, b: b[:, :2] - a[:, :2], kinds=(SE2, SE2), sigmas=[1, 1]
    )
    assert table.keys.shape == (M, 2)
    check_factor(table)


def test_a_jacobian_of_your_own_is_used_and_its_shape_checked() -> None:
    def jacobian(a: Any, b: Any) -> Any:
        by_b = np.zeros((len(a), 1, 2))
        by_b[:, 0, 0] = 1.0
        return -by_b, by_b

    def residual(a: Any, b: Any) -> Any:
        return b[:, :1] - a[:, :1]

    own = CustomFactor((0, 1), residual, kinds=(Point2, Point2), sigmas=1.0, jacobian=jacobian)
    check_factor(own)
    wrong = CustomFactor(
        (0, 1), residual, kinds=(Point2, Point2), sigmas=1.0, jacobian=lambda a, b: (jacobian(a, b)[0],)
    )
    with pytest.raises(InputError, match="jacobian returned shapes"):
        wrong.linearise(np.zeros((1, 2)), np.ones((1, 2)))


def test_noise_of_another_length_than_the_residual_is_refused() -> None:
    own = CustomFactor(KEYS, lambda pose: pose[:, :2], kinds=(SE2,), sigmas=0.1)
    with pytest.raises(InputError, match="give noise of the residual's length"):
        own.linearise(random_elements(SE2, (M,), RNG))


def test_what_cannot_be_differentiated_says_so() -> None:
    def with_plain_array(pose: Any) -> Any:
        error = np.zeros((len(pose), 2))
        error[:, 0] = pose[:, 0]
        return error

    own = CustomFactor(KEYS, with_plain_array, kinds=(SE2,), sigmas=[1, 1])
    with pytest.raises(InputError, match=r"np\.stack"):
        own.linearise(random_elements(SE2, (M,), RNG))


class Distance(Factor):
    """A subclass that gives only its residual."""

    def __init__(self, a: Any, b: Any, distance: Any) -> None:
        self.keys = np.stack((a, b), axis=1)
        self.kinds = (SE3, Point3)
        self.measurement = np.asarray(distance)[:, None]
        self.information = np.broadcast_to(np.eye(1), (len(self.keys), 1, 1))
        self.kernel = None
        self.role = Role.OBSERVATION

    def residual(self, *values: Any, measurement: Any) -> Any:
        pose, point = values
        return np.linalg.norm(point - pose[:, :3], axis=1, keepdims=True) - measurement


def test_a_subclass_with_only_a_residual_gets_its_jacobian() -> None:
    factor = Distance(KEYS, KEYS, RNG.uniform(1, 2, M))
    assert factor.jacobians(measurement=factor.measurement) is None
    check_factor(factor)


def test_the_solver_treats_a_factor_of_your_own_as_a_built_in_one() -> None:
    steps = SE2(np.full(12, 1.0), 0.0, np.pi / 6)
    measured = steps.retract(np.random.default_rng(3).normal(scale=0.05, size=(12, 3))).array
    solutions = []
    for own in (False, True):
        graph = FactorGraph()
        ring = graph.add_pose(SE2(np.cos(np.arange(12.0)), np.sin(np.arange(12.0)), np.arange(12.0)))
        graph.add(Prior(ring[0], SE2(0, 0, 0), sigmas=0.1))
        after = np.roll(ring, -1)
        if own:
            for a, b, z in zip(ring, after, measured, strict=True):  # one by one: they share a block
                factor = CustomFactor(
                    (a, b),
                    between_in_plain_numpy,
                    kinds=(SE2, SE2),
                    measurement=z,
                    sigmas=[1, 1, 0.1],
                    kernel=Huber(),
                )
                graph.add(factor)
        else:
            graph.add(Between(ring, after, measured, sigmas=[1, 1, 0.1], kernel=Huber()))
        assert len(list(graph.blocks())) == 2
        solutions.append(optimize(graph, init="file"))
    assert 1e-4 < solutions[0].chi2 == pytest.approx(solutions[1].chi2, rel=1e-9)
    np.testing.assert_allclose(solutions[0].values(SE2).array, solutions[1].values(SE2).array, atol=1e-6)


def test_an_empty_block_is_no_special_case() -> None:
    none = np.empty(0, dtype=np.int64)
    empty = np.empty((0, 3))
    for factor in (
        Between(none, none, empty, sigmas=1.0),
        Between(none, none, empty, information=np.eye(3)),
        CustomFactor(
            (none, none), between_in_plain_numpy, kinds=(SE2, SE2), measurement=empty, sigmas=[1, 1, 1]
        ),
    ):
        error, jacobians = factor.linearise(empty, empty)
        assert len(factor) == 0
        assert error.shape == (0, 3)
        assert [jacobian.shape for jacobian in jacobians] == [(0, 3, 3)] * 2
