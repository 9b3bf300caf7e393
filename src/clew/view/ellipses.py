"""Covariances of positions as ellipses that can be read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from clew.errors import InputError

Array = NDArray[np.float64]

_CORNERS = 40
_MOST = 80  # more would hide what they lie upon
_CANDIDATES = 1200
_TOO_SMALL, _READABLE = 4.0, 14.0  # longer half axis of the largest ellipse, pixels
_APART = 0.5  # least distance of two centres, of the sum of the longer half axes


def squared_radius(confidence: float) -> float:
    """Squared Mahalanobis distance within which a position of two coordinates lies with this probability.

    The quantile of chi-square with two degrees of freedom, ``-2 log(1 - p)``: 5.99 for 95 %.

    Raises:
        InputError: a probability that is not between 0 and 1.
    """
    if not 0.0 < confidence < 1.0:
        raise InputError(f"a confidence of {confidence} is no probability between 0 and 1, such as 0.95")
    return float(-2.0 * np.log1p(-confidence))


def ellipse_outlines(centres: Array, covariances: Array, confidence: float = 0.95) -> Array:
    """Outlines ``(K, 40, 2)`` of the ellipses that hold each position with a probability.

    Args:
        centres: ``(K, 2)`` means.
        covariances: ``(K, 2, 2)`` in the same frame.
        confidence: the probability.

    Raises:
        InputError: a confidence that is no probability.
    """
    values, vectors = np.linalg.eigh(covariances)
    half_axes = vectors * np.sqrt(squared_radius(confidence) * np.maximum(values, 0.0))[:, None, :]
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centres[:, None, :] + np.einsum("kij,jn->kni", half_axes, circle), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Ellipses:
    """Ellipses chosen to be read.

    Attributes:
        outlines: ``(K, 40, 2)``.
        magnification: how many times they are drawn larger than they are.
        confidence: probability that a position lies within its ellipse, as it is.
        count: of the positions from which they were chosen.
    """

    outlines: Array
    magnification: float
    confidence: float
    count: int

    @property
    def label(self) -> str:
        """What a legend says of them."""
        larger = "" if self.magnification == 1.0 else f", drawn {self.magnification:g} times larger"
        some = "" if len(self.outlines) == self.count else f" of {len(self.outlines):,} among {self.count:,}"
        return f"{100.0 * self.confidence:g} % ellipses{some}{larger}"


def readable_ellipses(
    centres: Array, covariances: Array, pixels_per_metre: float, confidence: float = 0.95
) -> Ellipses:
    """Ellipses that are large enough to see, and few enough to see what lies below.

    All are magnified by one round factor if the largest would be a dot, and those that would hide one that is
    drawn are left out.

    Args:
        centres: ``(N, 2)`` means, world frame; along a path.
        covariances: ``(N, 2, 2)`` in the world frame.
        pixels_per_metre: scale of the picture.
        confidence: probability that a position lies within its ellipse.

    Raises:
        InputError: a confidence that is no probability.
    """
    longest = np.sqrt(squared_radius(confidence) * np.maximum(np.linalg.eigvalsh(covariances)[:, 1], 0.0))
    largest = float(longest.max(initial=0.0)) * pixels_per_metre
    magnification = 1.0
    if 0.0 < largest < _TOO_SMALL:
        power = 10.0 ** np.floor(np.log10(_READABLE / largest))
        magnification = float(max(n * power for n in (1.0, 2.0, 5.0) if n * power * largest <= _READABLE))
    chosen = _apart(centres, longest * magnification)
    outlines = ellipse_outlines(centres[chosen], covariances[chosen] * magnification**2, confidence=confidence)
    return Ellipses(outlines, magnification, confidence, len(centres))


def _apart(centres: Array, radii: Array) -> NDArray[np.int64]:
    """Positions along a path whose circles stay apart, spread over it where there are many."""
    candidates = np.arange(0, len(centres), max(1, -(-len(centres) // _CANDIDATES)))
    kept: list[int] = []
    for candidate in candidates.tolist():
        distance = np.linalg.norm(centres[kept] - centres[candidate], axis=1)
        if (distance > _APART * (radii[kept] + radii[candidate])).all():
            kept.append(candidate)
    every = max(1, -(-len(kept) // _MOST))
    return np.array(kept[::every], dtype=np.int64)


def ellipse_collection(outlines: Array, color: str) -> PolyCollection:
    """The outlines ``(K, n, 2)``, to be added to axes."""
    return PolyCollection(list(outlines), facecolors="none", edgecolors=color, linewidths=0.8, alpha=0.9,
                          zorder=7)
