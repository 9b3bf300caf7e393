"""Classes: construction, checks, indexing, immutability."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from clew.errors import InputError
from clew.geometry import SE2, SE3, SO2, SO3, Point2, Point3


def test_constructors_broadcast() -> None:
    poses = SE2(np.arange(3), 1.0, 4.0)
    assert poses.shape == (3,)
    assert len(poses) == 3
    np.testing.assert_allclose(poses.theta, 4.0 - 2 * np.pi)
    assert SE3(np.zeros((4, 3))).shape == (4,)
    assert SE3([0, 0, 0], SO3.identity((2, 5))).shape == (2, 5)
    assert Point3(1, 2, [3, 4]).array.tolist() == [[1, 2, 3], [1, 2, 4]]
    assert SO2(0.5).array.tolist() == [0.5]
    np.testing.assert_allclose(SE3.from_planar(SE2(1, 2, 0.3)).rotation.rotation_vector, [0, 0, 0.3])


def test_storage_is_canonical() -> None:
    assert SE2(0, 0, -np.pi).theta == np.pi
    quaternion = SO3([0.0, 0.0, -3.0, -4.0]).array
    np.testing.assert_allclose(quaternion, [0, 0, 0.6, 0.8])


def test_indexing_iterating_and_parts() -> None:
    poses = SE2(np.arange(6.0), 0, 0.1)
    assert poses[2].shape == ()
    assert float(poses[2].x) == 2.0
    assert poses[[1, 3]].x.tolist() == [1, 3]
    assert poses[poses.x > 3].shape == (2,)
    assert [float(pose.x) for pose in poses] == [0, 1, 2, 3, 4, 5]
    assert SE3.identity((2, 3))[1, 2].shape == ()
    assert isinstance(poses.rotation, SO2)
    assert isinstance(SE3.identity().rotation, SO3)
    with pytest.raises(TypeError):
        len(poses[0])
    with pytest.raises(IndexError):
        poses[0][0]


def test_batches_are_immutable_and_own_their_data() -> None:
    source = np.zeros((2, 3))
    poses = SE2.from_array(source)
    source[:] = 5
    assert np.all(poses.array == 0)
    with pytest.raises(ValueError, match="read-only"):
        poses.array[0] = 1
    with pytest.raises(AttributeError, match="immutable"):
        poses.anything = 1  # type: ignore[attr-defined]  # the point of the test


def test_numpy_sees_an_array_but_operators_do_not_guess() -> None:
    pose = SE2(1, 2, 3)
    np.testing.assert_array_equal(np.asarray(pose), [1, 2, 3])
    with pytest.raises(TypeError):
        np.eye(3) @ pose
    with pytest.raises(InputError, match="expected another SE2, got SE3"):
        pose @ SE3.identity()  # type: ignore[operator]  # the point of the test


def test_pickle_and_repr() -> None:
    pose = pickle.loads(pickle.dumps(SE3([1, 2, 3])))
    assert isinstance(pose, SE3)
    assert pose.x == 1
    assert repr(SE2(1, 2, 0.5)).replace(" ", "") == "SE2(1.,2.,0.5)"
    assert "shape=(100,)" in repr(SE2.identity((100,)))


def test_act_takes_points_and_gives_the_same_type() -> None:
    pose = SE2(1, 0, np.pi / 2)
    moved = pose.act(Point2([1.0, 2.0], 0.0))
    assert isinstance(moved, Point2)
    np.testing.assert_allclose(moved.array, [[1, 1], [1, 2]], atol=1e-15)
    assert isinstance(pose.act(np.zeros((4, 2))), np.ndarray)
    with pytest.raises(InputError, match="acts on Point2, not on Point3"):
        pose.act(Point3(1, 2, 3))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: SE2(0, np.nan, 0), r"SE2: entry \(1,\) is not finite"),
        (lambda: SE2.from_array([1, 2]), r"expected an array of shape \(..., 3\), got \(2,\)"),
        (lambda: SE2.from_array("abc"), "cannot be read as numbers"),
        (lambda: SO3([0, 0, 0, 0]), "length zero"),
        (lambda: SE3([1, 2], SO3.identity()), "SE3 translation"),
        (lambda: SO3.from_matrix(2 * np.eye(3)), "not a rotation"),
        (lambda: SO3.from_matrix(np.diag([1, 1, -1])), "not a rotation"),
        (lambda: SE3.from_matrix(np.eye(3)), "SE3.from_matrix"),
        (lambda: SE2.identity().retract([1, 2]), "SE2 tangent"),
    ],
)
def test_bad_input_is_refused_in_one_clear_line(make: Any, says: str) -> None:
    with pytest.raises(InputError, match=says) as raised:
        make()
    assert "\n" not in str(raised.value)
