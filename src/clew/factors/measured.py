"""What all built-in factors share: reading keys, measurements, noise and the sensor's place, with checks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry import SE2, SE3, Manifold, Point2, Point3
from clew.graph.factor import Factor, Keys, Role
from clew.noise import Kernel, resolve_information

Array = NDArray[np.float64]

#: Pose and point kinds by the dimension of space.
POSES: dict[int, type[Any]] = {2: SE2, 3: SE3}
POINTS: dict[int, type[Any]] = {2: Point2, 3: Point3}


def read_keys(keys: Sequence[ArrayLike], what: str) -> Keys:
    """Keys ``(M, arity)`` from one integer or ``(M,)`` integers a position; raises `InputError`."""
    columns = []
    for position, given in enumerate(keys):
        column = np.asarray(given)
        if column.dtype.kind not in "iu" and column.size:
            raise InputError(
                f"{what}: key {position} must be an integer as add_pose returns it, got {given!r}"
            )
        if column.ndim > 1:
            raise InputError(
                f"{what}: key {position} must be one integer or (M,) integers, got {column.shape}"
            )
        columns.append(column.astype(np.int64).reshape(-1))
    try:
        return np.stack(np.broadcast_arrays(*columns), axis=1)
    except ValueError:
        lengths = ", ".join(str(len(column)) for column in columns)
        raise InputError(f"{what}: the keys are of different lengths: {lengths}") from None


def read_numbers(values: ArrayLike, width: int, what: str) -> Array:
    """Finite measurements ``(width,)`` or ``(M, width)``; raises `InputError`."""
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: cannot be read as numbers ({error})") from None
    if array.ndim not in (1, 2) or array.shape[-1] != width:
        raise InputError(f"{what}: expected shape ({width},) or (M, {width}), got {array.shape}")
    finite = np.isfinite(array)
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise InputError(f"{what}: entry {where} is not finite ({array[where]})")
    return array


def read_columns(what: str, **columns: ArrayLike) -> Array:
    """Finite measurements ``(M, k)`` from ``k`` named numbers or ``(M,)`` arrays; raises `InputError`."""
    arrays = []
    for name, given in columns.items():
        flat = np.asarray(given)
        if flat.ndim > 1:
            raise InputError(f"{what}: {name} must be a number or (M,) numbers, got {flat.shape}")
        arrays.append(read_numbers(flat.reshape(-1, 1), 1, f"{what}: {name}")[:, 0])
    try:
        return np.stack(np.broadcast_arrays(*arrays), axis=1)
    except ValueError:
        raise InputError(f"{what}: {' and '.join(columns)} are of different lengths") from None


def read_element(value: Any, kinds: Sequence[type[Manifold]], what: str) -> tuple[type[Manifold], Array]:
    """Kind and array of a geometry object, or of an array whose width tells the kind; raises `InputError`."""
    names = " or ".join(kind.name for kind in kinds)
    for kind in kinds:
        if isinstance(value, kind):
            return kind, read_numbers(value.array, kind.storage, what)
    if isinstance(value, Manifold):
        raise InputError(f"{what}: expected {names}, got {value.name}")
    shape = np.shape(value)
    matching = [kind for kind in kinds if shape and kind.storage == shape[-1]]
    if len(matching) != 1:
        raise InputError(f"{what}: expected {names}, got an array of shape {shape}")
    array = read_numbers(value, matching[0].storage, what)
    return matching[0], matching[0].from_array(array).array


def read_sensor(T_robot_sensor: Any, pose: type[Manifold], what: str) -> Array | None:
    """Storage ``(storage,)`` of the sensor's pose on the robot, or None; raises `InputError`."""
    if T_robot_sensor is None:
        return None
    _, array = read_element(T_robot_sensor, (pose,), f"{what}: T_robot_sensor")
    if array.ndim != 1:
        raise InputError(f"{what}: T_robot_sensor is one pose for the whole block, got a batch {array.shape}")
    sensor: Array = array.copy()
    sensor.flags.writeable = False
    return sensor


class Measured(Factor):
    """Base of the built-in factors."""

    def _set_up(
        self,
        keys: Keys,
        kinds: tuple[type[Any], ...],
        measurement: Array,
        residual_dim: int,
        *,
        sigmas: ArrayLike | None,
        information: ArrayLike | None,
        covariance: ArrayLike | None,
        kernel: Kernel | None,
        role: Role | str,
    ) -> None:
        """Check and store what every factor has; one row of keys or measurements stands for all."""
        what = type(self).__name__
        rows = np.atleast_2d(measurement)
        counts = {len(keys), len(rows)} - {1}
        if len(counts) > 1:
            raise InputError(f"{what}: {len(keys)} rows of keys, but {len(rows)} measurements")
        count = counts.pop() if counts else 1
        if kernel is not None and not isinstance(kernel, Kernel):
            raise InputError(
                f"{what}: kernel must be a robust kernel such as Huber() or None, got {kernel!r}"
            )
        try:
            self.role = Role(role)
        except ValueError:
            names = ", ".join(r.value for r in Role)
            raise InputError(f"{what}: role must be one of {names}, got {role!r}") from None
        self.kinds = kinds
        self.kernel = kernel
        self.keys = np.broadcast_to(keys, (count, keys.shape[1])).copy()
        self.measurement = np.broadcast_to(rows, (count, rows.shape[1])).copy()
        self.information = resolve_information(
            count, residual_dim, sigmas=sigmas, information=information, covariance=covariance, what=what
        )
        for array in (self.keys, self.measurement, self.information):
            array.flags.writeable = False

    def __repr__(self) -> str:
        kinds = ", ".join(kind.name for kind in self.kinds)
        return f"{type(self).__name__}({len(self)} x ({kinds}), role={self.role.value}, kernel={self.kernel})"
