"""Derivative rules of array functions for dual arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry.dual import FUNCTION_RULES, Dual, expand, primal

Array = NDArray[np.float64]


def _rule(*functions: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    def register(rule: Callable[..., Any]) -> Callable[..., Any]:
        FUNCTION_RULES.update(dict.fromkeys(functions, rule))
        return rule

    return register


def _behind(axis: Any, ndim: int) -> Any:
    """Axes of values as axes of tangents, whose first axis counts directions."""
    if isinstance(axis, tuple):
        return tuple(_behind(a, ndim) for a in axis)
    return axis if axis < 0 else axis + 1


def _all_tangents(parts: Sequence[Any]) -> list[Array]:
    """Tangents of all arrays, zeros for the plain ones."""
    directions = next(len(part.tangents) for part in parts if isinstance(part, Dual))
    return [
        part.tangents if isinstance(part, Dual) else np.broadcast_to(0.0, (directions, *np.shape(part)))
        for part in parts
    ]


# Joining


@_rule(np.stack)
def _stack(arrays: Any, axis: int = 0) -> Any:
    parts = list(arrays)
    value = np.stack([primal(part) for part in parts], axis)
    return Dual(value, np.stack(_all_tangents(parts), _behind(axis, value.ndim)))


@_rule(np.concatenate)
def _concatenate(arrays: Any, axis: int = 0) -> Any:
    parts = list(arrays)
    value = np.concatenate([primal(part) for part in parts], axis)
    return Dual(value, np.concatenate(_all_tangents(parts), _behind(axis, value.ndim)))


@_rule(np.column_stack)
def _column_stack(tup: Any) -> Any:
    return _concatenate([part[:, None] if np.ndim(primal(part)) == 1 else part for part in tup], 1)


@_rule(np.hstack)
def _hstack(tup: Any) -> Any:
    parts = list(tup)
    return _concatenate(parts, 0 if np.ndim(primal(parts[0])) == 1 else 1)


@_rule(np.vstack)
def _vstack(tup: Any) -> Any:
    return _concatenate([part[None, :] if np.ndim(primal(part)) == 1 else part for part in tup], 0)


# Shape


@_rule(np.reshape)
def _reshape(a: Dual, shape: Any, order: str = "C") -> Any:
    if order != "C":
        raise InputError("numpy.reshape of a dual array supports order='C' only")
    value = a.value.reshape(shape)
    return Dual(value, a.tangents.reshape((len(a.tangents), *value.shape)))


@_rule(np.ravel)
def _ravel(a: Dual) -> Any:
    return _reshape(a, -1)


@_rule(np.transpose, np.permute_dims if hasattr(np, "permute_dims") else np.transpose)
def _transpose(a: Dual, axes: Any = None) -> Any:
    order = tuple(range(a.ndim))[::-1] if axes is None else tuple(int(axis) % a.ndim for axis in axes)
    return Dual(a.value.transpose(order), a.tangents.transpose((0, *(axis + 1 for axis in order))))


@_rule(np.moveaxis)
def _moveaxis(a: Dual, source: Any, destination: Any) -> Any:
    def behind(axes: Any) -> Any:
        return _behind(tuple(axes) if np.ndim(axes) else axes, a.ndim)

    tangents = np.moveaxis(a.tangents, behind(source), behind(destination))
    return Dual(np.moveaxis(a.value, source, destination), tangents)


@_rule(np.swapaxes)
def _swapaxes(a: Dual, axis1: int, axis2: int) -> Any:
    tangents = np.swapaxes(a.tangents, _behind(axis1, a.ndim), _behind(axis2, a.ndim))
    return Dual(np.swapaxes(a.value, axis1, axis2), tangents)


@_rule(np.squeeze)
def _squeeze(a: Dual, axis: Any = None) -> Any:
    return _reshape(a, np.squeeze(a.value, axis).shape)


@_rule(np.expand_dims)
def _expand_dims(a: Dual, axis: Any) -> Any:
    return _reshape(a, np.expand_dims(a.value, axis).shape)


@_rule(np.broadcast_to)
def _broadcast_to(array: Dual, shape: Any) -> Any:
    value = np.broadcast_to(array.value, shape)
    return Dual(value, np.broadcast_to(expand(array, value.ndim), (len(array.tangents), *value.shape)))


@_rule(np.broadcast_arrays)
def _broadcast_arrays(*arrays: Any) -> Any:
    shape = np.broadcast_shapes(*(np.shape(primal(array)) for array in arrays))
    return tuple(np.broadcast_to(array, shape) for array in arrays)


@_rule(np.flip)
def _flip(m: Dual, axis: Any = None) -> Any:
    axes = tuple(range(m.ndim)) if axis is None else axis
    return Dual(np.flip(m.value, axes), np.flip(m.tangents, _behind(axes, m.ndim)))


@_rule(np.take)
def _take(a: Dual, indices: Any, axis: int | None = None) -> Any:
    flat = _reshape(a, -1) if axis is None else a
    along = 0 if axis is None else axis
    tangents = np.take(flat.tangents, indices, _behind(along, flat.ndim))
    return Dual(np.take(flat.value, indices, along), tangents)


@_rule(np.copy)
def _copy(a: Dual) -> Any:
    return a.copy()


@_rule(np.shape)
def _shape(a: Dual) -> tuple[int, ...]:
    return a.shape


@_rule(np.ndim)
def _ndim(a: Dual) -> int:
    return a.ndim


@_rule(np.size)
def _size(a: Dual) -> int:
    return a.size


def _filled(fill: float) -> Callable[..., Any]:
    # Dual, so that a result with derivatives can be written into it
    def rule(a: Dual) -> Any:
        return Dual(np.full(a.shape, fill), np.broadcast_to(0.0, a.tangents.shape))

    return rule


FUNCTION_RULES.update({np.zeros_like: _filled(0.0), np.empty_like: _filled(0.0), np.ones_like: _filled(1.0)})


# Choosing


@_rule(np.where)
def _where(condition: Any, x: Any = None, y: Any = None) -> Any:
    chosen = primal(condition)
    if x is None or y is None:
        return np.where(chosen)
    value = np.where(chosen, primal(x), primal(y))
    if not isinstance(x, Dual) and not isinstance(y, Dual):
        return value
    parts = [expand(part, value.ndim) if isinstance(part, Dual) else 0.0 for part in (x, y)]
    tangents = np.where(chosen, *parts)
    return Dual(value, np.broadcast_to(tangents, (len(tangents), *value.shape)))


@_rule(np.clip)
def _clip(a: Any, a_min: Any = None, a_max: Any = None) -> Any:
    low = a if a_min is None else np.maximum(a, a_min)
    return low if a_max is None else np.minimum(low, a_max)


@_rule(np.any)
def _any(a: Dual, axis: Any = None) -> Any:
    return np.any(a.value, axis)


@_rule(np.all)
def _all(a: Dual, axis: Any = None) -> Any:
    return np.all(a.value, axis)


@_rule(np.argmax)
def _argmax(a: Dual, axis: Any = None) -> Any:
    return np.argmax(a.value, axis)


@_rule(np.argmin)
def _argmin(a: Dual, axis: Any = None) -> Any:
    return np.argmin(a.value, axis)


# Sums and products


@_rule(np.sum)
def _sum(a: Dual, axis: Any = None, keepdims: bool = False) -> Any:
    axes = tuple(range(a.ndim)) if axis is None else axis
    tangents = np.sum(a.tangents, axis=_behind(axes, a.ndim), keepdims=keepdims)
    return Dual(np.sum(a.value, axis=axes, keepdims=keepdims), tangents)


@_rule(np.mean)
def _mean(a: Dual, axis: Any = None, keepdims: bool = False) -> Any:
    total = _sum(a, axis, keepdims)
    return total * (total.size / a.size)


@_rule(np.cumsum)
def _cumsum(a: Dual, axis: int | None = None) -> Any:
    flat = _reshape(a, -1) if axis is None else a
    along = 0 if axis is None else axis
    return Dual(np.cumsum(flat.value, along), np.cumsum(flat.tangents, _behind(along, flat.ndim)))


@_rule(np.diff)
def _diff(a: Dual, n: int = 1, axis: int = -1) -> Any:
    return Dual(np.diff(a.value, n, axis), np.diff(a.tangents, n, _behind(axis, a.ndim)))


@_rule(np.cross)
def _cross(a: Any, b: Any) -> Any:
    if np.shape(primal(a))[-1] != 3 or np.shape(primal(b))[-1] != 3:
        raise InputError("numpy.cross of dual arrays needs vectors of length 3 along the last axis")
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), axis=-1)


@_rule(np.dot)
def _dot(a: Any, b: Any) -> Any:
    if np.ndim(primal(a)) == 0 or np.ndim(primal(b)) == 0:
        return a * b
    if np.ndim(primal(b)) > 2:
        raise InputError("numpy.dot of dual arrays supports at most two axes on the right; use einsum or @")
    return a @ b


@_rule(np.einsum)
def _einsum(subscripts: str, *operands: Any) -> Any:
    if not isinstance(subscripts, str):
        raise InputError("numpy.einsum of dual arrays needs its subscripts as one string")
    inputs, arrow, output = subscripts.replace(" ", "").partition("->")
    if not arrow:
        letters = inputs.replace(",", "").replace("...", "")
        output = "..." * ("..." in inputs) + "".join(sorted(c for c in set(letters) if letters.count(c) == 1))
    direction = next(c for c in "PQRSTUVWXYZ" if c not in subscripts)
    values = [primal(operand) for operand in operands]
    terms = inputs.split(",")
    total: Any = None
    for position, operand in enumerate(operands):
        if isinstance(operand, Dual):
            named = ",".join((direction if i == position else "") + term for i, term in enumerate(terms))
            arguments = [*values[:position], operand.tangents, *values[position + 1 :]]
            part = np.einsum(f"{named}->{direction}{output}", *arguments)
            total = part if total is None else total + part
    return Dual(np.einsum(f"{inputs}->{output}", *values), total)


@_rule(np.linalg.norm)
def _norm(x: Dual, ord: Any = None, axis: Any = None, keepdims: bool = False) -> Any:
    if ord not in (None, 2) or (ord == 2 and x.ndim > 1 and not isinstance(axis, int)):
        raise InputError("numpy.linalg.norm of a dual array supports the Euclidean norm only")
    return np.sqrt(_sum(x * x, axis, keepdims))


@_rule(np.linalg.inv)
def _inv(a: Dual) -> Any:
    inverse = np.asarray(np.linalg.inv(a.value), dtype=np.float64)
    return Dual(inverse, -(inverse @ a.tangents @ inverse))
