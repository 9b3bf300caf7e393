"""Which landmarks of a map are one? Sets of pairs that hold together, judged against chance.

After a loop the same landmarks stand in the map twice, off by whatever the robot had drifted. One pair near each other
proves little; but once a pair is taken for one landmark, the joint covariance says where the others must be, and each
that is found there adds evidence (joint compatibility as in Neira & Tardós 2001, between landmarks of one map).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.place.association import chi_square_limit, determinant, squared_distance
from clew.place.conditioned import Conditioned

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

_LOG = logging.getLogger(__name__)

_MOST_SEEDS = 60  # pairs from which a set is grown, the likeliest first
_MOST_PAIRS = 100  # of a set; the rest is found once it has moved the map
_MOST_WORK = 2_000_000  # pairs that are looked at in growing sets, each as often as a pair was added
_MOST_UNCLEAR = 20  # pairs in a row that others contradict, after which a set is not grown further
_HOPELESS = 4.0  # times the gate: pairs so far off, given those of the set, will hardly come back into it
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
    rows: tuple[int, ...]  # of the candidates
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
        density: landmarks a square metre, see `landmark_density`; where it is 0, which is not known, nothing is joined.
        options: see `JoinOptions`.
    """
    options = options or JoinOptions()
    gate = chi_square_limit(options.probability, 2)
    pairs = _candidates(points, covariance, apart, gate)
    if not len(pairs.first) or density <= 0.0:
        return []
    evidence = _evidence(pairs.difference, pairs.own, density)
    least, margin = np.log(options.odds), np.log(options.rival_odds)
    hypotheses: list[_Hypothesis] = []
    tried: set[int] = set()
    work = 0
    for seed in np.argsort(-evidence, kind="stable")[:_MOST_SEEDS].tolist():
        if work > _MOST_WORK:
            _LOG.info("joining landmarks: rivals of a set of %d pairs among %d were not all looked for",
                      len(hypotheses[0].rows), len(evidence))  # fmt: skip
            break
        if seed not in tried:
            grown = _grow(seed, float(evidence[seed]), pairs, apart, density, gate, margin)
            tried.update(grown.rows)
            hypotheses.append(grown)
            work += len(grown.rows) * len(evidence)
    chosen: list[_Hypothesis] = []
    for h in sorted(hypotheses, key=lambda h: -h.evidence):
        if h.evidence < least:
            break
        rivals = [o for o in hypotheses if o is not h and o.evidence > h.evidence - margin]
        if not any(h.contradicts(o, apart) for o in rivals):
            chosen.append(h)
            break  # the rest is judged again when this has moved the map
    return [pair for h in chosen for pair in h.pairs]


@dataclass(frozen=True, eq=False)
class _Candidates:
    """Pairs of landmarks that pass the gate, each difference ``(P, 2)`` with its covariance ``(P, 2, 2)``."""

    first: Indices
    second: Indices
    difference: Array
    own: Array
    covariance: Array  # of all landmarks

    def cross(self, pair: int, others: Indices) -> Array:
        """Covariance ``(2, 2 O)`` of the difference of one pair with those of others."""
        a, b = 2 * self.first[pair], 2 * self.second[pair]
        rows = (self.covariance[a : a + 2] - self.covariance[b : b + 2]).reshape(2, -1, 2)
        out: Array = rows[:, self.first[others]] - rows[:, self.second[others]]
        out[:, others == pair] += _JITTER * np.eye(2)[:, None]
        return out.reshape(2, -1)


def evidence_of_one(distance: Array, covariance: Array, density: float) -> Array:
    """How much likelier landmarks are one than two (logarithm) by a difference that is zero if they are one.

    Args:
        distance: squared Mahalanobis distances ``(...)`` of the differences from zero.
        covariance: ``(..., 2, 2)`` of the differences.
        density: landmarks a square metre.
    """
    out: Array = -0.5 * (distance + np.log(4.0 * np.pi**2 * determinant(covariance))) - np.log(density)
    return out


