"""Readings at a high rate become one relative pose between two keyframes, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry import se2

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Pieces:
    """Readings that hold from their time to the next one's, cut at the keyframes.

    Attributes:
        timestamp: ``(N,)`` begin of each piece, seconds.
        duration: ``(N,)`` seconds.
        reading: ``(N,)`` index of the reading that holds, -1 before the first one.
        first: ``(S,)`` first piece of each stretch between two keyframes.
    """

    timestamp: Array
    duration: Array
    reading: Index
    first: Index


def cut(timestamps: ArrayLike, keyframes: ArrayLike) -> Pieces:
    """Cut readings at ``(M,)`` times (each holds until the next) into the stretches between ``(S + 1,)`` keyframes.

    Raises:
        InputError: fewer than two keyframes, times that are not finite or do not increase.
    """
    stamps, frames = np.asarray(timestamps, np.float64), np.asarray(keyframes, np.float64)
    if stamps.ndim != 1 or not np.isfinite(stamps).all() or (np.diff(stamps) < 0.0).any():
        raise InputError("cut: the times of the readings must be finite and in order; sort them")
    if frames.ndim != 1 or len(frames) < 2 or not np.isfinite(frames).all() or (np.diff(frames) <= 0.0).any():
        raise InputError("cut: give at least two keyframes, at finite times that increase")
    inner = stamps[(stamps > frames[0]) & (stamps < frames[-1])]
    edges = np.unique(np.concatenate([inner, frames]))
    reading = np.searchsorted(stamps, edges[:-1], side="right") - 1
    return Pieces(edges[:-1], np.diff(edges), reading, np.searchsorted(edges, frames[:-1]))


@dataclass(frozen=True, eq=False)
class Preintegrated:
    """Relative poses between keyframes.

    Attributes:
        motion: ``(S, 3)`` later keyframe seen from the earlier one.
        to_end: ``(N, 3, 3)`` takes the tangent at the end of each increment to that at the end of its stretch.
        stretch: ``(N,)`` stretch of each increment.
    """

    motion: Array
    to_end: Array
    stretch: Index

    def covariance(self, covariances: Array) -> Array:
        """Covariance ``(S, 3, 3)`` at the end of each stretch from those of independent increments ``(N, 3, 3)``."""
        return self._sum(self.to_end @ covariances @ np.swapaxes(self.to_end, 1, 2))

    def diagonal_covariance(self, variances: Array) -> Array:
        """Covariances ``(K, S, 3, 3)`` as `covariance` has them, from diagonal ones ``(K, N, 3)``."""
        columns = np.swapaxes(self.to_end, 1, 2)
        outer = columns[:, :, :, None] * columns[:, :, None, :]
        return np.stack([self._sum(np.einsum("ni,nijk->njk", each, outer)) for each in variances])

    def jacobian(self, by_parameter: Array) -> Array:
        """Derivative ``(S, 3, p)`` of each stretch by parameters that all increments share, from ``(N, 3, p)``."""
        return self._sum(self.to_end @ by_parameter)

    def _sum(self, terms: Array) -> Array:
        first = np.searchsorted(self.stretch, np.arange(len(self.motion)))
        total: Array = np.add.reduceat(terms, first, axis=0)
        return total


def preintegrate(increments: Array, first: Index) -> Preintegrated:
    """Compose increments ``(N, 3)`` stretch by stretch; stretch ``s`` begins with increment ``first[s]``.

    Errors are carried to the end of each stretch by adjoints, to first order; the tangent there is that of `retract`
    (Forster et al. 2017, "On-manifold preintegration", section VI, in the plane). Everything is a sum, because
    headings in the plane add up: no loop over the increments.

    Raises:
        InputError: no increment, or stretches that are empty or out of order.
    """
    if len(increments) == 0 or len(first) == 0 or first[0] != 0 or (np.diff(first) <= 0).any():
        raise InputError("preintegrate: each stretch needs an increment, and the first begins with increment 0")
    if first[-1] >= len(increments):
        raise InputError(f"preintegrate: stretch {len(first) - 1} begins behind the last increment")
    poses = np.zeros((len(increments) + 1, 3))
    poses[1:, 2] = np.cumsum(increments[:, 2])
    cos, sin = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    x, y = increments[:, 0], increments[:, 1]
    poses[1:, 0] = np.cumsum(cos * x - sin * y)
    poses[1:, 1] = np.cumsum(sin * x + cos * y)
    bounds = np.append(first, len(increments))
    stretch = np.repeat(np.arange(len(first)), np.diff(bounds))
    end = poses[bounds[1:]]
    to_end = se2.adjoint(se2.between(end[stretch], poses[1:]))
    return Preintegrated(se2.between(poses[first], end), to_end, stretch)
