"""Derivative rules of ufuncs for dual arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.geometry.dual import UFUNC_RULES, Dual, expand, primal

Array = NDArray[np.float64]

# Piecewise constant functions and decisions: plain results, no derivative.
_CONSTANT = (
    np.sign, np.floor, np.ceil, np.rint, np.trunc, np.floor_divide, np.signbit,
    np.isfinite, np.isnan, np.isinf, np.equal, np.not_equal, np.less, np.less_equal, np.greater,
    np.greater_equal, np.logical_and, np.logical_or, np.logical_not, np.logical_xor,
)  # fmt: skip

#: ufunc -> derivative, from the argument ``x`` and the result ``y``.
_UNARY: dict[np.ufunc, Callable[[Array, Array], Any]] = {
    np.tan: lambda x, y: 1.0 + y * y,
    np.arcsin: lambda x, y: 1.0 / np.sqrt(1.0 - x * x),
    np.arccos: lambda x, y: -1.0 / np.sqrt(1.0 - x * x),
    np.arctan: lambda x, y: 1.0 / (1.0 + x * x),
    np.sinh: lambda x, y: np.cosh(x),
    np.cosh: lambda x, y: np.sinh(x),
    np.tanh: lambda x, y: 1.0 - y * y,
    np.exp: lambda x, y: y,
    np.exp2: lambda x, y: np.log(2.0) * y,
    np.expm1: lambda x, y: y + 1.0,
    np.log: lambda x, y: 1.0 / x,
    np.log2: lambda x, y: 1.0 / (np.log(2.0) * x),
    np.log10: lambda x, y: 1.0 / (np.log(10.0) * x),
    np.log1p: lambda x, y: 1.0 / (1.0 + x),
    np.sqrt: lambda x, y: _over(0.5, y),
    np.cbrt: lambda x, y: _over(1.0 / 3.0, y * y),
    np.square: lambda x, y: 2.0 * x,
    np.reciprocal: lambda x, y: -y * y,
    np.absolute: lambda x, y: np.sign(x),
    np.fabs: lambda x, y: np.sign(x),
    np.deg2rad: lambda x, y: np.pi / 180.0,
    np.radians: lambda x, y: np.pi / 180.0,
    np.rad2deg: lambda x, y: 180.0 / np.pi,
    np.degrees: lambda x, y: 180.0 / np.pi,
}


def _over(numerator: Any, denominator: Any) -> Any:
    """Quotient, and zero where the denominator is zero."""
    zero = denominator == 0.0
    if not np.any(zero):
        return numerator / denominator
    return np.where(zero, 0.0, numerator / np.where(zero, 1.0, denominator))


def linear(value: Array, *terms: tuple[Any, Any]) -> Any:
    """Dual array whose tangents are ``sum factor * tangents(operand)`` over the operands that are dual.

    A factor of None stands for one.
    """
    total: Any = None
    for operand, factor in terms:
        if not isinstance(operand, Dual):
            continue
        part = expand(operand, np.ndim(value))
        if factor is not None:
            part = part * factor
        total = part if total is None else total + part
    shape = (total.shape[0], *np.shape(value))
    return Dual(value, total if total.shape == shape else np.broadcast_to(total, shape))


def _unary_rule(ufunc: np.ufunc, derivative: Callable[[Array, Array], Any]) -> Callable[..., Any]:
    def rule(x: Dual) -> Any:
        y = ufunc(x.value)
        return Dual(y, x.tangents * derivative(x.value, y))

    return rule


def _constant_rule(ufunc: np.ufunc) -> Callable[..., Any]:
    def rule(*operands: Any) -> Any:
        return ufunc(*(primal(operand) for operand in operands))

    return rule


def _cos(x: Dual) -> Any:
    cos, sin = x.cos_sin()
    return Dual(cos, x.tangents * -sin)


def _sin(x: Dual) -> Any:
    cos, sin = x.cos_sin()
    return Dual(sin, x.tangents * cos)


def _negative(x: Dual) -> Any:
    return Dual(-x.value, -x.tangents)


def _positive(x: Dual) -> Any:
    return x.copy()


def _add(a: Any, b: Any) -> Any:
    return linear(primal(a) + primal(b), (a, None), (b, None))


def _subtract(a: Any, b: Any) -> Any:
    value = primal(a) - primal(b)
    if isinstance(a, Dual) and isinstance(b, Dual) and a.shape == b.shape:
        return Dual(value, a.tangents - b.tangents)
    return linear(value, (a, None), (b, -1.0))


def _multiply(a: Any, b: Any) -> Any:
    x, y = primal(a), primal(b)
    return linear(x * y, (a, y), (b, x))


def _divide(a: Any, b: Any) -> Any:
    x, y = primal(a), primal(b)
    quotient = x / y
    return linear(quotient, (a, 1.0 / y), (b, -quotient / y))


def _power(a: Any, b: Any) -> Any:
    x, n = primal(a), primal(b)
    value = x**n
    by_base = None
    if isinstance(a, Dual):
        # x**0 is constant; its formula would divide by zero at x = 0
        by_base = 2.0 * x if np.ndim(n) == 0 and n == 2 else n * x ** np.where(np.equal(n, 0), 1.0, n - 1.0)
    by_exponent = value * np.log(np.where(x > 0.0, x, 1.0)) if isinstance(b, Dual) else None
    return linear(value, (a, by_base), (b, by_exponent))


def _arctan2(a: Any, b: Any) -> Any:
    y, x = primal(a), primal(b)
    squared = x * x + y * y
    return linear(np.arctan2(y, x), (a, _over(x, squared)), (b, _over(-y, squared)))


def _hypot(a: Any, b: Any) -> Any:
    x, y = primal(a), primal(b)
    length = np.hypot(x, y)
    return linear(length, (a, _over(x, length)), (b, _over(y, length)))


def _remainder(a: Any, b: Any) -> Any:
    x, y = primal(a), primal(b)
    return linear(np.remainder(x, y), (a, None), (b, -np.floor(x / y)))


def _fmod(a: Any, b: Any) -> Any:
    x, y = primal(a), primal(b)
    return linear(np.fmod(x, y), (a, None), (b, -np.trunc(x / y)))


def _maximum(a: Any, b: Any) -> Any:
    x, y = primal(a), primal(b)
    first = np.greater_equal(x, y)
    return linear(np.maximum(x, y), (a, first), (b, ~first))


def _minimum(a: Any, b: Any) -> Any:
    x, y = primal(a), primal(b)
    first = np.less_equal(x, y)
    return linear(np.minimum(x, y), (a, first), (b, ~first))


def _copysign(a: Any, b: Any) -> Any:
    x, y = primal(a), primal(b)
    value = np.copysign(x, y)
    if not isinstance(a, Dual):
        return value
    return linear(value, (a, np.where(np.signbit(x) == np.signbit(value), 1.0, -1.0)))


def _matmul(a: Any, b: Any) -> Any:
    # Vectors become matrices first, so that the axis of directions cannot be mistaken for a row.
    row, column = np.ndim(primal(a)) == 1, np.ndim(primal(b)) == 1
    left = a[None, :] if row else a
    right = b[:, None] if column else b
    x, y = primal(left), primal(right)
    value = x @ y
    tangents: Any = 0.0
    if isinstance(left, Dual):
        tangents = expand(left, value.ndim) @ y
    if isinstance(right, Dual):
        tangents = tangents + x @ expand(right, value.ndim)
    result = Dual(value, tangents)
    if row:
        result = result[..., 0, :]
    return result[..., 0] if column else result


UFUNC_RULES.update({ufunc: _constant_rule(ufunc) for ufunc in _CONSTANT})
UFUNC_RULES.update({ufunc: _unary_rule(ufunc, derivative) for ufunc, derivative in _UNARY.items()})
UFUNC_RULES.update(
    {
        np.cos: _cos,
        np.sin: _sin,
        np.negative: _negative,
        np.positive: _positive,
        np.conjugate: _positive,
        np.add: _add,
        np.subtract: _subtract,
        np.multiply: _multiply,
        np.divide: _divide,
        np.power: _power,
        np.float_power: _power,
        np.arctan2: _arctan2,
        np.hypot: _hypot,
        np.remainder: _remainder,
        np.fmod: _fmod,
        np.maximum: _maximum,
        np.fmax: _maximum,
        np.minimum: _minimum,
        np.fmin: _minimum,
        np.copysign: _copysign,
        np.matmul: _matmul,
    }
)
