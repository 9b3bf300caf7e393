"""Whether errors are as large as their covariances say, when successive errors are alike.

The normalised estimation error squared (NEES, Bar-Shalom, Li, Kirubarajan 2001, section 5.4) ``e^T C^-1 e`` of an error
with ``d`` dimensions is chi-square distributed with ``d`` degrees of freedom where the covariance is right. Errors of a
trajectory are alike for a while, so that the mean over many poses scatters as that over few independent ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from clew.errors import InputError

Array = NDArray[np.float64]

_WINDOW = 5.0  # autocorrelation times that are summed over


@dataclass(frozen=True)
class Consistency:
    """Mean of normalised squared errors against what right covariances would give.

    Attributes:
        mean: of the normalised squared errors; `dim` where the covariances are right.
        dim: degrees of freedom of each.
        effective: number of independent errors that scatter as much in the mean.
        low, high: band of the mean, for right covariances, that holds it with the confidence asked for.
    """

    mean: float
    dim: int
    effective: float
    low: float
    high: float

    @property
    def inside(self) -> bool:
        """Whether the mean is in its band."""
        return self.low <= self.mean <= self.high

    @property
    def verdict(self) -> str:
        """The same in words: errors larger than the covariances say are the dangerous kind."""
        return "inside" if self.inside else "too sure" if self.mean > self.high else "too cautious"


def normalised_squares(errors: Array, covariances: Array) -> Array:
    """``e^T C^-1 e`` ``(N,)`` of errors ``(N, d)`` with covariances ``(N, d, d)``.

    Raises:
        InputError: shapes that do not fit, or a covariance that is not positive definite.
    """
    if errors.ndim != 2 or covariances.shape != (*errors.shape, errors.shape[1]):
        raise InputError(f"errors of shape {errors.shape} need covariances (N, d, d), got {covariances.shape}")
    try:
        whitened = np.linalg.solve(np.linalg.cholesky(covariances), errors[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        raise InputError("a covariance is not positive definite; leave out what is held fixed") from None
    return np.asarray(np.sum(whitened**2, axis=1))


def consistency(squares: Array, dim: int, confidence: float = 0.95) -> Consistency:
    """Compare normalised squared errors ``(N,)``, in the order of time, with their band.

    Raises:
        InputError: fewer than two.
    """
    count = effective_count(squares)
    tail = (1.0 - confidence) / 2.0
    low, high = (float(chdtri(dim * count, above)) / count for above in (1.0 - tail, tail))
    return Consistency(float(np.mean(squares)), dim, count, low, high)


def effective_count(series: Array) -> float:
    """How many independent numbers have a mean that scatters as much as that of a series ``(N,)``.

    ``N`` over the integrated autocorrelation time, which is summed up to five times itself (Sokal 1997, "Monte Carlo
    methods in statistical mechanics", section 3).

    Raises:
        InputError: fewer than two numbers.
    """
    if series.ndim != 1 or len(series) < 2:
        raise InputError(f"a series (N,) of at least two numbers is needed, got shape {series.shape}")
    centred = series - series.mean()
    spectrum = np.fft.rfft(centred, 2 * len(series))
    correlation = np.fft.irfft(spectrum * np.conj(spectrum))[: len(series)]
    if correlation[0] <= 0.0:
        return 1.0
    times = 2.0 * np.cumsum(correlation / correlation[0]) - 1.0
    enough = np.flatnonzero(np.arange(len(times)) >= _WINDOW * times)
    time = times[enough[0]] if len(enough) else len(series)
    return float(len(series) / min(max(time, 1.0), len(series)))
