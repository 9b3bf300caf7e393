"""The geometry classes: SO2, SE2, SO3, SE3, Point2, Point3."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry import points, se2, se3, so2, so3
from clew.geometry.batch import Batch, as_float_array
from clew.geometry.manifold import ManifoldFunctions

Array = NDArray[np.float64]

#: How far a matrix may be from orthonormal and still be read as a rotation.
_ORTHONORMAL_TOLERANCE = 1e-6


def _stack(*columns: Any) -> Any:
    """Arrays broadcast against each other and stacked along a new last axis."""
    shape = np.broadcast_shapes(*(np.shape(column) for column in columns))
    return np.stack([np.broadcast_to(column, shape) for column in columns], axis=-1)


def _check_quaternions(quaternions: Array, what: str) -> None:
    bad = np.linalg.norm(quaternions, axis=-1) < 1e-12
    if np.any(bad):
        where = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InputError(f"{what}: quaternion {where} of the batch has length zero, which is no rotation")


def _rotation_of_matrix(matrix: ArrayLike, size: int, what: str) -> tuple[Array, Array]:
    """Matrices ``(..., size, size)``, checked, and the quaternions of their rotation blocks."""
    checked = as_float_array(matrix, size, what)
    if checked.shape[-2:] != (size, size):
        raise InputError(f"{what}: expected matrices of shape (..., {size}, {size}), got {checked.shape}")
    rotation = checked[..., :3, :3]
    defect = np.abs(rotation @ np.swapaxes(rotation, -1, -2) - np.eye(3)).max(initial=0.0)
    if defect > _ORTHONORMAL_TOLERANCE or np.any(np.linalg.det(rotation) < 0.0):
        raise InputError(f"{what}: not a rotation (R R^T differs from I by {defect:.2g}, or det R < 0)")
    return checked, so3.from_matrix(rotation)


class SO2(Batch):
    """Rotations of the plane: storage ``(theta,)``, radians in ``(-pi, pi]``; tangent ``(theta,)``."""

    name: ClassVar[str] = "SO2"
    dim: ClassVar[int] = 1
    rotation_dim: ClassVar[int] = 1
    storage: ClassVar[int] = 1
    space: ClassVar[int] = 2
    functions: ClassVar[ManifoldFunctions] = so2
    _identity: ClassVar[tuple[float, ...]] = (0.0,)
    __slots__ = ()

    def __init__(self, theta: ArrayLike) -> None:
        self._set(type(self).from_array(_stack(theta)).array)

    @property
    def theta(self) -> Array:
        """Angle ``(...)``, radians."""
        return self._column(0)


class SE2(Batch):
    """Poses in the plane: storage and tangent ``(x, y, theta)``, metres, radians in ``(-pi, pi]``."""

    name: ClassVar[str] = "SE2"
    dim: ClassVar[int] = 3
    rotation_dim: ClassVar[int] = 1
    storage: ClassVar[int] = 3
    space: ClassVar[int] = 2
    functions: ClassVar[ManifoldFunctions] = se2
    _identity: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0)
    __slots__ = ()

    def __init__(self, x: ArrayLike, y: ArrayLike, theta: ArrayLike) -> None:
        self._set(type(self).from_array(_stack(x, y, theta)).array)

    @property
    def x(self) -> Array:
        """``(...)`` metres."""
        return self._column(0)

    @property
    def y(self) -> Array:
        """``(...)`` metres."""
        return self._column(1)

    @property
    def theta(self) -> Array:
        """Heading ``(...)``, radians."""
        return self._column(2)

    @property
    def translation(self) -> Array:
        """``(..., 2)`` metres."""
        return self._array[..., :2]

    @property
    def rotation(self) -> SO2:
        """The heading as a rotation."""
        return SO2._wrap(self._array[..., 2:])


class SO3(Batch):
    """Rotations of space: unit quaternions ``(qx, qy, qz, qw)``, ``qw >= 0``; tangent: rotation vector."""

    name: ClassVar[str] = "SO3"
    dim: ClassVar[int] = 3
    rotation_dim: ClassVar[int] = 3
    storage: ClassVar[int] = 4
    space: ClassVar[int] = 3
    functions: ClassVar[ManifoldFunctions] = so3
    _identity: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0, 1.0)
    __slots__ = ()

    def __init__(self, quaternion_xyzw: ArrayLike) -> None:
        self._set(type(self).from_array(quaternion_xyzw).array)

    @classmethod
    def _check(cls, array: Array) -> None:
        _check_quaternions(array, cls.name)

    @classmethod
    def from_rotation_vector(cls, vector: ArrayLike) -> SO3:
        """Rotation about a vector ``(..., 3)`` by its length in radians."""
        return cls._wrap(so3.exp(as_float_array(vector, 3, "rotation vector")))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> SO3:
        """Rotation of orthonormal matrices ``(..., 3, 3)``; raises `InputError` if they are not."""
        return cls._wrap(_rotation_of_matrix(matrix, 3, "SO3.from_matrix")[1])

    @property
    def rotation_vector(self) -> Array:
        """``(..., 3)`` radians, length at most pi."""
        return so3.log(self._array)


class SE3(Batch):
    """Poses in space: storage ``(x, y, z, qx, qy, qz, qw)``, metres and a unit quaternion with ``qw >= 0``.

    Tangent ``(x, y, z, rx, ry, rz)``: translation, then a rotation vector in radians.
    """

    name: ClassVar[str] = "SE3"
    dim: ClassVar[int] = 6
    rotation_dim: ClassVar[int] = 3
    storage: ClassVar[int] = 7
    space: ClassVar[int] = 3
    functions: ClassVar[ManifoldFunctions] = se3
    _identity: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    __slots__ = ()

    def __init__(self, translation: ArrayLike, rotation: SO3 | ArrayLike = (0.0, 0.0, 0.0, 1.0)) -> None:
        """Translations ``(..., 3)`` and rotations: `SO3`, or quaternions ``(..., 4)`` as x, y, z, w."""
        position = as_float_array(translation, 3, "SE3 translation")
        quaternion = rotation.array if isinstance(rotation, SO3) else SO3.from_array(rotation).array
        shape = np.broadcast_shapes(position.shape[:-1], quaternion.shape[:-1])
        parts = (np.broadcast_to(position, (*shape, 3)), np.broadcast_to(quaternion, (*shape, 4)))
        self._set(np.concatenate(parts, axis=-1))

    @classmethod
    def _check(cls, array: Array) -> None:
        _check_quaternions(array[..., 3:], cls.name)

    @classmethod
    def from_rotation_vector(cls, translation: ArrayLike, vector: ArrayLike) -> SE3:
        """Pose from translations ``(..., 3)`` and rotation vectors ``(..., 3)`` in radians."""
        return cls(translation, SO3.from_rotation_vector(vector))

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> SE3:
        """Pose of homogeneous matrices ``(..., 4, 4)``; raises `InputError` if they are no rigid motion."""
        checked, quaternion = _rotation_of_matrix(matrix, 4, "SE3.from_matrix")
        return cls(checked[..., :3, 3], SO3._wrap(quaternion))

    @classmethod
    def from_planar(cls, pose: SE2) -> SE3:
        """Planar poses in the plane ``z = 0``."""
        zero = np.zeros(pose.shape)
        return cls.from_rotation_vector(
            np.stack((pose.x, pose.y, zero), axis=-1), np.stack((zero, zero, pose.theta), axis=-1)
        )

    @property
    def x(self) -> Array:
        """``(...)`` metres."""
        return self._column(0)

    @property
    def y(self) -> Array:
        """``(...)`` metres."""
        return self._column(1)

    @property
    def z(self) -> Array:
        """``(...)`` metres."""
        return self._column(2)

    @property
    def translation(self) -> Array:
        """``(..., 3)`` metres."""
        return self._array[..., :3]

    @property
    def rotation(self) -> SO3:
        """The attitude."""
        return SO3._wrap(self._array[..., 3:])


class Point2(Batch):
    """Points in the plane: storage and tangent ``(x, y)``, metres."""

    name: ClassVar[str] = "Point2"
    dim: ClassVar[int] = 2
    rotation_dim: ClassVar[int] = 0
    storage: ClassVar[int] = 2
    space: ClassVar[int] = 2
    functions: ClassVar[ManifoldFunctions] = points
    _identity: ClassVar[tuple[float, ...]] = (0.0, 0.0)
    __slots__ = ()

    def __init__(self, x: ArrayLike, y: ArrayLike) -> None:
        self._set(type(self).from_array(_stack(x, y)).array)

    @property
    def x(self) -> Array:
        """``(...)`` metres."""
        return self._column(0)

    @property
    def y(self) -> Array:
        """``(...)`` metres."""
        return self._column(1)


class Point3(Batch):
    """Points in space: storage and tangent ``(x, y, z)``, metres."""

    name: ClassVar[str] = "Point3"
    dim: ClassVar[int] = 3
    rotation_dim: ClassVar[int] = 0
    storage: ClassVar[int] = 3
    space: ClassVar[int] = 3
    functions: ClassVar[ManifoldFunctions] = points
    _identity: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0)
    __slots__ = ()

    def __init__(self, x: ArrayLike, y: ArrayLike, z: ArrayLike) -> None:
        self._set(type(self).from_array(_stack(x, y, z)).array)

    @property
    def x(self) -> Array:
        """``(...)`` metres."""
        return self._column(0)

    @property
    def y(self) -> Array:
        """``(...)`` metres."""
        return self._column(1)

    @property
    def z(self) -> Array:
        """``(...)`` metres."""
        return self._column(2)
