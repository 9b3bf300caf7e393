"""What a manifold is: the protocols that solvers and factors rely on."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Self = TypeVar("Self", bound="Manifold")


class ManifoldFunctions(Protocol):
    """The array layer of a manifold: plain functions on ``(..., storage)`` and ``(..., dim)`` arrays.

    The modules `so2`, `se2`, `so3`, `se3` and `points` implement it. Functions broadcast, never write into
    their arguments and trust their input (`Manifold.from_array` checks). Those from `canonical` to `log`,
    `matrix`, `retract` and `local` also take dual arrays.
    """

    def canonical(self, a: Array, /) -> Array: ...
    def compose(self, a: Array, b: Array, /) -> Array: ...
    def inverse(self, a: Array, /) -> Array: ...
    def between(self, a: Array, b: Array, /) -> Array: ...
    def act(self, a: Array, points: Array, /) -> Array: ...
    def exp(self, tangent: Array, /) -> Array: ...
    def log(self, a: Array, /) -> Array: ...
    def adjoint(self, a: Array, /) -> Array: ...
    def matrix(self, a: Array, /) -> Array: ...
    def retract(self, a: Array, delta: Array, /) -> Array: ...
    def local(self, a: Array, b: Array, /) -> Array: ...
    def local_jacobians(self, a: Array, b: Array, /) -> tuple[Array, Array]: ...
    def act_jacobians(self, a: Array, points: Array, /) -> tuple[Array, Array]: ...
    def tangent_basis(self, a: Array, /) -> Array: ...


@runtime_checkable
class Manifold(Protocol):
    """An immutable batch of elements of one manifold, around one array ``(..., storage)``."""

    #: Name of the kind, as in error messages and native kernels.
    name: ClassVar[str]
    #: Length of a tangent.
    dim: ClassVar[int]
    #: How many entries of a tangent are rotation, at its end: 0, 1 or 3.
    rotation_dim: ClassVar[int]
    #: Length of one stored element.
    storage: ClassVar[int]
    #: Dimension of the space that elements live in and act on: 2 or 3.
    space: ClassVar[int]
    #: The same operations on plain arrays.
    functions: ClassVar[ManifoldFunctions]

    @property
    def array(self) -> Array:
        """``(..., storage)``; read-only."""
        ...

    @classmethod
    def from_array(cls: type[Self], array: ArrayLike) -> Self:
        """Check an array ``(..., storage)`` and bring it into canonical form."""
        ...

    @classmethod
    def identity(cls: type[Self], shape: tuple[int, ...] = ()) -> Self:
        """Batch of identities."""
        ...

    def retract(self: Self, delta: Any) -> Self:
        """Element reached by the tangent ``(..., dim)``."""
        ...

    def local(self: Self, other: Self) -> Array:
        """Tangent ``(..., dim)`` that `retract` needs to reach `other`."""
        ...
