"""Which landmarks are the sightings of one moment, all together? Joint compatibility branch and bound.

Neira and Tardós 2001, "Data association in stochastic mapping using the joint compatibility test", algorithm 2: of all
ways to pair sightings with landmarks that pass the chi-square gate of all pairs jointly, one with most pairs, and of
those the nearest. Pairings that each pass their own gate but contradict each other given how the predictions hang
together (all shifted by one wrong pose) are told apart.

The search keeps all candidates given the pairs that are chosen so far. The joint distance grows by that of the next
pair, so conditioned, hence it bounds what may follow: a moment costs some tens of microseconds a pair where nothing is
ambiguous.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from clew.place.association import NEW, UNCLEAR, Gates, chi_square_limit, determinant, squared_distance
from clew.place.conditioned import Conditioned

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Pairings that are tried a sighting of the moment; then the best found so far counts, and the result says so.
_TRIED_A_SIGHTING = 50
_MOST_RIVALS = 12  # landmarks that a sighting is compared with, the nearest


@dataclass(frozen=True, eq=False)
class JointAssociation:
    """What the sightings of a moment were taken for.

    Attributes:
        landmark: ``(M,)`` row of each sighting's landmark, `NEW` or `UNCLEAR`.
        compatible: ``(M,)`` the set of pairs from which that was decided: row of the landmark, or `NEW`.
        tried: pairings that were tried.
        exhausted: the search stopped at its limit: there may be a better set of pairs than the one found.
    """

    landmark: Indices
    compatible: Indices
    tried: int = 0
    exhausted: bool = False


def joint_compatibility(
    z: Array, predicted: Array, joint: Array, noise: Array, gates: Gates, density: float = 0.0
) -> JointAssociation:
    """The largest set of pairings that are compatible all together, and of those the nearest.

    A pair of that set is clear if, given all others, it is likelier by a margin than with any other landmark, and than
    with the landmarks of two pairs exchanged; and if hardly a landmark would be in its gate by chance. A sighting
    without a pair is `NEW` if, given the pairs, no landmark without a pair is near; else it is `UNCLEAR`.

    Args:
        z: ``(M, 2)`` sightings at one moment.
        predicted: ``(L, 2)`` where each landmark should be seen.
        joint: ``(2 L, 2 L)`` joint covariance of the predictions.
        noise: ``(M, 2, 2)`` covariance of each sighting.
        gates: see `Gates`; the joint gate has the same probability.
        density: landmarks a square metre.
    """
    if len(z) == 0 or len(predicted) == 0:
        return JointAssociation(np.full(len(z), NEW), np.full(len(z), NEW))
    pairs = _Candidates(z, predicted, joint, noise, gates)
    search = _Search(pairs, gates)
    chosen = np.array(search.best, np.int64)
    compatible = np.full(len(z), NEW)
    compatible[pairs.row[chosen]] = pairs.landmark[chosen]
    landmark = _judge(pairs, chosen, gates, density)
    return JointAssociation(landmark, compatible, search.tried, search.exhausted)


class _Candidates:
    """Pairs of a sighting and a landmark that are near it, ordered by sighting.

    Attributes:
        row, landmark: ``(P,)`` of each pair.
        difference: ``(P, 2)`` from prediction to sighting.
        own: ``(P, 2, 2)`` its covariance, with the noise of the sighting.
        noise: ``(P, 2, 2)`` of the sighting.
        passes: ``(P,)`` whether the pair passes the gate of known landmarks.
    """

    def __init__(self, z: Array, predicted: Array, joint: Array, noise: Array, gates: Gates) -> None:
        count = len(predicted)
        self._joint = joint.reshape(count, 2, count, 2)
        every = np.arange(count)
        total = self._joint[every, :, every][None] + noise[:, None]
        difference = z[:, None] - predicted[None]
        distance = squared_distance(difference, total)
        rank = np.argsort(np.argsort(distance, axis=1, kind="stable"), axis=1, kind="stable")
        self.row, self.landmark = np.nonzero((distance <= gates.limit_new) & (rank < _MOST_RIVALS))
        self.count = len(z)
        self.difference = difference[self.row, self.landmark]
        self.own = total[self.row, self.landmark]
        self.noise = noise[self.row]
        self.passes = distance[self.row, self.landmark] <= gates.limit_known

    def __len__(self) -> int:
        return len(self.row)

    def covariance(self, some: Indices, others: Indices) -> Array:
        """``(2 S, 2 O)`` of the differences of some pairs with those of others."""
        out = self._joint[self.landmark[some][:, None], :, self.landmark[others]]  # (S, O, 2, 2)
        same = self.row[some][:, None] == self.row[others]
        if same.any():
            out = out + np.where(same[:, :, None, None], self.noise[some][:, None], 0.0)
        return np.ascontiguousarray(out.transpose(0, 2, 1, 3)).reshape(2 * len(some), 2 * len(others))

    def cross(self, pair: int, others: Indices) -> Array:
        """``(2, 2 O)`` of the difference of one pair with those of others."""
        return self.covariance(np.array([pair]), others)


class _Search:
    """Depth first, one sighting a level, those with fewest candidates first; nearest pairs first."""

    def __init__(self, pairs: _Candidates, gates: Gates) -> None:
        self._pairs = pairs
        every = np.flatnonzero(pairs.passes)
        rows, first, counts = np.unique(pairs.row[every], return_index=True, return_counts=True)
        order = np.argsort(counts, kind="stable").tolist()
        self._levels = [every[first[k] : first[k] + counts[k]] for k in order]
        self._limits = [0.0, *(chi_square_limit(gates.known, 2 * k) for k in range(1, len(rows) + 1))]
        self._most = _TRIED_A_SIGHTING * pairs.count
        self._taken: set[int] = set()
        self._given = Conditioned(pairs.difference, pairs.own, pairs.cross)
        self.best: list[int] = []
        self._best = (-1, 0.0)
        self.tried, self.exhausted = 0, False
        self._descend([], 0, 0.0)

    def _descend(self, chosen: list[int], level: int, distance: float) -> None:
        if level == len(self._levels):
            if (len(chosen), -distance) > self._best:
                self.best, self._best = list(chosen), (len(chosen), -distance)
            return
        candidates = self._levels[level]
        grown = distance + squared_distance(self._given.difference[candidates], self._given.own[candidates])
        for k in np.argsort(grown, kind="stable").tolist():
            pair, total = int(candidates[k]), float(grown[k])
            if total > self._limits[len(chosen) + 1] or not self._may_win(level + 1, len(chosen) + 1, total):
                break
            landmark = int(self._pairs.landmark[pair])
            if landmark in self._taken:
                continue
            if self.tried >= self._most and self._best[0] >= 0:
                self.exhausted = True
                return
            self.tried += 1
            self._given.choose(pair)
            self._taken.add(landmark)
            self._descend([*chosen, pair], level + 1, total)
            self._taken.remove(landmark)
            self._given.undo()
        if self._may_win(level + 1, len(chosen), distance):
            self._descend(chosen, level + 1, distance)

    def _may_win(self, level: int, pairs: int, distance: float) -> bool:
        """Whether what may still follow can beat the best: with more pairs, or with as many that are nearer."""
        return (pairs + len(self._levels) - level, -distance) > self._best


def _judge(pairs: _Candidates, chosen: Indices, gates: Gates, density: float) -> Indices:
    """Pairs of the best set that are clear; `NEW` or `UNCLEAR` for all other sightings."""
    out = np.full(pairs.count, NEW)
    if not len(pairs):
        return out
    given = _Given(pairs, chosen)
    # The gate of the prediction as it was, not given the other pairs: that a set fits together proves little where the
    # robot knows its place badly and landmarks stand in patterns. Such sets are `join_landmarks`' matter. Where the
    # noise of a sighting alone spans several landmarks no better prediction helps, and the margin decides.
    crowd = np.pi * gates.limit_known * density
    blur = 2.0 * crowd * np.sqrt(determinant(pairs.noise))
    telling = crowd * np.sqrt(determinant(pairs.own)) <= np.maximum(gates.crowding, blur)
    free = np.ones(len(pairs), bool)
    free[np.isin(pairs.landmark, pairs.landmark[chosen])] = False
    free[chosen] = True
    near = free & telling & (given.distance <= gates.limit_new)
    out[pairs.row[near]] = UNCLEAR
    clear = (given.margins(gates) >= gates.margin) & telling[chosen] & (given.distance[chosen] <= gates.limit_known)
    out[pairs.row[chosen[clear]]] = pairs.landmark[chosen[clear]]
    return out


class _Given:
    """All candidates given the pairs of the best set; those of a sighting in the set given its other pairs.

    Attributes:
        distance: ``(P,)`` squared Mahalanobis distances.
        own: ``(P, 2, 2)`` covariances of the differences.
    """

    def __init__(self, pairs: _Candidates, chosen: Indices) -> None:
        self._pairs, self._chosen = pairs, chosen
        count = len(chosen)
        self.own, difference = pairs.own.copy(), pairs.difference.copy()
        if count:
            self._information = np.linalg.inv(pairs.covariance(chosen, chosen))
            self._weighted = self._information @ pairs.difference[chosen].reshape(-1)
            cross = pairs.covariance(np.arange(len(pairs)), chosen).reshape(len(pairs), 2, 2 * count)
            difference -= cross @ self._weighted
            self.own -= cross @ self._information @ np.swapaxes(cross, 1, 2)
            for k, pair in enumerate(chosen.tolist()):
                mine = np.flatnonzero(pairs.row == pairs.row[pair])
                at = slice(2 * k, 2 * k + 2)
                alone = np.linalg.inv(self._information[at, at])
                gain = self._information[:, at] @ alone
                left = self._information - gain @ self._information[at]  # of the others alone; zero in `at`
                weighted = self._weighted - gain @ self._weighted[at]
                difference[mine] = pairs.difference[mine] - cross[mine] @ weighted
                self.own[mine] = pairs.own[mine] - cross[mine] @ left @ np.swapaxes(cross[mine], 1, 2)
        self.distance = squared_distance(difference, self.own)

    def margins(self, gates: Gates) -> Array:
        """How much likelier ``(K,)`` (in ``-2 log``) each pair of the set is than its best rival."""
        pairs, chosen = self._pairs, self._chosen
        likelihood = self.distance + np.log(determinant(self.own))
        rivals = pairs.passes & ~np.isin(pairs.landmark, pairs.landmark[chosen])
        out = np.full(len(chosen), np.inf)
        for k, pair in enumerate(chosen.tolist()):
            mine = rivals & (pairs.row == pairs.row[pair])
            out[k] = likelihood[mine].min(initial=np.inf) - likelihood[pair]
        partner = {(int(pairs.row[q]), int(pairs.landmark[q])): int(q) for q in np.flatnonzero(pairs.passes)}
        rows, landmarks = pairs.row[chosen].tolist(), pairs.landmark[chosen].tolist()
        for i, j in combinations(range(len(chosen)), 2):
            first, second = partner.get((rows[i], landmarks[j])), partner.get((rows[j], landmarks[i]))
            if first is not None and second is not None and min(out[i], out[j]) >= gates.margin:
                exchanged = chosen.copy()
                exchanged[i], exchanged[j] = first, second
                worse = self._twice_log(exchanged) - self._twice_log(chosen)
                out[[i, j]] = np.minimum(out[[i, j]], worse)
        return out

    def _twice_log(self, chosen: Indices) -> float:
        """``-2 log`` likelihood of a set of pairs, up to a constant."""
        joint, difference = self._pairs.covariance(chosen, chosen), self._pairs.difference[chosen].reshape(-1)
        return float(difference @ np.linalg.solve(joint, difference) + np.linalg.slogdet(joint)[1])
