"""Correlative matching: the best pose in a window, found exactly (Olson, ICRA 2009; Hess et al., ICRA 2016)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew import _native

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LikelihoodPyramid:
    """How likely a return is in each cell about a cloud, and its maxima over squares of growing size.

    Attributes:
        cells: ``(levels, height, width)`` uint8; level ``l`` at a cell is the maximum of level 0 over the
            ``2^l x 2^l`` cells from it upwards, so that a coarse level bounds the score of a whole square of offsets.
        origin: ``(2,)`` outer corner of cell (0, 0), metres in the cloud's frame.
        resolution: metres a cell.
    """

    cells: NDArray[np.uint8]
    origin: Array
    resolution: float


@dataclass(frozen=True)
class CorrelativeMatch:
    """Best pose of a search.

    Attributes:
        T_target_source: ``(3,)``.
        score: mean likelihood of the points minus the penalty of the prior.
        likelihood: mean likelihood of the points in [0, 1].
    """

    T_target_source: Array
    score: float
    likelihood: float


def build_pyramid(points: Array, *, resolution: float, sigma: float, levels: int) -> LikelihoodPyramid:
    """Likelihood pyramid of points ``(n, 2)``; `sigma` is the blur about each, metres."""
    margin = (1 << (levels - 1)) + int(np.ceil(2.5 * sigma / resolution)) + 1
    corners = points if len(points) else np.zeros((1, 2))
    low = np.floor(corners.min(axis=0) / resolution).astype(np.int64) - margin
    high = np.floor(corners.max(axis=0) / resolution).astype(np.int64) + margin + 1
    width, height = (int(v) for v in high - low)
    origin = low * resolution
    cells = _native.scan.build_pyramid(
        points, sigma, levels, height, width, float(origin[0]), float(origin[1]), resolution
    )
    return LikelihoodPyramid(cells, origin, resolution)


def correlate(
    pyramid: LikelihoodPyramid,
    points: Array,
    centre: Array,
    half_window: Array,
    *,
    step_theta: float | None = None,
    prior_sigmas: Array | None = None,
    prior_weight: float = 0.0,
    minimum_score: float = 0.0,
    exclude: tuple[Array, float, float] | None = None,
) -> CorrelativeMatch | None:
    """Pose of `points` ``(n, 2)`` with the best score in a window, or None if none reaches `minimum_score`.

    Args:
        pyramid: likelihood about the target.
        points: the source, in its own frame.
        centre: ``(3,)`` pose in the middle of the window.
        half_window: ``(3,)`` metres, metres, radians on each side.
        step_theta: radians between angles; by default the far points move by one cell.
        prior_sigmas: ``(3,)`` scales ``s`` of a Cauchy prior about `centre`: an offset ``d`` costs
            ``prior_weight * log(1 + |d / s|^2 / 2)``. Its heavy tails let a good match overrule slipping wheels.
        minimum_score: poses below are of no interest; the higher, the faster the search.
        exclude: pose, distance and angle of a neighbourhood to leave out (to ask for the second-best peak).
    """
    if step_theta is None:
        distance = np.hypot(points[:, 0], points[:, 1])
        far = (9 * len(points)) // 10
        reach = float(np.partition(distance, far)[far]) if len(points) else 1.0
        step_theta = min(max(pyramid.resolution / max(reach, 1e-3), 0.002), 0.05)
    excluded, rival_distance, rival_angle = exclude if exclude is not None else (np.zeros(0), 0.0, 0.0)
    found, pose, score, likelihood, _ = _native.scan.correlate(
        pyramid.cells, float(pyramid.origin[0]), float(pyramid.origin[1]), pyramid.resolution, points,
        np.asarray(centre, dtype=np.float64), np.asarray(half_window, dtype=np.float64), step_theta,
        np.full(3, np.inf) if prior_sigmas is None else np.asarray(prior_sigmas, dtype=np.float64),
        prior_weight, minimum_score, excluded, rival_distance, rival_angle,
    )  # fmt: skip
    return CorrelativeMatch(pose, score, likelihood) if found else None
