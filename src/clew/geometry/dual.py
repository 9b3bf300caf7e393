"""Dual arrays: arrays that carry exact derivatives through plain NumPy code.

Forward differentiation (Griewank and Walther, "Evaluating derivatives", 2008, chapter 3) with whole arrays as
scalars: each operation works once on the batch and on all its tangents. The rules live in `dual_ufuncs` and
`dual_functions`; what has no rule raises, it never drops a derivative in silence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from clew.errors import InputError

Array = NDArray[np.float64]

#: How to differentiate a ufunc, or an array function; filled by `dual_ufuncs` and `dual_functions`.
UFUNC_RULES: dict[Any, Callable[..., Any]] = {}
FUNCTION_RULES: dict[Any, Callable[..., Any]] = {}

_ADVICE = "write it with functions that dual arrays support, or give the factor its own Jacobian"


def _tangent_index(index: Any) -> tuple[tuple[Any, ...], tuple[Any, ...] | None]:
    """An index of values as a tuple; the same for tangents, or None if it holds arrays (is not basic)."""
    full = index if isinstance(index, tuple) else (index,)
    if any(isinstance(i, (np.ndarray, list, bool, np.bool_)) for i in full):
        return full, None
    return full, (slice(None), *full)


def _trailing_index(full: tuple[Any, ...]) -> tuple[Any, ...]:
    """An advanced index of values as one of tangents whose axis of directions is last.

    Advanced indices may move their axes to the front, so that axis has to wait at the back.
    """
    rest = () if any(i is Ellipsis for i in full) else (Ellipsis,)
    return (*full, *rest, slice(None))


class Dual(NDArrayOperatorsMixin):
    """An array ``(...)`` with its derivatives ``(p, ...)`` along ``p`` directions.

    Stands in for a float64 array in residuals. Comparisons and rounding give plain arrays. Where a derivative
    does not exist (``abs``, ``sqrt``, ``hypot``, ``norm`` at zero) it is taken as zero.

    Attributes:
        value: the array itself.
        tangents: derivative of each entry along each direction; may be a read-only broadcast view.
    """

    __slots__ = ("_cos_sin", "_whole", "tangents", "value")

    def __init__(self, value: Array, tangents: Array, whole: tuple[Dual, Any] | None = None) -> None:
        self.value = value
        self.tangents = tangents
        self._whole = whole  # for a part: the array it was taken from, and where, so that writing reaches it
        self._cos_sin: tuple[Array, Array] | None = None

    # Dispatch

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        rule = UFUNC_RULES.get(ufunc)
        out = kwargs.pop("out", None)
        if rule is None or method != "__call__" or kwargs:
            call = ufunc.__name__ if method == "__call__" else f"{ufunc.__name__}.{method}"
            options = f" with {', '.join(kwargs)}" if rule is not None and kwargs else ""
            raise InputError(f"numpy.{call}{options} has no derivative rule: {_ADVICE}")
        result = rule(*inputs)
        if out is None:
            return result
        target = out[0]
        if not isinstance(target, Dual):
            raise InputError("a result with derivatives cannot be stored in a plain array; use a new one")
        target._overwrite(result)
        return target

    def __array_function__(
        self, function: Callable[..., Any], types: Any, args: tuple[Any, ...], kwargs: dict[str, Any]
    ) -> Any:
        rule = FUNCTION_RULES.get(function)
        if rule is None:
            name = f"{function.__module__}.{function.__name__}"
            raise InputError(f"{name} has no derivative rule: {_ADVICE}")
        return rule(*args, **kwargs)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        raise InputError(
            "a dual array cannot become a plain one without losing its derivatives: build results with "
            "np.stack or np.concatenate, not with np.array, np.asarray or assignment into np.zeros"
        )

    def __float__(self) -> float:
        raise InputError("a dual array cannot become a float without losing its derivatives")

    def __bool__(self) -> bool:
        return bool(self.value)

    # Indexing

    def __getitem__(self, index: Any) -> Dual:
        full, basic = _tangent_index(index)
        if basic is not None:
            return Dual(self.value[full], self.tangents[basic], (self, full))
        last = np.moveaxis(self.tangents, 0, -1)
        return Dual(self.value[full], np.moveaxis(last[_trailing_index(full)], -1, 0))

    def __setitem__(self, index: Any, item: Any) -> None:
        full, basic = _tangent_index(index)
        value, tangents = self.value.copy(), self.tangents.copy()
        value[full] = primal(item)
        if basic is not None:
            part = tangents[basic]
            part[...] = expand(item, part.ndim - 1) if isinstance(item, Dual) else 0.0
        else:
            last = np.moveaxis(tangents, 0, -1)
            last[_trailing_index(full)] = np.moveaxis(item.tangents, 0, -1) if isinstance(item, Dual) else 0.0
        self._overwrite(Dual(value, tangents))

    def _overwrite(self, other: Any) -> None:
        if not isinstance(other, Dual) or other.shape != self.shape:
            raise InputError(f"cannot store an array {np.shape(primal(other))} in shape {self.shape}")
        self.value, self.tangents, self._cos_sin = other.value, other.tangents, None
        if self._whole is not None:
            whole, index = self._whole
            whole[index] = other

    def __len__(self) -> int:
        return len(self.value)

    def __iter__(self) -> Iterator[Dual]:
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        return f"Dual(value={self.value!r}, directions={len(self.tangents)})"

    # What users call on arrays

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the values."""
        return self.value.shape

    @property
    def ndim(self) -> int:
        """Number of axes of the values."""
        return self.value.ndim

    @property
    def size(self) -> int:
        """Number of values."""
        return self.value.size

    @property
    def dtype(self) -> np.dtype[np.float64]:
        """Type of the values."""
        return self.value.dtype

    @property
    def T(self) -> Any:
        """As `numpy.transpose`."""
        return FUNCTION_RULES[np.transpose](self)

    def astype(self, dtype: Any, copy: bool = True) -> Dual:
        """The same array; derivatives exist for float64 only."""
        if np.dtype(dtype) != np.float64:
            raise InputError(f"a dual array cannot become {np.dtype(dtype)} without losing its derivatives")
        return self.copy() if copy else self

    def copy(self) -> Dual:
        """Independent array."""
        return Dual(self.value, self.tangents)

    def sum(self, axis: Any = None, keepdims: bool = False) -> Any:
        """As `numpy.sum`."""
        return FUNCTION_RULES[np.sum](self, axis=axis, keepdims=keepdims)

    def mean(self, axis: Any = None, keepdims: bool = False) -> Any:
        """As `numpy.mean`."""
        return FUNCTION_RULES[np.mean](self, axis=axis, keepdims=keepdims)

    def reshape(self, *shape: Any) -> Any:
        """As `numpy.reshape`."""
        return FUNCTION_RULES[np.reshape](self, shape[0] if len(shape) == 1 else shape)

    def ravel(self) -> Any:
        """As `numpy.ravel`."""
        return FUNCTION_RULES[np.reshape](self, -1)

    def transpose(self, *axes: Any) -> Any:
        """As `numpy.transpose`."""
        return FUNCTION_RULES[np.transpose](self, axes[0] if len(axes) == 1 else axes or None)

    def swapaxes(self, first: int, second: int) -> Any:
        """As `numpy.swapaxes`."""
        return FUNCTION_RULES[np.swapaxes](self, first, second)

    def squeeze(self, axis: Any = None) -> Any:
        """As `numpy.squeeze`."""
        return FUNCTION_RULES[np.squeeze](self, axis)

    def clip(self, minimum: Any = None, maximum: Any = None) -> Any:
        """As `numpy.clip`."""
        return FUNCTION_RULES[np.clip](self, minimum, maximum)

    def dot(self, other: Any) -> Any:
        """As `numpy.dot`, for operands of at most two axes."""
        return FUNCTION_RULES[np.dot](self, other)

    def cos_sin(self) -> tuple[Array, Array]:
        """Cosine and sine of the values, computed once: the derivative of either needs both."""
        if self._cos_sin is None:
            self._cos_sin = np.cos(self.value), np.sin(self.value)
        return self._cos_sin


def primal(a: Any) -> Any:
    """The values of a dual array, or the array itself; for decisions that have no derivative."""
    return a.value if isinstance(a, Dual) else a


def expand(a: Dual, ndim: int) -> Array:
    """Tangents of an array, with axes of length one put in so that they broadcast with ``ndim`` axes."""
    missing = ndim - a.value.ndim
    if missing <= 0:
        return a.tangents
    return a.tangents.reshape((a.tangents.shape[0],) + (1,) * missing + a.value.shape)
