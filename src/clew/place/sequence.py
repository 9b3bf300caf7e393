"""Where along a corridor? What one match cannot tell, several in a row on the same stretch of way tell together.

Along a corridor with little in it every match fits at many poses: a cabinet is a few returns among hundreds on the bare
walls. How well each fits at offsets along its line, and how far the robot may have come from one to the next, is a
hidden Markov model; the forward-backward algorithm (Rabiner 1989) gives the probability of each offset of each match by
all of them. It is the sequence of matches that is unique, not any of them (as in SeqSLAM: Milford, Wyeth 2012).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from clew.geometry import se2
from clew.place.submap import SEARCH_REACH, Submap

Array = NDArray[np.float64]

LEAST_POINTS = 20
ANYWHERE = 0.05  # likelihood of a return where nothing is, as a share of that on a surface
TEMPER = 0.5  # neighbouring matches see the same things: each of them counts for less


def evidence_along(submap: Submap, points: Array, T_target_source: Array, direction: Array, offsets: Array) -> Array:
    """Log likelihood ``(S,)``, but for a constant, of a match at offsets along a line.

    Only points that lie where the submap has looked at all offsets have a say; otherwise the match would be drawn to
    where most of it overlaps.

    Args:
        submap: the older place.
        points: ``(n, 2)`` of the source, in its frame, thinned so that each tells something of its own.
        T_target_source: ``(3,)`` where the source is at no offset.
        direction: ``(2,)`` of the line, in the submap's frame.
        offsets: ``(S,)`` metres, rising.
    """
    here = se2.act(T_target_source, points)
    seen = np.ones(len(points), dtype=np.bool_)
    for offset in (offsets[0], 0.0, offsets[-1]):
        there = here + offset * direction
        seen &= submap.observes(there) & (np.hypot(there[:, 0], there[:, 1]) < SEARCH_REACH)
    if np.count_nonzero(seen) < LEAST_POINTS:
        return np.zeros(len(offsets))
    moved = here[seen][None] + offsets[:, None, None] * direction
    likelihoods = submap.likelihoods(moved.reshape(-1, 2)).reshape(len(offsets), -1)
    return np.asarray(TEMPER * np.log(ANYWHERE + (1.0 - ANYWHERE) * likelihoods).sum(axis=1))


def along_all(
    evidence: Array, variances: Array | Sequence[float], offsets: Array, prior: Array | None = None
) -> tuple[Array, Array]:
    """Probability ``(n, S)`` of each offset of each match by all of them, and by all others alone.

    Args:
        evidence: ``(n, S)`` log likelihoods.
        variances: ``(n - 1,)`` by how much the offset may change from one match to the next, square metres.
        offsets: ``(S,)`` metres.
        prior: ``(S,)`` logarithm of what is known of the first beforehand, which is none of its evidence; nothing by
            default.
    """
    spread = -0.5 * np.square(offsets[:, None] - offsets)
    least = 0.25 * float(offsets[1] - offsets[0]) ** 2
    steps = [_normalised(spread / max(float(v), least)) for v in variances]
    before, after = np.zeros_like(evidence), np.zeros_like(evidence)
    if prior is not None:
        before[0] = prior
    for k, step in enumerate(steps):
        before[k + 1] = logsumexp((before[k] + evidence[k])[:, None] + step, axis=0)
    for k in range(len(steps) - 1, -1, -1):
        after[k] = logsumexp(steps[k] + (evidence[k + 1] + after[k + 1])[None], axis=1)
    others = before + after
    return np.exp(_normalised(others + evidence)), np.exp(_normalised(others))


def blurred(evidence: Array, variance: float, offsets: Array) -> Array:
    """Log likelihood ``(S,)`` of one that is off by an error of its own besides."""
    step = -0.5 * np.square(offsets[:, None] - offsets) / max(variance, 1e-9)
    return np.asarray(logsumexp(evidence + _normalised(step), axis=1))


def told(probability: Array, others: Array, offsets: Array) -> tuple[float, float]:
    """What a match tells by itself where the others say what it may be: offset and variance, infinite where nothing.

    The Gaussian that takes what the others say to what all say (expectation propagation: Minka 2001). Fed to a
    graph that knows the way between the matches, it counts nothing twice.

    Args:
        probability: ``(S,)`` by all,
        others: ``(S,)`` and by the others.
        offsets: ``(S,)`` metres.
    """
    (mean, variance), (mean_others, variance_others) = (_moments(p, offsets) for p in (probability, others))
    precision = 1.0 / variance - 1.0 / variance_others
    if precision <= 0.0:
        return 0.0, np.inf
    return (mean / variance - mean_others / variance_others) / precision, 1.0 / precision


def _moments(probability: Array, offsets: Array) -> tuple[float, float]:
    mean = float(probability @ offsets)
    return mean, float(probability @ np.square(offsets - mean)) + float(offsets[1] - offsets[0]) ** 2


def _normalised(log: Array) -> Array:
    """So that the rows ``(..., S)`` are logarithms of probabilities."""
    return np.asarray(log - logsumexp(log, axis=-1, keepdims=True))