def _evidence(difference: Array, own: Array, density: float) -> Array:
    return evidence_of_one(squared_distance(difference, own), own, density)


def _candidates(points: Array, covariance: Array, apart: Flags, gate: float) -> _Candidates:
    count = len(points)
    blocks = covariance.reshape(count, 2, count, 2)
    spread = np.sqrt(np.trace(blocks[np.arange(count), :, np.arange(count)], axis1=1, axis2=2) + _JITTER)
    # no difference has a larger deviation along any direction than the two together
    reach = gate * (spread[:, None] + spread) ** 2
    near = np.sum((points[:, None] - points) ** 2, axis=2) <= reach
    first, second = np.nonzero(np.triu(near & ~apart, 1))
    cross = blocks[first, :, second]
    own = blocks[first, :, first] + blocks[second, :, second] - cross - np.swapaxes(cross, 1, 2)
    own += _JITTER * np.eye(2)
    difference = points[first] - points[second]
    kept = squared_distance(difference, own) <= gate
    return _Candidates(first[kept], second[kept], difference[kept], own[kept], covariance)


def _grow(
    seed: int, evidence: float, pairs: _Candidates, apart: Flags, density: float, gate: float, margin: float
) -> _Hypothesis:
    """Take a pair for one, then again and again the likeliest clear pair, as long as it is likelier one than two.

    A pair is clear if no pair that contradicts it is nearly as likely, given those chosen; what is not waits until the
    set has moved the map.
    """
    given = Conditioned(pairs.difference, pairs.own, pairs.cross)
    rows, total, place = [seed], evidence, seed
    apart, name = apart.copy(), np.arange(len(apart))  # name: the landmark that each is taken for
    while len(rows) < _MOST_PAIRS:
        given.choose(place)
        kept, gone = name[pairs.first[rows[-1]]], name[pairs.second[rows[-1]]]
        name[name == gone] = kept
        apart[kept] |= apart[gone]
        apart[:, kept] |= apart[:, gone]
        first, second = name[pairs.first[given.rows]], name[pairs.second[given.rows]]
        distance = squared_distance(given.difference, given.own)
        open_ = (first != second) & ~apart[first, second]
        more = np.where(open_ & (distance <= gate), _evidence(given.difference, given.own, density), -np.inf)
        place = _clearest(more, first, second, apart, margin)
        if place < 0:
            break
        rows.append(int(given.rows[place]))
        total += float(more[place])
        still = open_ & (distance <= _HOPELESS * gate)
        if 2 * still.sum() < len(still):
            place = int(still[:place].sum())
            given.drop_all_but(still)
    named = zip(pairs.first[rows].tolist(), pairs.second[rows].tolist(), strict=True)
    return _Hypothesis(tuple(rows), tuple(named), total)


def _clearest(evidence: Array, first: Indices, second: Indices, apart: Flags, margin: float) -> int:
    """The likeliest pair (of landmarks `first` and `second`) that none that contradicts it comes near; -1 if none."""
    likely = np.flatnonzero(evidence > 0.0)
    for place in likely[np.argsort(-evidence[likely], kind="stable")[:_MOST_UNCLEAR]].tolist():
        a, b = first[place], second[place]
        rivals = np.flatnonzero(evidence > evidence[place] - margin)
        f, s = first[rivals], second[rivals]
        # of a rival that has one landmark in common: the other one, against the partner of the common one
        shared = ((f == a) & apart[s, b]) | ((s == a) & apart[f, b])
        shared |= ((f == b) & apart[s, a]) | ((s == b) & apart[f, a])
        same = ((f == a) & (s == b)) | ((f == b) & (s == a))
        if not (shared & ~same).any():
            return int(place)
    return -1


def _partners(hypothesis: _Hypothesis) -> dict[int, set[int]]:
    partners: dict[int, set[int]] = {}
    for a, b in hypothesis.pairs:
        partners.setdefault(a, set()).add(b)
        partners.setdefault(b, set()).add(a)
    return partners
