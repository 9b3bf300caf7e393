"""Information matrices as graph files hold them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.geometry import SE2, SE3
from clew.noise import indefinite

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def from_triangle(triangle: Array, size: int) -> Array:
    """Symmetric matrices ``(M, size, size)`` from upper triangles, ``(M, size (size + 1) / 2)``."""
    rows, columns = np.triu_indices(size)
    full = np.empty((len(triangle), size, size))
    full[:, rows, columns] = triangle
    full[:, columns, rows] = triangle
    return full


def to_triangle(information: Array) -> Array:
    """Upper triangles of symmetric matrices; the inverse of `from_triangle`."""
    rows, columns = np.triu_indices(information.shape[-1])
    return np.asarray(information[:, rows, columns])


def scale_rotation(information: Array, factor: float) -> Array:
    """SE3 information whose rotation errors are measured in units `factor` times as long."""
    scale = np.array([1.0, 1.0, 1.0, factor, factor, factor])
    return np.asarray(information * scale[:, None] * scale)


def reduce_indefinite(information: Array, kind: type[Any]) -> tuple[Array, Indices, Indices]:
    """Make indefinite information usable, as SE-Sync does: by its translation and rotation blocks alone.

    Args:
        information: ``(M, d, d)`` symmetric.
        kind: manifold of the first variable; of pose information ``(M, dim, dim)`` the blocks are known.

    Returns:
        The matrices, the rows that were reduced, and the rows that cannot be helped.
    """
    bad = indefinite(information)
    if len(bad) == 0 or kind not in (SE2, SE3) or information.shape[-1] != kind.dim:
        return information, bad[:0], bad
    reduced = information.copy()
    space = kind.space
    reduced[bad, :space, space:] = 0.0
    reduced[bad, space:, :space] = 0.0
    hopeless = bad[indefinite(reduced[bad])]
    return reduced, bad, hopeless
