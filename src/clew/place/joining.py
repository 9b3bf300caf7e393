"""Which landmarks of a map are one? Sets of pairs that hold together, judged against chance.

After a loop the same landmarks stand in the map twice, off by whatever the robot had drifted. One pair near each other
proves little; but once a pair is taken for one landmark, the joint covariance says where the others must be, and each
that is found there adds evidence (joint compatibility as in Neira & Tardós 2001, between landmarks of one map).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.place.association import chi_square_limit

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_MOST_SEEDS = 60  # pairs from which a set is grown, the likeliest first
_JITTER = 1e-9  # square metres; keeps exactly equal landmarks from dividing by zero


@dataclass(frozen=True)
class JoinOptions:
    """When landmarks are taken for one.

    Attributes:
        probability: of the chi-square gate of a pair.
        odds: how much likelier a set of pairs must be than that all of them stand so by chance.
        rival_odds: how much likelier than any other set that contradicts it.
    """

    probability: float = 0.999
    odds: float = 100.0
    rival_odds: float = 100.0


@dataclass(frozen=True)
class _Hypothesis:
    pairs: tuple[tuple[int, int], ...]
    evidence: float

    def contradicts(self, other: _Hypothesis, apart: Flags) -> bool:
        """Whether the two give a landmark two partners that are not one themselves."""
        mine, theirs = _partners(self), _partners(other)
        return any(
            apart[a, b] for key in mine.keys() & theirs.keys() for a in mine[key] for b in theirs[key] if a != b
        )


def landmark_density(points: Array) -> float:
    """Landmarks a square metre where landmarks are, from the distances ``d`` of ``(L, 2)`` points to their nearest.

    Were they scattered evenly, half of all would have ``pi d^2`` times the density below ``ln 2``.
    """
    if len(points) < 2:
        return 0.0
    distances, _ = cKDTree(points).query(points, k=[2])
    nearest = np.asarray(distances)
    return float(np.log(2.0) / (np.pi * max(np.median(nearest) ** 2, 1e-9)))


def join_landmarks(
    points: Array, covariance: Array, apart: Flags, density: float, options: JoinOptions | None = None
) -> list[tuple[int, int]]:
    """Pairs of landmarks that are one, as far as that is clear; empty if nothing is.

    Args:
        points: ``(L, 2)`` positions.
        covariance: ``(2 L, 2 L)`` of all of them jointly.
        apart: ``(L, L)`` whether two are known to be different, for they were seen at the same moment.
        density: landmarks a square metre, see `landmark_density`.
        options: see `JoinOptions`.
    """
    options = options or JoinOptions()
    gate = chi_square_limit(options.probability, 2)
    first, second, evidence = _evidence(points, covariance, apart, density, gate)
    # what is in no pair plays no part
    some = np.unique(np.concatenate([first, second]))
    first, second = np.searchsorted(some, first), np.searchsorted(some, second)
    scalars = (2 * some[:, None] + np.arange(2)).reshape(-1)
    points, covariance, apart = points[some], covariance[np.ix_(scalars, scalars)], apart[np.ix_(some, some)]
    hypotheses: list[_Hypothesis] = []
    tried: set[tuple[int, int]] = set()
    for seed in np.argsort(-evidence, kind="stable")[:_MOST_SEEDS].tolist():
        pair = (int(first[seed]), int(second[seed]))
        if pair not in tried:
            grown = _grow(pair, float(evidence[seed]), points, covariance, apart, density, gate)
            tried.update(grown.pairs)
            hypotheses.append(grown)
    least, margin = np.log(options.odds), np.log(options.rival_odds)
    chosen: list[_Hypothesis] = []
    for h in sorted(hypotheses, key=lambda h: -h.evidence):
        if h.evidence < least:
            break
        rivals = [o for o in hypotheses if o is not h and o.evidence > h.evidence - margin]
        if not any(h.contradicts(o, apart) for o in rivals):
            chosen.append(h)
            break  # the rest is judged again when this has moved the map
    return [(int(some[a]), int(some[b])) for h in chosen for a, b in h.pairs]


def _evidence(
    points: Array, covariance: Array, apart: Flags, density: float, gate: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Pairs that pass the gate, and how much likelier each is one landmark than two (logarithm)."""
    first, second = np.nonzero(np.triu(~apart, 1))
    count = len(points)
    blocks = covariance.reshape(count, 2, count, 2)
    cross = blocks[first, :, second]
    spread = blocks[first, :, first] + blocks[second, :, second] - cross - np.swapaxes(cross, 1, 2)
    xx, xy, yy = spread[:, 0, 0] + _JITTER, spread[:, 0, 1], spread[:, 1, 1] + _JITTER
    determinant = np.maximum(xx * yy - xy * xy, _JITTER**2)
    dx, dy = (points[first] - points[second]).T
    distance = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / determinant
    evidence = -0.5 * (distance + np.log(4.0 * np.pi**2 * determinant)) - np.log(density)
    near = distance <= gate
    return first[near], second[near], evidence[near]


def _grow(
    pair: tuple[int, int], evidence: float, points: Array, covariance: Array, apart: Flags, density: float, gate: float
) -> _Hypothesis:
    """Take a pair for one, then again and again the likeliest pair, as long as it is likelier one than two."""
    pairs, total = [pair], evidence
    points, covariance, apart = points.copy(), covariance.copy(), apart.copy()
    while True:
        kept, gone = pairs[-1]
        points, covariance = _condition(points, covariance, kept, gone)
        apart[kept] |= apart[gone]
        apart[:, kept] |= apart[:, gone]
        apart[gone] = apart[:, gone] = True  # it is the other now
        first, second, more = _evidence(points, covariance, apart, density, gate)
        if not len(more) or more.max() <= 0.0:
            return _Hypothesis(tuple(pairs), total)
        best = int(more.argmax())
        pairs.append((int(first[best]), int(second[best])))
        total += float(more[best])


def _condition(points: Array, covariance: Array, a: int, b: int) -> tuple[Array, Array]:
    """The Gaussian given that landmarks `a` and `b` are at one place."""
    at, of = slice(2 * a, 2 * a + 2), slice(2 * b, 2 * b + 2)
    apart = covariance[:, at] - covariance[:, of]
    spread = apart[at] - apart[of] + _JITTER * np.eye(2)
    gain = apart @ np.linalg.inv(spread)
    moved = points - (gain @ (points[a] - points[b])).reshape(-1, 2)
    return moved, covariance - gain @ apart.T


def _partners(hypothesis: _Hypothesis) -> dict[int, set[int]]:
    partners: dict[int, set[int]] = {}
    for a, b in hypothesis.pairs:
        partners.setdefault(a, set()).add(b)
        partners.setdefault(b, set()).add(a)
    return partners
