"""Jacobians of a block of factors: its own, or by forward differentiation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.graph import Factor

Array = NDArray[np.float64]


def differentiate(factor: Factor, values: list[Array]) -> tuple[Array, ...]:
    """Derivatives ``(M, d, dim)`` of the residual by the tangent of each variable."""
    own = factor.jacobians(*values, measurement=factor.measurement)
    if own is not None:
        return own
    raise NotImplementedError
