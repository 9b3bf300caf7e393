"""Every operation on dual arrays against numeric differentiation, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from clew.errors import InputError
from clew.geometry import SE2, SE3, Dual, forward_jacobians
from clew.geometry.dual import UFUNC_RULES

RNG = np.random.default_rng(11)
SHAPE = (4, 3)
#: Values between -0.9 and 0.9 but not near zero, so that every function below is smooth there.
X = RNG.uniform(0.1, 0.9, SHAPE) * RNG.choice([-1.0, 1.0], SHAPE)
OTHER = RNG.uniform(0.95, 2.0, SHAPE)
MATRIX = RNG.normal(size=(3, 3))
STACK = RNG.normal(size=(4, 3, 2))
TANGENTS = RNG.normal(size=(5, *SHAPE))

Operation = Callable[[Any], Any]


def derivative_by_differences(operation: Operation, x: Any, tangents: Any) -> Any:
    step = 1e-5
    return np.stack([(operation(x + step * t) - operation(x - step * t)) / (2 * step) for t in tangents])


def _assigned(x: Any) -> Any:
    y = x * 2.0
    y[:, 2] = np.sin(y[:, 2])
    y[0] = 3.0
    y[:, :1] += x[:, 1:2]
    y *= x
    return y


def _masked_assignment(x: Any) -> Any:
    y = x + 0.0
    y[X > 0] = y[X > 0] ** 3
    return y


def _written_through_a_part(x: Any) -> Any:
    y = x * 1.0
    part = y[:, 1]
    part *= 5.0
    return y


def _into_zeros_like(x: Any) -> Any:
    y = np.zeros_like(x)
    y[:, 1] = x[:, 0] * x[:, 1]
    return y


OPERATIONS: dict[str, Operation] = {
    "arithmetic": lambda x: (2.0 - x) * x / (3.0 + x) - x / OTHER + OTHER / x - (-x) + (+x) - 1.0,
    "broadcast row": lambda x: x * np.arange(3.0) + x[0],
    "broadcast column": lambda x: x * x[:, :1] - x[:, 1:2],
    "grow": lambda x: x[:, None, :] * x[None, :, :],
    "plain minus dual": lambda x: OTHER[None] - x,
    "power": lambda x: x**2 + x**3 + OTHER**x + (x * x) ** 1.5 + x**0,
    "power of both": lambda x: np.abs(x) ** x,
    "float_power": lambda x: np.float_power(np.abs(x), 1.5),
    "trigonometry": lambda x: np.sin(x) * np.cos(x) + np.tan(x),
    "sine and cosine of one array": lambda x: (lambda t: np.cos(t) * np.sin(t))(x[:, 2]),
    "inverse trigonometry": lambda x: np.arcsin(x) + np.arccos(x) + np.arctan(x),
    "hyperbolic": lambda x: np.sinh(x) + np.cosh(x) + np.tanh(x),
    "exponentials": lambda x: np.exp(x) + np.expm1(x) + np.exp2(x),
    "logarithms": lambda x: np.log(x * x) + np.log1p(x) + np.log2(x * x) + np.log10(x * x),
    "roots": lambda x: np.sqrt(x * x + 1) + np.cbrt(x) + np.square(x) + np.reciprocal(x),
    "absolute": lambda x: abs(x) + np.abs(x) * 2 + np.fabs(x) + np.sign(x),
    "arctan2": lambda x: np.arctan2(x, OTHER) + np.arctan2(OTHER, x) + np.arctan2(x, x[:, :1]),
    "hypot": lambda x: np.hypot(x, OTHER) + np.hypot(x[:, :1], x),
    "remainder": lambda x: (
        np.remainder(x, 0.7) + x % 0.31 + np.mod(x, OTHER) + OTHER % (0.3 + x * x) - (-OTHER) % (0.3 + x * x)
    ),
    "fmod": lambda x: np.fmod(x, 0.31) + np.fmod(OTHER, 0.3 + x * x),
    "degrees": lambda x: np.rad2deg(x) + np.deg2rad(x) + np.degrees(x) + np.radians(x),
    "copysign": lambda x: np.copysign(x, OTHER) + np.copysign(OTHER, x),
    "rounding": lambda x: x * np.floor(3 * x) + np.ceil(x) + np.rint(x) + np.trunc(x) + x // 0.31,
    "extrema": lambda x: np.maximum(x, 0.2) + np.minimum(0.3, x) + np.fmax(x, x[:, :1]) + np.fmin(x, -x),
    "clip": lambda x: np.clip(x, -0.5, 0.5) + x.clip(-0.3, None),
    "where": lambda x: (
        np.where(x > 0, x**2, -3 * x) + np.where(X > 0, x, 1.0) + np.where(X > 0, 0.0, x[:, :1])
    ),
    "comparisons": lambda x: x * (x > 0) + x * (x <= 0.3) * np.logical_not(x == 0.1) * np.isfinite(x),
    "index": lambda x: x[1] + x[-1, :] + x[1:3, ::2].sum() + x[..., 0][2],
    "index by arrays": lambda x: x[[0, 2, 2]] * x[np.array([1, 0, 3])] + x[[0, 1, 2], [2, 0, 1]][:, None],
    "index by separated arrays": lambda x: x[:, None, :, None][[0, 1], :, [2, 0]],
    "index by mask": lambda x: x[X[:, 0] > 0] ** 2,
    "assignment": _assigned,
    "assignment by mask": _masked_assignment,
    "assignment through a part": _written_through_a_part,
    "assignment into zeros_like": _into_zeros_like,
    "ones_like": lambda x: np.ones_like(x) * x + np.empty_like(x) * 0.0,
    "stack": lambda x: np.stack((x[:, 0], np.ones(4), x[:, 2] * x[:, 1]), axis=-1),
    "stack first": lambda x: np.stack([x, OTHER, x * x]),
    "concatenate": lambda x: np.concatenate((x, OTHER, x * x), axis=1),
    "concatenate rows": lambda x: np.concatenate([x, x * x]),
    "column_stack": lambda x: np.column_stack((x[:, 0], x, np.zeros(4))),
    "hstack": lambda x: np.hstack((x, x * x)) * np.hstack((x[0], x[1]))[:6],
    "vstack": lambda x: np.vstack((x[0], x, np.zeros(3))),
    "reshape": lambda x: (
        x.reshape(2, 6) * np.reshape(x, (2, -1)) + x.ravel()[:6] + np.ravel(x).reshape((2, 6))
    ),
    "transpose": lambda x: x.T @ x + np.transpose(x, (1, 0)) @ x + x.transpose() @ x,
    "moveaxis": lambda x: (
        np.moveaxis(x[None], 2, 0) * np.moveaxis(x[None], -1, 0) + np.swapaxes(x, 0, 1)[:, None]
    ),
    "swapaxes": lambda x: x.swapaxes(0, -1) * np.swapaxes(x, -1, 0),
    "squeeze": lambda x: np.squeeze(x[None]) * x[:, None].squeeze(axis=1) * np.expand_dims(x, 0)[0],
    "broadcast_to": lambda x: np.broadcast_to(x[0], (4, 3)) * x + np.broadcast_arrays(x[:, :1], x)[0],
    "flip": lambda x: np.flip(x) + np.flip(x, 1) + x[::-1],
    "take": lambda x: np.take(x, [2, 0], axis=1) + np.take(x, [5, 1]),
    "sum": lambda x: x.sum() + np.sum(x, axis=0) + x.sum(axis=-1, keepdims=True) + np.sum(x, axis=(0, 1)),
    "mean": lambda x: np.mean(x) + x.mean(axis=0) * np.mean(x, axis=1, keepdims=True),
    "cumsum and diff": lambda x: np.cumsum(x, axis=1)[:, 1:] + np.diff(x, axis=1) + np.cumsum(x)[:2],
    "norm": lambda x: np.linalg.norm(x, axis=1) + np.linalg.norm(x[:, :2], axis=-1, keepdims=True)[:, 0],
    "cross": lambda x: np.cross(x, OTHER) + np.cross(MATRIX[0], x),
    "matrix times vector": lambda x: x @ MATRIX[0] + (x @ MATRIX)[:, 0] + (MATRIX @ x.T)[1] + x[0] @ x[1],
    "matmul batches": lambda x: (STACK.swapaxes(1, 2) @ x[..., None])[..., 0] + (x[:, None, :] @ STACK)[:, 0],
    "matmul of duals": lambda x: x.T @ x @ MATRIX + np.matmul(x[:3], x[1:]),
    "dot": lambda x: np.dot(x, MATRIX) + x.dot(MATRIX),
    "einsum": lambda x: np.einsum("mi,ij,mj->m", x, MATRIX, x) + np.einsum("...i,...i", x, OTHER),
    "einsum implicit": lambda x: np.einsum("ij,kj", x, MATRIX) + np.einsum("mi->m", x)[:, None],
    "inverse": lambda x: np.linalg.inv(x[:3] + 3 * np.eye(3)),
    "shape functions": lambda x: x * (np.ndim(x) + np.size(x) + np.shape(x)[0] + len(x) + x.ndim + x.size),
    "copies": lambda x: x.copy() * np.copy(x) + x.astype(np.float64),
    "iteration": lambda x: sum(row * (i + 1) for i, row in enumerate(x)),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation(name: str) -> None:
    operation = OPERATIONS[name]
    result = operation(Dual(X, TANGENTS))
    assert isinstance(result, Dual)
    np.testing.assert_allclose(result.value, operation(X), rtol=1e-14, atol=1e-14)
    expected = derivative_by_differences(operation, X, TANGENTS)
    assert result.tangents.shape == expected.shape
    np.testing.assert_allclose(result.tangents, expected, rtol=1e-7, atol=1e-8)


def test_every_ufunc_rule_is_exercised() -> None:
    used = set()

    class Spy(Dual):
        __slots__ = ()

        def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **kwargs: Any) -> Any:
            used.add(ufunc)
            result = super().__array_ufunc__(ufunc, method, *inputs, **kwargs)
            return Spy(result.value, result.tangents) if type(result) is Dual else result

        def __getitem__(self, index: Any) -> Dual:
            part = super().__getitem__(index)
            return Spy(part.value, part.tangents)

    for name, operation in OPERATIONS.items():
        if "through a part" not in name:
            operation(Spy(X, TANGENTS))
    plain = {np.signbit, np.isnan, np.isinf, np.not_equal, np.less, np.greater_equal}
    plain |= {np.logical_and, np.logical_or, np.logical_xor, np.logical_not, np.conjugate}
    assert set(UFUNC_RULES) - used <= plain


def test_the_argument_is_never_changed() -> None:
    value, tangents = X.copy(), TANGENTS.copy()
    x = Dual(value, tangents)
    for operation in OPERATIONS.values():
        operation(x)
    np.testing.assert_array_equal(value, X)
    np.testing.assert_array_equal(tangents, TANGENTS)
    np.testing.assert_array_equal(x.value, X)


def test_missing_derivatives_are_zero_and_do_not_warn() -> None:
    zero = Dual(np.zeros((2, 2)), np.ones((1, 2, 2)))
    for result in (
        np.sqrt(zero),
        np.linalg.norm(zero, axis=1),
        np.hypot(zero, zero),
        np.arctan2(zero, zero),
        abs(zero),
    ):
        np.testing.assert_array_equal(result.value, 0.0)
        np.testing.assert_array_equal(result.tangents, 0.0)


def _into_plain(x: Any) -> None:
    np.zeros(SHAPE)[:, 0] = x[:, 0]


@pytest.mark.parametrize(
    ("operation", "says"),
    [
        (np.gamma if hasattr(np, "gamma") else np.spacing, "no derivative rule"),
        (lambda x: np.linalg.svd(x), "numpy.linalg.svd has no derivative rule"),
        (lambda x: np.sort(x), "no derivative rule"),
        (lambda x: np.add.reduce(x), "numpy.add.reduce"),
        (lambda x: np.array([x, x]), "np.stack"),
        (lambda x: np.asarray(x), "np.stack"),
        (lambda x: float(x[0, 0]), "float"),
        (lambda x: np.sin(x, out=np.empty(SHAPE)), "cannot be stored in a plain array"),
        (lambda x: np.sin(x, where=X > 0), "with where"),
        (_into_plain, "np.stack"),
        (lambda x: x.astype(np.float32), "float32"),
        (lambda x: np.linalg.norm(x, ord=1), "Euclidean"),
        (lambda x: np.reshape(x, (2, 6), order="F"), "order='C'"),
        (lambda x: np.cross(x[:, :2], x[:, :2]), "length 3"),
        (lambda x: x.__setitem__(slice(None), np.zeros(7)) or x, "broadcast"),
    ],
)
def test_what_has_no_rule_is_refused_not_dropped(operation: Operation, says: str) -> None:
    with pytest.raises((InputError, ValueError), match=says):
        operation(Dual(X, TANGENTS))


def test_geometry_objects_carry_derivatives() -> None:
    rng = np.random.default_rng(0)
    for kind in (SE2, SE3):
        a, b = (kind.identity((6,)).retract(rng.normal(size=(6, kind.dim))) for _ in range(2))
        z = kind.identity((6,)).retract(rng.normal(size=(6, kind.dim)))

        def with_objects(x: Any, y: Any, measurement: Any, kind: Any = kind) -> Any:
            first, second = kind.from_array(x), kind.from_array(y)
            return kind.from_array(measurement).local(first.inverse() @ second)

        def with_functions(x: Any, y: Any, measurement: Any, kind: Any = kind) -> Any:
            return kind.functions.local(measurement, kind.functions.between(x, y))

        ours = forward_jacobians(with_objects, (kind, kind), (a.array, b.array), z.array)
        theirs = forward_jacobians(with_functions, (kind, kind), (a.array, b.array), z.array)
        np.testing.assert_allclose(ours[0], theirs[0], atol=1e-13)
        for left, right in zip(ours[1], theirs[1], strict=True):
            np.testing.assert_allclose(left, right, atol=1e-12)


def test_a_residual_of_wrong_shape_is_refused() -> None:
    poses = SE2.identity((4,)).array
    with pytest.raises(InputError, match=r"must return \(4, d\)"):
        forward_jacobians(lambda x, measurement: x[:, 0], (SE2,), (poses,), np.zeros((4, 0)))
    _, (jacobian,) = forward_jacobians(
        lambda x, measurement: np.ones((4, 2)), (SE2,), (poses,), np.zeros((4, 0))
    )
    np.testing.assert_array_equal(jacobian, np.zeros((4, 2, 3)))
