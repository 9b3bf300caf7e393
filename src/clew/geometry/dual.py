"""Forward differentiation on arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Dual:
    """An array with its derivatives."""

    __slots__ = ("tangents", "value")

    def __init__(self, value: Array, tangents: Array) -> None:
        self.value = value
        self.tangents = tangents


def primal(a: Any) -> Any:
    """The values of a dual array, or the array itself; for decisions that have no derivative."""
    return a.value if isinstance(a, Dual) else a
