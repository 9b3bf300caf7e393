"""Jacobians of residuals by forward differentiation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry.dual import Dual
from clew.geometry.manifold import Manifold

Array = NDArray[np.float64]


def seed(kind: type[Manifold], values: Array) -> Dual:
    """Values ``(M, storage)`` with their derivatives along each tangent direction of `retract`."""
    basis = np.moveaxis(kind.functions.tangent_basis(values), -1, 0)
    # Columns (x, y, theta, ...) are what residuals work on, so each is made contiguous.
    columns = np.ascontiguousarray(np.moveaxis(basis, -1, 1))
    return Dual(np.asfortranarray(values), np.moveaxis(columns, 1, -1))


def forward_jacobians(
    residual: Callable[..., Any], kinds: Sequence[type[Manifold]], values: Sequence[Array], measurement: Array
) -> tuple[Array, tuple[Array, ...]]:
    """Residual ``(M, d)`` and its exact Jacobians ``(M, d, dim)``, one a key.

    Args:
        residual: ``residual(*values, measurement=measurement) -> (M, d)`` in NumPy functions that dual arrays
            support.
        kinds: manifold of each key.
        values: ``(M, storage)`` array a key.
        measurement: ``(M, k)``.

    Raises:
        InputError: the residual uses something that has no derivative rule, or returns a wrong shape.
    """
    count = len(measurement)
    error: Any = None
    jacobians = []
    # One key at a time: what depends on other keys only is then computed without any tangents.
    for position, kind in enumerate(kinds):
        arguments: list[Any] = list(values)
        arguments[position] = seed(kind, values[position])
        result = residual(*arguments, measurement=measurement)
        dual = isinstance(result, Dual)
        error = result.value if dual else np.asarray(result, dtype=np.float64)
        if error.ndim != 2 or len(error) != count:
            raise InputError(f"a residual must return ({count}, d), one row a measurement, got {error.shape}")
        jacobians.append(np.moveaxis(result.tangents, 0, -1) if dual else np.zeros((*error.shape, kind.dim)))
    return error, tuple(jacobians)
