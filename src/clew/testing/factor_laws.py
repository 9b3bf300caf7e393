"""The laws of a factor, for your own as for the built-in ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.geometry import forward_jacobians
from clew.graph.factor import Factor
from clew.testing.numeric import numeric_jacobian, random_elements, require

Array = NDArray[np.float64]

_STEP = 1e-4
#: A residual that changes by more within one step crosses a branch cut (an angle leaving ``(-pi, pi]``).
_JUMP = 0.5


def check_factor(
    factor: Factor,
    values: Sequence[Any] | None = None,
    *,
    rng: int | np.random.Generator = 0,
    samples: int = 100,
    tolerance: float = 1e-6,
) -> None:
    """Check a factor's shapes, that its rows do not mix, and its Jacobians against numeric ones.

    The Jacobians (the factor's own, else those of forward differentiation) are compared with central
    differences along `retract`, for every key and direction. Samples in which the residual crosses a branch
    cut are left out.

    Args:
        factor: a block of any number of measurements; they are used in turn.
        values: where to evaluate, one array ``(S, storage)`` or geometry object a key; by default random
            states over some metres and the full range of angles, where residuals are not zero.
        rng: seed or generator of the random states.
        samples: number of random states.
        tolerance: largest difference, relative to the largest entry of the sample's Jacobian or one.

    Raises:
        AssertionError: saying which law is broken and where.
    """
    name = type(factor).__name__
    generator = np.random.default_rng(rng)
    if values is None:
        arrays = [random_elements(kind, (samples,), generator) for kind in factor.kinds]
    else:
        arrays = [np.array(getattr(value, "array", value), dtype=np.float64) for value in values]
    keys = len(factor.kinds)
    require(len(arrays) == keys, f"{name}: {len(arrays)} values for {keys} keys")
    count = len(arrays[0])
    measurement = factor.measurement[np.arange(count) % len(factor)]

    error = _residual(factor, arrays, measurement)
    finite = np.isfinite(error).all(axis=1)
    require(finite.all(), f"{name}: the residual is not finite in sample {int(np.argmin(finite))}")
    some = values is not None or np.abs(error).max() > 1e-6
    require(some, f"{name}: all residuals are zero, which shows nothing")
    order = generator.permutation(count)[: (count + 1) // 2]
    shuffled = _residual(factor, [array[order] for array in arrays], measurement[order])
    independent = np.allclose(shuffled, error[order], rtol=1e-9, atol=1e-9)
    require(independent, f"{name}: the residual of a row depends on other rows or on their order")

    jacobians = factor.jacobians(*arrays, measurement=measurement)
    origin = "jacobians"
    if jacobians is None:
        _, jacobians = forward_jacobians(factor.residual, factor.kinds, arrays, measurement)
        origin = "forward differentiation"
    require(len(jacobians) == keys, f"{name}: {len(jacobians)} Jacobians for {keys} keys")
    for position, jacobian in enumerate(jacobians):
        _compare(factor, arrays, measurement, position, jacobian, f"{name}: {origin}", tolerance)


def _residual(factor: Factor, arrays: list[Array], measurement: Array) -> Array:
    error = np.asarray(factor.residual(*arrays, measurement=measurement))
    expected = (len(measurement), factor.residual_dim)
    name = type(factor).__name__
    require(
        error.shape == expected, f"{name}: residual of shape {error.shape}, its noise asks for {expected}"
    )
    return error


def _compare(
    factor: Factor,
    arrays: list[Array],
    measurement: Array,
    position: int,
    jacobian: Array,
    what: str,
    tolerance: float,
) -> None:
    kind = factor.kinds[position]
    what = f"{what} by key {position} ({kind.name})"
    base = _residual(factor, arrays, measurement)
    shape = (*base.shape, kind.dim)
    require(jacobian.shape == shape, f"{what} has shape {jacobian.shape}, expected {shape}")
    smooth = np.ones(len(base), dtype=bool)

    def moved(delta: Array) -> Array:
        nonlocal smooth
        shifted = list(arrays)
        shifted[position] = kind.functions.retract(arrays[position], delta)
        error = _residual(factor, shifted, measurement)
        smooth &= np.abs(error - base).max(axis=1, initial=0.0) < _JUMP
        return error

    numeric = numeric_jacobian(moved, kind.dim, _STEP)
    require(smooth.mean() > 0.5, f"{what} cannot be checked: the residual jumps in most samples")
    scale = np.maximum(1.0, np.abs(numeric).max(axis=(1, 2), keepdims=True, initial=0.0))
    difference = np.where(smooth[:, None, None], np.abs(jacobian - numeric) / scale, 0.0)
    # not `difference > tolerance`: that would let NaN pass
    wrong = ~(difference <= tolerance)
    if wrong.any():
        sample, row, column = (int(i) for i in np.argwhere(wrong)[0])
        count = int(wrong.any(axis=(1, 2)).sum())
        raise AssertionError(
            f"{what} is wrong: d residual[{row}] / d tangent[{column}] is "
            f"{jacobian[sample, row, column]:.9g}, numerically {numeric[sample, row, column]:.9g} in sample "
            f"{sample} (residual {base[sample]}); {count} of {len(base)} samples differ"
        )
