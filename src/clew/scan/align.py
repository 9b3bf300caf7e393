"""Alignment of point clouds to sub-cell precision: point to line, robust, with a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.geometry import se2
from clew.scan.index import IndexedClouds, SourceClouds

Array = NDArray[np.float64]

LEAST_SHARE = 1e-6  # of the information that is left in any direction
TINY = 1e-300
LEAST_SPREAD = 0.01  # metres; of returns about their mean
PROBE = 0.08  # metres; beyond the side of a surfel, so that partners change
NUDGE = 0.005  # metres; about as far as alignments err
LONG = 0.3  # share of the strongest direction's information from which on the weakest one is believed as it is
LEAST_CURVATURE = 0.01  # share of the information that is left at least
PINNED = 1e12  # information of a prior that holds a pose where it is


@dataclass(frozen=True)
class AlignmentOptions:
    """How correspondences are sought and weighted.

    Attributes:
        radius_start, radius_end: metres; the search for partners narrows from the first to the second.
        sigma: standard deviation of a return about its surface, metres.
        robust: scale of the Cauchy weights, in sigmas.
        facing: least cosine between the normals of two partners.
        iterations: Gauss-Newton steps at most.
        correlated: returns next to each other within this distance may have errors in common, metres: those of a
            surface and of the place where the target has it. 0: what residuals tell of errors is left out.
    """

    radius_start: float = 0.4
    radius_end: float = 0.12
    sigma: float = 0.015
    robust: float = 2.0
    facing: float = 0.7
    iterations: int = 20
    correlated: float = 0.3


@dataclass(frozen=True)
class Alignment:
    """Poses of sources in the frames of their targets, one row a pair.

    Attributes:
        T_target_source: ``(P, 3)``.
        information: ``(P, 3, 3)`` of the returns alone, in the tangent of the pose; nearly singular along a corridor.
        step: ``(P, 3)`` tangent step from the pose to the optimum of the returns alone (zero without a prior).
        overlap: ``(P,)`` share of the source's points that found a partner within ``radius_end``.
        rms: ``(P,)`` residual along the normals, metres.
        correlation: ``(P,)`` sum of the residuals' autocorrelation along the scan: by so much the variance of a sum of
            them is larger than that of independent ones, which have one (Newey, West 1987).
        variance: ``(P,)`` of a return with what it has in common with those beside it, metres^2.
        push: ``(P, 3, 3)`` covariance of the gradient (`information` times a step) by these residuals,
        spread: ``(P, 3, 3)`` and for independent ones with a variance of one square metre.
    """

    T_target_source: Array
    information: Array
    step: Array
    overlap: Array
    rms: Array
    correlation: Array
    variance: Array
    push: Array
    spread: Array


def align(
    targets: IndexedClouds,
    sources: SourceClouds,
    pairs: NDArray[np.int32],
    T_start: Array,
    *,
    T_prior: Array | None = None,
    prior_information: Array | None = None,
    options: AlignmentOptions | None = None,
    threads: int = 1,
) -> Alignment:
    """Align sources with targets, from `T_start`, point to line (Censi, ICRA 2008).

    Args:
        targets: indexed clouds that hold still.
        sources: clouds that move.
        pairs: ``(P, 2)`` index of the target, index of the source.
        T_start: ``(P, 3)`` first guess of ``T_target_source``.
        T_prior: ``(P, 3)`` mean of a Gaussian prior; `T_start` unless given.
        prior_information: ``(P, 3, 3)``; none unless given.
        options: see `AlignmentOptions`.
        threads: how many threads share the pairs; the result does not depend on it.
    """
    o = options or AlignmentOptions()
    count = pairs.shape[0]
    start = np.ascontiguousarray(T_start, dtype=np.float64)
    prior = start if T_prior is None else np.ascontiguousarray(T_prior, dtype=np.float64)
    if prior_information is None:
        prior_information = np.zeros((count, 3, 3))
    s = sources.cloud
    return Alignment(
        *_native.scan.align(
            targets.entries, targets.offsets, targets.starts, targets.starts_offsets, targets.origins, targets.shapes,
            targets.cells,
            s.points, s.normals, s.weights, sources.offsets,
            np.ascontiguousarray(pairs, dtype=np.int32), start, prior,
            np.ascontiguousarray(prior_information, dtype=np.float64),
            o.radius_start, o.radius_end, o.sigma, o.robust, o.facing, o.iterations, o.correlated, threads,
        )
    )  # fmt: skip


def without_normal_noise(information: Array, variance: float, moments: Array | None = None) -> Array:
    """Information ``(..., 3, 3)`` of alignments without what noise of the normals seems to add to it.

    Each return adds ``n n^T`` of its normal. A normal that is off by a small angle has a part along the surface, which
    its square counts as information: on average ``variance * t t^T``, ``t`` along the surface. Over a bare corridor of
    some hundred returns it would seem to tell how far along the robot is, and about a lone round pillar, from which
    side it is seen.

    Args:
        information: in the tangent of the pose.
        variance: of the direction of a normal, radians^2.
        moments: ``(..., 3)`` of the returns that were moved (`SourceClouds.moments`); without them turns are left as
            they are.
    """
    if moments is None:
        scale = np.zeros_like(information)
        values, vectors = np.linalg.eigh(information[..., :2, :2])
        root = np.sqrt(_share(values, values[..., ::-1], variance))
        scale[..., :2, :2] = (vectors * root[..., None, :]) @ np.swapaxes(vectors, -1, -2)
        scale[..., 2, 2] = 1.0
        return np.asarray(scale @ information @ scale)
    # What as many returns would tell that were seen from all sides, about as far from the robot.
    total = np.zeros_like(information)
    total[..., 0, 0] = total[..., 1, 1] = 1.0
    total[..., 0, 2] = total[..., 2, 0] = -moments[..., 1]
    total[..., 1, 2] = total[..., 2, 1] = moments[..., 0]
    total[..., 2, 2] = moments[..., 2] + LEAST_SPREAD**2
    whiten = np.linalg.inv(np.linalg.cholesky(total))
    values, vectors = np.linalg.eigh(whiten @ information @ np.swapaxes(whiten, -1, -2))
    values = np.maximum(values, 0.0)
    returns = information[..., 0, 0] + information[..., 1, 1]
    along = np.maximum(returns[..., None] - values, 0.0)
    kept = values * _share(values, along, variance)
    back = np.linalg.inv(whiten) @ (vectors * np.sqrt(kept)[..., None, :])
    return np.asarray(back @ np.swapaxes(back, -1, -2))


def _share(across: Array, along: Array, variance: float) -> Array:
    """What is left of information by normals, where returns would hold `along` with normals turned by 90 degrees."""
    return np.asarray(np.clip((across - variance * along) / np.maximum(across, TINY), LEAST_SHARE, 1.0))


def with_new_partners(
    targets: IndexedClouds,
    sources: SourceClouds,
    pairs: NDArray[np.int32],
    T_target_source: Array,
    information: Array,
    options: AlignmentOptions,
    threads: int = 1,
    *,
    worth: Array | None = None,
    already: float = 1.0,
) -> Array:
    """Information ``(P, 3, 3)`` of alignments without what holds only while their partners stay the same.

    Along a corridor with a few shallow edges, each smeared over some centimetres in the map, returns that slide find
    others to lie on: the error hardly grows, though each pair of partners seems to hold the pose. Instead of the
    curvature at fixed partners the weakest direction gets that of the error with partners sought anew, by the gradients
    on both sides of the pose, where it is less.

    Args:
        targets, sources, pairs: as in `align`.
        T_target_source: ``(P, 3)`` where the alignments ended.
        information: ``(P, 3, 3)`` that they had there.
        options: of the alignments.
        threads: how many share the pairs.
        worth: ``(P, 3, 3)`` what that is worth, which is then returned without what does not hold,
        already: and share of the slope that was taken for the same reason in all directions (`slope_share`).
    """
    values, vectors = np.linalg.eigh(information[:, :2, :2])
    weak = np.flatnonzero(values[:, 0] <= LONG * values[:, 1])
    out = np.array(information if worth is None else worth, dtype=np.float64)
    if not len(weak):
        return out
    values, vectors = values[weak], vectors[weak]
    weakest = np.concatenate([vectors[:, :, 0], np.zeros((len(weak), 1))], axis=1)
    curvature = _curvature(targets, sources, pairs[weak], T_target_source[weak], weakest, PROBE, options, threads)
    share = np.clip(curvature / np.maximum(already * values[:, 0], TINY), LEAST_CURVATURE, 1.0)
    scale = np.zeros((len(weak), 3, 3))
    scale[:, :2, :2] = (vectors * np.sqrt(np.stack([share, np.ones_like(share)], axis=1))[:, None]) @ np.swapaxes(
        vectors, 1, 2
    )
    scale[:, 2, 2] = 1.0
    out[weak] = scale @ out[weak] @ scale
    return out


def slope_share(
    targets: IndexedClouds,
    sources: SourceClouds,
    pairs: NDArray[np.int32],
    T_target_source: Array,
    information: Array,
    options: AlignmentOptions,
    threads: int = 1,
) -> Array:
    """How much less alignments resist being moved than their information says, ``(P,)``, with partners sought anew.

    A target as thick as its noise has a point near each return wherever it is moved, and robust weights fall as
    residuals grow. Both make the error less steep. Pushed about by their noise, poses err by that much more.

    Args:
        targets, sources, pairs: as in `align`.
        T_target_source: ``(P, 3)`` where the alignments ended.
        information: ``(P, 3, 3)`` that they had there.
        options: of the alignments.
        threads: how many share the pairs.
    """
    total = np.zeros(len(pairs))
    for axis in np.eye(3)[:2]:
        direction = np.broadcast_to(axis, (len(pairs), 3))
        total += _curvature(targets, sources, pairs, T_target_source, direction, NUDGE, options, threads)
    return np.asarray(total / np.maximum(information[:, 0, 0] + information[:, 1, 1], TINY))


def _curvature(
    targets: IndexedClouds, sources: SourceClouds, pairs: NDArray[np.int32], T_target_source: Array, direction: Array,
    distance: float, options: AlignmentOptions, threads: int,
) -> Array:
    """Of the error along a direction ``(P, 3)`` of the tangent, by the gradients on both sides of the pose."""
    sides = distance * np.stack([direction, -direction], axis=1)
    at_ends = align(
        targets, sources, np.repeat(pairs, 2, axis=0),
        se2.compose(T_target_source[:, None], sides).reshape(-1, 3),
        prior_information=np.broadcast_to(PINNED * np.eye(3), (2 * len(pairs), 3, 3)),
        options=replace(options, radius_start=options.radius_end, iterations=1, correlated=0.0), threads=threads,
    )  # fmt: skip
    gradients = -np.einsum("nij,nj->ni", at_ends.information, at_ends.step).reshape(-1, 2, 3)
    return np.asarray(np.einsum("ni,ni->n", gradients[:, 0] - gradients[:, 1], direction) / (2.0 * distance))
