"""Summary of a set of errors."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ErrorStatistics:
    """Summary of errors that are not negative, in their own unit (metres or radians); nan where there is
    none.

    Attributes:
        mean: arithmetic mean.
        std: standard deviation about the mean (of the population).
        rmse: root of the mean square.
        median: half of the errors are less.
        max: the largest.
    """

    mean: float
    std: float
    rmse: float
    median: float
    max: float

    @classmethod
    def of(cls, errors: Array) -> ErrorStatistics:
        """Summary of errors ``(M,)``."""
        if len(errors) == 0:
            return cls(*[float("nan")] * 5)
        return cls(float(np.mean(errors)), float(np.std(errors)), float(np.sqrt(np.mean(errors ** 2))),
                   float(np.median(errors)), float(np.max(errors)))

    def to_dict(self, scale: float = 1.0) -> dict[str, float | None]:
        """Plain numbers times `scale`, None for nan."""
        return {name: None if np.isnan(value) else value * scale for name, value in asdict(self).items()}
