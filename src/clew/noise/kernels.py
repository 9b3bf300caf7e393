"""Robust kernels on squared whitened residuals ``s``: ``s`` near zero, slower growth further out.

Formulas, up to the factor of the ``chi2`` convention: Zhang, "Parameter estimation techniques", 1997,
table 1; dynamic covariance scaling: Agarwal et al., "Robust map optimization using dynamic covariance
scaling", 2013.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Scaled:
    """Checks the one parameter that every kernel has."""

    scale: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.scale) and self.scale > 0.0):
            raise InputError(f"{type(self).__name__}: scale must be positive and finite, got {self.scale}")


@dataclass(frozen=True)
class Huber(_Scaled):
    """Quadratic up to `scale`, then linear: ``rho(s) = 2 c sqrt(s) - c^2`` for ``s > c^2``."""

    native_id: ClassVar[int] = 1
    scale: float = 1.345

    def rho(self, s: Array) -> Array:
        """Loss ``(M,)``."""
        c = self.scale
        return np.where(s <= c * c, s, 2.0 * c * np.sqrt(s) - c * c)

    def weight(self, s: Array) -> Array:
        """``min(1, c / sqrt(s))``."""
        c = self.scale
        return c / np.sqrt(np.maximum(s, c * c))


@dataclass(frozen=True)
class PseudoHuber(_Scaled):
    """Smooth Huber: ``rho(s) = 2 c^2 (sqrt(1 + s / c^2) - 1)``."""

    native_id: ClassVar[int] = 2
    scale: float = 1.345

    def rho(self, s: Array) -> Array:
        """Loss ``(M,)``."""
        u = s / self.scale**2
        return 2.0 * s / (np.sqrt(1.0 + u) + 1.0)

    def weight(self, s: Array) -> Array:
        """``1 / sqrt(1 + s / c^2)``."""
        return 1.0 / np.sqrt(1.0 + s / self.scale**2)


@dataclass(frozen=True)
class Cauchy(_Scaled):
    """Logarithmic: ``rho(s) = c^2 log(1 + s / c^2)``."""

    native_id: ClassVar[int] = 3
    scale: float = 2.3849

    def rho(self, s: Array) -> Array:
        """Loss ``(M,)``."""
        return self.scale**2 * np.log1p(s / self.scale**2)

    def weight(self, s: Array) -> Array:
        """``1 / (1 + s / c^2)``."""
        return 1.0 / (1.0 + s / self.scale**2)


@dataclass(frozen=True)
class GemanMcClure(_Scaled):
    """Bounded by ``c^2``: ``rho(s) = c^2 s / (c^2 + s)``."""

    native_id: ClassVar[int] = 4
    scale: float = 2.0

    def rho(self, s: Array) -> Array:
        """Loss ``(M,)``."""
        return s / (1.0 + s / self.scale**2)

    def weight(self, s: Array) -> Array:
        """``(c^2 / (c^2 + s))^2``."""
        return (1.0 + s / self.scale**2) ** -2.0


@dataclass(frozen=True)
class Welsch(_Scaled):
    """Bounded by ``c^2``: ``rho(s) = c^2 (1 - exp(-s / c^2))``."""

    native_id: ClassVar[int] = 5
    scale: float = 2.9846

    def rho(self, s: Array) -> Array:
        """Loss ``(M,)``."""
        return -(self.scale**2) * np.expm1(-s / self.scale**2)

    def weight(self, s: Array) -> Array:
        """``exp(-s / c^2)``."""
        return np.exp(-s / self.scale**2)


@dataclass(frozen=True)
class Tukey(_Scaled):
    """Constant beyond `scale`: ``rho(s) = c^2 / 3 (1 - (1 - s / c^2)^3)``, at most ``c^2 / 3``."""

    native_id: ClassVar[int] = 6
    scale: float = 4.6851

    def rho(self, s: Array) -> Array:
        """Loss ``(M,)``."""
        u = np.minimum(s / self.scale**2, 1.0)
        return self.scale**2 * u * (1.0 - u * (1.0 - u / 3.0))

    def weight(self, s: Array) -> Array:
        """``(1 - s / c^2)^2`` for ``s <= c^2``, else 0."""
        return (1.0 - np.minimum(s / self.scale**2, 1.0)) ** 2


@dataclass(frozen=True)
class DCS(_Scaled):
    """Dynamic covariance scaling: a residual beyond ``s = phi`` is scaled by ``2 phi / (phi + s)``.

    `scale` is the paper's ``phi``, unlike the others' in units of *squared* whitened residuals. The weight
    is the square of the scaling; the loss is the function with that derivative: ``rho(s) = s`` for
    ``s <= phi``, else ``3 phi - 4 phi^2 / (phi + s)``.
    """

    native_id: ClassVar[int] = 7
    scale: float = 1.0

    def rho(self, s: Array) -> Array:
        """Loss ``(M,)``."""
        phi = self.scale
        return np.where(s <= phi, s, 3.0 * phi - 4.0 * phi * phi / (phi + s))

    def weight(self, s: Array) -> Array:
        """``min(1, 2 phi / (phi + s))^2``."""
        phi = self.scale
        return (2.0 * phi / (phi + np.maximum(s, phi))) ** 2
