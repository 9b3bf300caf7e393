"""Appearance of a place, whichever way the robot faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RINGS = 12
SECTORS = 64
REACH = 12.0  # metres
HARMONICS = 17


def describe(points: Array) -> Array:
    """Rotation-invariant descriptor ``(d,)`` of unit length of points ``(n, 2)`` about the origin.

    The plane is cut into rings and sectors (as in Kim & Kim, "Scan Context", IROS 2018); what is kept of each ring are
    the magnitudes of its Fourier coefficients over the sectors, which a rotation does not change (as in Granström et
    al. for laser scans). Occupied sectors count, not points, so that density of the beams does not matter.
    """
    distance = np.hypot(points[:, 0], points[:, 1])
    inside = (distance < REACH) & (distance > 1e-6)
    ring = np.minimum(distance[inside] / REACH * RINGS, RINGS - 1).astype(np.int64)
    angle = np.arctan2(points[inside, 1], points[inside, 0])
    sector = np.floor((angle + np.pi) / (2 * np.pi) * SECTORS).astype(np.int64) % SECTORS
    occupied = np.zeros((RINGS, SECTORS))
    occupied[ring, sector] = 1.0
    spectrum = np.abs(np.fft.rfft(occupied, axis=1))[:, :HARMONICS]
    descriptor = spectrum.ravel()
    norm = float(np.linalg.norm(descriptor))
    return np.asarray(descriptor / norm if norm > 0 else descriptor, dtype=np.float64)


def similarity(a: Array, b: Array) -> Array:
    """Cosine in [0, 1] between descriptors ``(..., d)``."""
    return np.asarray(np.sum(a * b, axis=-1), dtype=np.float64)
