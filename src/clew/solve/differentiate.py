"""Residual and Jacobians of a block of factors: its own, or by forward differentiation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry.differentiate import forward_jacobians
from clew.graph import Factor

Array = NDArray[np.float64]


def differentiate(factor: Factor, values: list[Array]) -> tuple[Array, tuple[Array, ...]]:
    """Residual ``(M, d)`` and its derivatives ``(M, d, dim)`` by the tangent of each variable."""
    own = factor.jacobians(*values, measurement=factor.measurement)
    if own is not None:
        return factor.residual(*values, measurement=factor.measurement), own
    return forward_jacobians(factor.residual, factor.kinds, values, factor.measurement)
