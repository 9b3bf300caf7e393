"""The laws of a manifold, one function a law; `check_manifold` runs them all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.geometry import (
    Manifold,
    act_jacobians,
    between_jacobians,
    compose_jacobians,
    inverse_jacobian,
    local_jacobians,
)
from clew.geometry.differentiate import seed
from clew.testing.numeric import REGIMES, numeric_jacobian, random_elements, random_tangents, require

Array = NDArray[np.float64]
Law = Callable[[type[Manifold], tuple[int, ...], np.random.Generator, str], None]


def _same(kind: type[Manifold], actual: Array, expected: Array, law: str, tolerance: float = 1e-11) -> None:
    """Elements agree: matrices do, which are unique where a storage (half a turn) is not."""
    _close(kind.functions.matrix(actual), kind.functions.matrix(expected), f"{kind.name}: {law}", tolerance)


def _close(actual: Array, expected: Array, law: str, tolerance: float = 1e-11) -> None:
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=10 * tolerance, err_msg=law)


def closure(kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str) -> None:
    """Every operation gives finite storage of the right shape in canonical form."""
    f = kind.functions
    a, b = (random_elements(kind, shape, rng, regime) for _ in range(2))
    u = random_tangents(kind, shape, rng, regime)
    for result in (f.compose(a, b), f.inverse(a), f.between(a, b), f.exp(u), f.retract(a, u)):
        require(result.shape == (*shape, kind.storage), f"{kind.name}: wrong shape {result.shape}")
        _close(
            result, f.canonical(result), f"{kind.name}: the result of an operation is not canonical", 1e-14
        )


def identity(kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str) -> None:
    """``1 a = a 1 = a``, and ``1`` does not move points."""
    f = kind.functions
    a, one = random_elements(kind, shape, rng, regime), kind.identity(shape).array
    _same(kind, f.compose(one, a), a, "1 a = a")
    _same(kind, f.compose(a, one), a, "a 1 = a")
    points = rng.normal(size=(*shape, kind.space))
    _close(f.act(one, points), points, f"{kind.name}: 1 p = p")


def inverse(kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str) -> None:
    """``a a^-1 = 1``, and `between` is ``a^-1 b``."""
    f = kind.functions
    a, b = (random_elements(kind, shape, rng, regime) for _ in range(2))
    _same(kind, f.compose(a, f.inverse(a)), kind.identity(shape).array, "a a^-1 = 1")
    _same(kind, f.between(a, b), f.compose(f.inverse(a), b), "between(a, b) = a^-1 b")


def associativity(
    kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str
) -> None:
    """``(a b) c = a (b c)``, also on points, and matrices multiply alike."""
    f = kind.functions
    a, b, c = (random_elements(kind, shape, rng, regime) for _ in range(3))
    _same(kind, f.compose(f.compose(a, b), c), f.compose(a, f.compose(b, c)), "(a b) c = a (b c)")
    points = rng.normal(size=(*shape, kind.space))
    _close(f.act(f.compose(a, b), points), f.act(a, f.act(b, points)), f"{kind.name}: (a b) p = a (b p)")
    _close(
        f.matrix(f.compose(a, b)),
        f.matrix(a) @ f.matrix(b),
        f"{kind.name}: matrix(a b) = matrix(a) matrix(b)",
    )


def exponential(kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str) -> None:
    """``exp(log(a)) = a``; ``log(exp(u)) = u`` short of half a turn; ``exp(u) exp(-u) = 1``."""
    f = kind.functions
    a, u = random_elements(kind, shape, rng, regime), random_tangents(kind, shape, rng, regime)
    _same(kind, f.exp(f.log(a)), a, "exp(log(a)) = a")
    _same(kind, f.compose(f.exp(u), f.exp(-u)), kind.identity(shape).array, "exp(u) exp(-u) = 1")
    _same(kind, f.compose(f.exp(0.5 * u), f.exp(0.5 * u)), f.exp(u), "exp(u / 2)^2 = exp(u)")
    if regime != "pi":
        # the relative error of a tiny rotation counts, not the absolute one
        _close(f.log(f.exp(u)) / np.abs(u).max(), u / np.abs(u).max(), f"{kind.name}: log(exp(u)) = u", 1e-9)
    turn = kind.rotation_dim
    angle = np.linalg.norm(f.log(a)[..., kind.dim - turn :], axis=-1)
    require(np.all(angle <= np.pi + 1e-12), f"{kind.name}: log gives a rotation of more than half a turn")


def chart(kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str) -> None:
    """`local` undoes `retract`, and `retract` is decoupled: ``t <- t + R v``, ``R <- R Exp(w)``."""
    f = kind.functions
    a, b = random_elements(kind, shape, rng), random_elements(kind, shape, rng)
    u = random_tangents(kind, shape, rng, regime)
    _same(kind, f.retract(a, f.local(a, b)), b, "retract(a, local(a, b)) = b")
    if regime != "pi":
        _close(f.local(a, f.retract(a, u)), u, f"{kind.name}: local(a, retract(a, u)) = u", 1e-9)
    translating = np.zeros_like(u)
    translating[..., : kind.dim - kind.rotation_dim] = u[..., : kind.dim - kind.rotation_dim]
    split = f.compose(f.compose(a, f.exp(translating)), f.exp(u - translating))
    _same(kind, f.retract(a, u), split, "retract = translate, then rotate")


def adjoint(kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str) -> None:
    """``a exp(u) a^-1 = exp(adjoint(a) u)``."""
    f = kind.functions
    a, u = random_elements(kind, shape, rng, regime), random_tangents(kind, shape, rng, regime)
    turned = (f.adjoint(a) @ u[..., None])[..., 0]
    _same(
        kind,
        f.compose(f.compose(a, f.exp(u)), f.inverse(a)),
        f.exp(turned),
        "a exp(u) a^-1 = exp(Ad u)",
        1e-10,
    )


def jacobians(kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str) -> None:
    """Jacobians of the operations agree with numeric ones, taken along `retract`."""
    f = kind.functions
    a, b = random_elements(kind, shape, rng, regime), random_elements(kind, shape, rng)
    points = rng.normal(size=(*shape, kind.space))

    def check(
        operation: Callable[[Any], Array], at: Array, claimed: Array, law: str, flat: bool = False
    ) -> None:
        base = operation(at)

        def change(delta: Array) -> Array:
            moved = operation(f.retract(at, delta))
            return moved - base if flat else f.local(base, moved)

        _close(claimed, numeric_jacobian(change, kind.dim), f"{kind.name}: Jacobian of {law}", 1e-7)

    by_a, by_b = compose_jacobians(kind, a, b)
    check(lambda x: f.compose(x, b), a, by_a, "compose by the first")
    check(lambda x: f.compose(a, x), b, by_b, "compose by the second")
    check(f.inverse, a, inverse_jacobian(kind, a), "inverse")
    by_a, by_b = between_jacobians(kind, a, b)
    check(lambda x: f.between(x, b), a, by_a, "between by the first")
    check(lambda x: f.between(a, x), b, by_b, "between by the second")
    by_a, by_point = act_jacobians(kind, a, points)
    check(lambda x: f.act(x, points), a, by_a, "act by the element", flat=True)
    numeric = numeric_jacobian(lambda d: f.act(a, points + d), kind.space)
    _close(by_point, numeric, f"{kind.name}: Jacobian of act by the point", 1e-7)
    c = f.retract(b, random_tangents(kind, shape, rng, "generic" if regime.endswith("pi") else regime))
    by_b, by_c = local_jacobians(kind, b, c)
    check(lambda x: f.local(x, c), b, by_b, "local by the first", flat=True)
    check(lambda x: f.local(b, x), c, by_c, "local by the second", flat=True)


def duals(kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str) -> None:
    """Dual arrays carry the same derivatives through the operations."""
    f = kind.functions
    count = int(np.prod(shape, dtype=int))
    a, b = random_elements(kind, (count,), rng, regime), random_elements(kind, (count,), rng)
    points = rng.normal(size=(count, kind.space))

    def check(
        operation: Callable[[Any], Any], at: Array, claimed: Array, law: str, element: bool = True
    ) -> None:
        result = operation(seed(kind, at))
        _close(result.value, operation(at), f"{kind.name}: value of a dual array through {law}", 1e-13)
        expected = f.tangent_basis(result.value) @ claimed if element else claimed
        derivative = np.moveaxis(result.tangents, 0, -1)
        _close(derivative, expected, f"{kind.name}: derivative of a dual array through {law}", 1e-9)

    check(lambda x: f.compose(x, b), a, compose_jacobians(kind, a, b)[0], "compose")
    check(lambda x: f.compose(b, f.compose(f.inverse(b), x)), a, compose_jacobians(kind, a, a)[1], "b b^-1 x")
    check(f.inverse, a, inverse_jacobian(kind, a), "inverse")
    check(lambda x: f.between(x, b), a, between_jacobians(kind, a, b)[0], "between")
    check(lambda x: f.between(a, x), b, between_jacobians(kind, a, b)[1], "between")
    check(lambda x: f.act(x, points), a, act_jacobians(kind, a, points)[0], "act", element=False)
    check(lambda x: f.local(b, x), a, local_jacobians(kind, b, a)[1], "local", element=False)
    check(
        lambda x: f.exp(f.log(x)),
        a,
        np.broadcast_to(np.eye(kind.dim), (count, kind.dim, kind.dim)),
        "exp(log)",
    )


LAWS: dict[str, Law] = {
    law.__name__: law
    for law in (closure, identity, inverse, associativity, exponential, chart, adjoint, jacobians, duals)
}


def check_manifold(kind: type[Manifold], *, rng: int | np.random.Generator = 0, samples: int = 100) -> None:
    """Run all laws on a manifold: anywhere, near the identity and around half a turn.

    Args:
        kind: a class that keeps the `clew.geometry.Manifold` protocol.
        rng: seed or generator of the elements.
        samples: elements a law and regime.

    Raises:
        AssertionError: naming the law that is broken.
    """
    generator = np.random.default_rng(rng)
    for regime in REGIMES:
        for law in LAWS.values():
            law(kind, (samples,), generator, regime)
