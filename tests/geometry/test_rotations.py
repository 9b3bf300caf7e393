"""Quaternions and exponentials against SciPy, and against answers known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from clew.geometry import SE2, SE3, SO3, se2, se3, so3
from clew.testing import REGIMES, random_elements, random_tangents


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.mark.parametrize("regime", REGIMES)
def test_exponential_logarithm_and_matrix_agree_with_scipy(regime: str, rng: np.random.Generator) -> None:
    vectors = random_tangents(SO3, (200,), rng, regime)
    theirs = Rotation.from_rotvec(vectors)
    ours = SO3.from_rotation_vector(vectors)
    np.testing.assert_allclose(ours.matrix(), theirs.as_matrix(), atol=1e-14)
    if regime != "pi":  # there both signs of the axis are right
        np.testing.assert_allclose(ours.rotation_vector, theirs.as_rotvec(), rtol=1e-8, atol=1e-15)


def test_products_and_actions_agree_with_scipy(rng: np.random.Generator) -> None:
    a, b = random_elements(SO3, (100,), rng), random_elements(SO3, (100,), rng)
    points = rng.normal(size=(100, 3))
    theirs = Rotation.from_quat(a) * Rotation.from_quat(b)
    np.testing.assert_allclose(so3.matrix(so3.compose(a, b)), theirs.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(so3.act(a, points), Rotation.from_quat(a).apply(points), atol=1e-14)


def test_from_matrix_finds_every_branch(rng: np.random.Generator) -> None:
    half_turns = np.pi * np.eye(3)
    vectors = np.concatenate(
        (random_tangents(SO3, (300,), rng), half_turns, 0.9999999 * half_turns, np.zeros((1, 3)))
    )
    matrices = Rotation.from_rotvec(vectors).as_matrix()
    np.testing.assert_allclose(SO3.from_matrix(matrices).matrix(), matrices, atol=1e-14)
    poses = SE3(rng.normal(size=(len(vectors), 3)), SO3.from_matrix(matrices))
    np.testing.assert_allclose(SE3.from_matrix(poses.matrix()).matrix(), poses.matrix(), atol=1e-14)


@pytest.mark.parametrize("regime", REGIMES)
def test_group_exponentials_are_matrix_exponentials(regime: str, rng: np.random.Generator) -> None:
    for tangent in random_tangents(SE2, (5,), rng, regime):
        x, y, theta = tangent
        generator = np.array([[0, -theta, x], [theta, 0, y], [0, 0, 0]])
        np.testing.assert_allclose(se2.matrix(se2.exp(tangent)), expm(generator), rtol=1e-12, atol=1e-12)
    for tangent in random_tangents(SE3, (5,), rng, regime):
        generator = np.zeros((4, 4))
        generator[:3, :3], generator[:3, 3] = so3.hat(tangent[3:]), tangent[:3]
        np.testing.assert_allclose(se3.matrix(se3.exp(tangent)), expm(generator), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("regime", REGIMES)
def test_right_jacobian_is_the_derivative_of_the_exponential(regime: str, rng: np.random.Generator) -> None:
    w = random_tangents(SO3, (20,), rng, regime)
    jacobian = so3.right_jacobian(w)
    np.testing.assert_allclose(
        so3.right_jacobian_inverse(w) @ jacobian, np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-12
    )
    step = 1e-6
    for direction in np.eye(3):
        ahead, behind = so3.exp(w + step * direction), so3.exp(w - step * direction)
        numeric = so3.local(behind, ahead) / (2 * step)
        np.testing.assert_allclose(jacobian @ direction, numeric, atol=1e-8)


def test_a_quarter_turn_by_hand() -> None:
    pose = SE2(1.0, 2.0, np.pi / 2)
    np.testing.assert_allclose(pose.act([3.0, 0.0]), [1.0, 5.0], atol=1e-15)
    np.testing.assert_allclose(pose.inverse().array, [-2.0, 1.0, -np.pi / 2], atol=1e-15)
    turned = SE3.from_rotation_vector([0, 0, 1], [0, 0, np.pi / 2])
    np.testing.assert_allclose(turned.array, [0, 0, 1, 0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-15)
    np.testing.assert_allclose(turned.act([1.0, 0.0, 0.0]), [0, 1, 1], atol=1e-15)


def test_interpolation_moves_straight_and_turns_evenly() -> None:
    start, end = SE2(0, 0, 3.0), SE2(4, 2, -3.0)
    middle = start.interpolate(end, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(middle.translation, [[0, 0], [2, 1], [4, 2]], atol=1e-14)
    np.testing.assert_allclose(middle.theta, [3.0, np.pi, -3.0], atol=1e-14)
    a, b = SE3.identity(), SE3.from_rotation_vector([2, 0, 0], [0.0, 1.2, 0.0])
    np.testing.assert_allclose(a.interpolate(b, 0.25).rotation.rotation_vector, [0, 0.3, 0], atol=1e-14)
