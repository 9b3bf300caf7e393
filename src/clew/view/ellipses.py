"""Covariances of positions as ellipses."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Squared Mahalanobis distance within which a position of two coordinates lies with probability 0.95.
CHI2_95 = 5.991464547107979
_CORNERS = 40


def ellipse_outlines(centres: Array, covariances: Array, headings: Array | None = None) -> Array:
    """Outlines ``(K, 40, 2)`` of the ellipses that hold 95 % of each position.

    Args:
        centres: ``(K, 2)`` means, world frame.
        covariances: ``(K, 2, 2)`` covariances in the world frame or, with `headings`, in the poses' frames.
        headings: ``(K,)`` directions of the poses, radians.
    """
    values, vectors = np.linalg.eigh(covariances)
    half_axes = vectors * np.sqrt(CHI2_95 * np.maximum(values, 0.0))[:, None, :]
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    outlines = np.einsum("kij,jn->kni", half_axes, circle)
    if headings is not None:
        cos, sin = np.cos(headings), np.sin(headings)
        rotation = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), -1, 0)
        outlines = np.einsum("kij,knj->kni", rotation, outlines)
    return np.asarray(centres[:, None, :] + outlines, dtype=np.float64)


def ellipse_collection(outlines: Array, color: str) -> PolyCollection:
    """The outlines ``(K, n, 2)``, to be added to axes."""
    return PolyCollection(list(outlines), facecolors="none", edgecolors=color, linewidths=0.7, alpha=0.8,
                          zorder=7)
