"""Numeric derivatives and random states: what the law checks stand on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.geometry import Manifold

Array = NDArray[np.float64]

#: How elements are drawn: anywhere, and where formulas change branch, near the identity and half a turn.
REGIMES = ("generic", "1e-7 from identity", "1e-12 from identity", "1e-7 from pi", "pi")


def require(condition: Any, message: str) -> None:
    """Raise `AssertionError` unless a condition holds; unlike ``assert`` also under ``python -O``."""
    if not condition:
        raise AssertionError(message)


def numeric_jacobian(function: Callable[[Array], Array], dim: int, step: float = 1e-4) -> Array:
    """Derivative ``(..., d, dim)`` at zero of a function of a tangent ``(dim,)`` with values ``(..., d)``.

    Central differences with one Richardson step: the error is of the order of ``step^4`` and of rounding.
    """
    columns = []
    for direction in np.eye(dim):
        wide, narrow = (
            (function(h * direction) - function(-h * direction)) / (2.0 * h) for h in (step, 0.5 * step)
        )
        columns.append((4.0 * narrow - wide) / 3.0)
    return np.stack(columns, axis=-1)


def random_tangents(
    kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str = "generic"
) -> Array:
    """Tangents ``(*shape, dim)`` with translations of some metres and rotations as `REGIMES` says."""
    tangent = rng.normal(scale=3.0, size=(*shape, kind.dim))
    turn = kind.rotation_dim
    if turn:
        axis = rng.normal(size=(*shape, turn))
        axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
        angles: dict[str, Any] = {
            "generic": rng.uniform(0.0, np.pi, size=(*shape, 1)),
            "1e-7 from identity": 1e-7,
            "1e-12 from identity": 1e-12,
            "1e-7 from pi": np.pi - 1e-7,
            "pi": np.pi,
        }
        tangent[..., kind.dim - turn :] = angles[regime] * axis
    if regime.endswith("identity"):
        tangent[..., : kind.dim - turn] *= 1e-7
    return tangent


def random_elements(
    kind: type[Manifold], shape: tuple[int, ...], rng: np.random.Generator, regime: str = "generic"
) -> Array:
    """Array ``(*shape, storage)`` of random elements."""
    origin = kind.identity(shape).array
    return kind.functions.retract(origin, random_tangents(kind, shape, rng, regime))
