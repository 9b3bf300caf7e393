"""What all geometry classes share: one read-only array, indexing, and the group operations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry.dual import Dual, primal
from clew.geometry.manifold import ManifoldFunctions

Array = NDArray[np.float64]
Self = TypeVar("Self", bound="Batch")


def as_float_array(values: Any, storage: int, what: str) -> Array:
    """Finite float64 array ``(..., storage)``, or the dual array that it is; raises `InputError`."""
    array: Any = values
    if not isinstance(values, Dual):
        try:
            array = np.array(values, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"{what}: cannot be read as numbers ({error})") from None
    if array.ndim == 0 or array.shape[-1] != storage:
        raise InputError(f"{what}: expected an array of shape (..., {storage}), got {tuple(array.shape)}")
    finite = np.isfinite(primal(array))
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise InputError(f"{what}: entry {where} is not finite ({primal(array)[where]})")
    checked: Array = array
    return checked


class Batch:
    """Base of the geometry classes; see `clew.geometry.Manifold` for what the class attributes mean."""

    name: ClassVar[str]
    dim: ClassVar[int]
    rotation_dim: ClassVar[int]
    storage: ClassVar[int]
    space: ClassVar[int]
    functions: ClassVar[ManifoldFunctions]
    _identity: ClassVar[tuple[float, ...]]

    __slots__ = ("_array",)
    __array_ufunc__ = None  # so that `array @ pose` is an error instead of a guess
    _array: Array

    @classmethod
    def from_array(cls: type[Self], array: ArrayLike) -> Self:
        """Batch from an array ``(..., storage)``: copied, checked, angles wrapped, quaternions normalised.

        Raises:
            InputError: wrong shape, a value that is not finite, or a quaternion of length zero.
        """
        checked = as_float_array(array, cls.storage, cls.name)
        cls._check(primal(checked))
        return cls._wrap(cls.functions.canonical(checked))

    @classmethod
    def identity(cls: type[Self], shape: tuple[int, ...] = ()) -> Self:
        """Batch of identities (points: origins) of a shape."""
        return cls._wrap(np.broadcast_to(np.array(cls._identity), (*shape, cls.storage)).copy())

    @classmethod
    def exp(cls: type[Self], tangent: ArrayLike) -> Self:
        """Group exponential of tangents ``(..., dim)``; *not* `retract`, whose translation is decoupled."""
        return cls._wrap(cls.functions.exp(as_float_array(tangent, cls.dim, f"{cls.name} tangent")))

    @classmethod
    def _wrap(cls: type[Self], array: Array) -> Self:
        """Batch around an array that is already canonical."""
        self = object.__new__(cls)
        self._set(array)
        return self

    @classmethod
    def _check(cls, array: Array) -> None:
        """Raise `InputError` for finite arrays of the right shape that stand for nothing."""

    def _set(self, array: Array) -> None:
        if not isinstance(array, Dual):
            array.flags.writeable = False
        object.__setattr__(self, "_array", array)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self).__name__} is immutable")

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), np.asarray(self._array))

    @property
    def array(self) -> Array:
        """``(..., storage)``; read-only."""
        return self._array

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the batch."""
        return tuple(self._array.shape[:-1])

    def __len__(self) -> int:
        if self._array.ndim == 1:
            raise TypeError(f"a single {self.name} has no length")
        return int(self._array.shape[0])

    def __getitem__(self: Self, index: Any) -> Self:
        full = (*index, slice(None)) if isinstance(index, tuple) else (index, slice(None))
        if self._array.ndim == 1:
            raise IndexError(f"a single {self.name} cannot be indexed")
        return self._wrap(self._array[full].copy())

    def __iter__(self: Self) -> Iterator[Self]:
        return (self[i] for i in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self._array, dtype=dtype) if copy else np.asarray(self._array, dtype=dtype)

    def __repr__(self) -> str:
        values = primal(self._array)
        text = np.array2string(
            values, max_line_width=120, precision=6, suppress_small=True, separator=", ", threshold=30
        )
        if values.ndim == 1:
            return f"{self.name}({text[1:-1].strip()})"
        return f"{self.name}(shape={self.shape},\n{text})"

    def _column(self, index: int) -> Array:
        column: Array = self._array[..., index][()]
        return column

    def _peer(self: Self, other: Self) -> Array:
        if type(other) is not type(self):
            raise InputError(f"{self.name}: expected another {self.name}, got {type(other).__name__}")
        return other._array

    def compose(self: Self, other: Self) -> Self:
        """``self other``: first `other`, then `self`; also written ``self @ other``."""
        return self._wrap(self.functions.compose(self._array, self._peer(other)))

    def __matmul__(self: Self, other: Self) -> Self:
        return self.compose(other)

    def inverse(self: Self) -> Self:
        """The element that undoes this one: ``T_a_b.inverse()`` is ``T_b_a``."""
        return self._wrap(self.functions.inverse(self._array))

    def between(self: Self, other: Self) -> Self:
        """``self^-1 other``: ``T_a_b.between(T_a_c)`` is ``T_b_c``."""
        return self._wrap(self.functions.between(self._array, self._peer(other)))

    def act(self, points: Any) -> Any:
        """Points mapped by this batch, ``(..., space)``: ``p_a = T_a_b.act(p_b)``; points in, points out."""
        if isinstance(points, Batch):
            if points.storage != self.space or points.dim != self.space:
                raise InputError(f"{self.name} acts on Point{self.space}, not on {points.name}")
            return points._wrap(self.functions.act(self._array, points._array))
        return self.functions.act(self._array, as_float_array(points, self.space, f"{self.name}: points"))

    def log(self) -> Array:
        """Tangent ``(..., dim)`` with ``exp(tangent) = self``, rotations at most pi."""
        return self.functions.log(self._array)

    def adjoint(self) -> Array:
        """``(..., dim, dim)`` with ``self exp(v) self^-1 = exp(adjoint v)``."""
        return self.functions.adjoint(self._array)

    def matrix(self) -> Array:
        """Rotation matrix of a rotation, homogeneous matrix of a pose or point."""
        return self.functions.matrix(self._array)

    def retract(self: Self, delta: Any) -> Self:
        """Decoupled right update ``t <- t + R v``, ``R <- R Exp(w)``; it is *not* ``compose(exp(delta))``."""
        tangent = as_float_array(delta, self.dim, f"{self.name} tangent")
        return self._wrap(self.functions.retract(self._array, tangent))

    def local(self: Self, other: Self) -> Array:
        """Tangent ``(..., dim)`` that `retract` needs to get from here to `other`."""
        return self.functions.local(self._array, self._peer(other))

    def interpolate(self: Self, other: Self, fraction: ArrayLike) -> Self:
        """On the way to `other`: translation on the straight line, rotation at constant angular velocity.

        `fraction` is 0 here and 1 at `other`, and broadcasts against the batch.
        """
        share = np.asarray(fraction, dtype=np.float64)[..., None]
        return self._wrap(self.functions.retract(self._array, share * self.local(other)))


def _rebuild(cls: type[Batch], array: Array) -> Batch:
    return cls._wrap(array.copy())
