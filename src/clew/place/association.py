"""Which landmark is it? Proposals from predictions and their joint uncertainty, handed in as arrays.

A sighting ``z`` of landmark ``j`` is compatible with it if ``(z - h_j)^T (C_jj + R)^-1 (z - h_j)`` passes a chi-square
gate, with ``h_j`` where the landmark should be seen and ``C`` the joint covariance of all those predictions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_TRIED = 2000  # pairings tried for the sightings of a moment; then the best found so far counts

NEW = -1  # no landmark that is known
UNCLEAR = -2  # neither one that is known for sure, nor for sure a new one


def chi_square_limit(probability: float, dim: int) -> float:
    """What a chi-square variable of `dim` degrees of freedom exceeds with a probability of ``1 - probability``."""
    return float(chdtri(dim, 1.0 - probability))


@dataclass(frozen=True)
class Gates:
    """When a sighting is of a known landmark, and when of a new one.

    Attributes:
        known: probability with which a sighting of a landmark passes its chi-square gate.
        new: probability with which it is nearer than the distance from which on a sighting is of a new landmark; in
            between it is unclear.
        margin: how much likelier (difference of ``-2 log`` likelihoods) the best landmark must be than the second.
        crowding: number of landmarks that by chance stand within the gate, from which on the gate proves nothing.
    """

    known: float = 0.999
    new: float = 0.99999
    margin: float = 6.0
    crowding: float = 0.3

    @property
    def limit_known(self) -> float:
        """Squared Mahalanobis distance up to which a landmark is compatible."""
        return chi_square_limit(self.known, 2)

    @property
    def limit_new(self) -> float:
        """Squared Mahalanobis distance to all known ones from which on a sighting is of a new landmark."""
        return chi_square_limit(self.new, 2)


def compatibility(z: Array, predicted: Array, covariance: Array, noise: Array) -> tuple[Array, Array]:
    """Squared Mahalanobis distances ``(M, L)`` and ``-2 log`` likelihoods ``(M, L)`` of each pair.

    Args:
        z: ``(M, 2)`` sightings.
        predicted: ``(L, 2)`` where each landmark should be seen.
        covariance: ``(L, 2, 2)`` of each prediction, without the noise of the sighting.
        noise: ``(M, 2, 2)`` covariance of each sighting.
    """
    total = covariance[None] + noise[:, None]
    difference = z[:, None] - predicted[None]
    determinant = total[..., 0, 0] * total[..., 1, 1] - total[..., 0, 1] ** 2
    x, y = difference[..., 0], difference[..., 1]
    distance = (
        total[..., 1, 1] * x * x - 2.0 * total[..., 0, 1] * x * y + total[..., 0, 0] * y * y
    ) / determinant
    return distance, distance + np.log(determinant)


def nearest_neighbour(
    z: Array, predicted: Array, covariance: Array, noise: Array, gates: Gates, density: float = 0.0
) -> Indices:
    """The likeliest compatible landmark ``(M,)`` of each sighting, `NEW` or `UNCLEAR`.

    Sightings at one moment are of different landmarks: of all ways to pair them off, the likeliest is taken. A pair
    counts if no other landmark is nearly as likely, and if the gate is so small that hardly a landmark would be in it
    by chance; where the robot knows its place too badly for that, the sighting is `NEW`, and `join_landmarks` is to
    find out what it is. For the arguments see `compatibility`; `density` is that of landmarks, a square metre.
    """
    out = np.full(len(z), NEW)
    if len(z) == 0 or len(predicted) == 0:
        return out
    distance, likelihood = compatibility(z, predicted, covariance, noise)
    allowed = distance <= gates.limit_known
    pairing = np.full(len(z), NEW)
    if allowed.any():
        lowest = likelihood[allowed].min()
        # Any pair that is allowed is worth more than none: the cost of none is above all others'.
        none = likelihood[allowed].max() - lowest + gates.limit_known + 1.0
        cost = np.hstack([np.where(allowed, likelihood - lowest, 1e6), np.full((len(z), len(z)), none)])
        rows, columns = linear_sum_assignment(cost)
        paired = columns < len(predicted)
        pairing[rows[paired]] = columns[paired]
    rows = np.flatnonzero(pairing >= 0)
    rivals = np.where(allowed, likelihood, np.inf)[rows]
    rivals[:, pairing[rows]] = np.inf
    margin = np.full(len(z), np.inf)
    margin[rows] = rivals.min(axis=1, initial=np.inf) - likelihood[rows, pairing[rows]]
    return _judge(pairing, margin, distance, likelihood, gates, density)


def _judge(
    pairing: Indices, margin: Array, distance: Array, likelihood: Array, gates: Gates, density: float
) -> Indices:
    """Pairs that are clear; otherwise `UNCLEAR`, or `NEW` where nothing is near or the gate proves nothing."""
    # log of the determinant is the difference of likelihood and squared distance
    area = np.pi * gates.limit_known * np.exp(0.5 * (likelihood - distance))
    telling = density * area <= gates.crowding
    out = np.where(((distance <= gates.limit_new) & telling).any(axis=1), UNCLEAR, NEW)
    rows = np.flatnonzero((pairing >= 0) & (margin >= gates.margin))
    rows = rows[telling[rows, pairing[rows]]]
    out[rows] = pairing[rows]
    return out


def joint_compatibility(
    z: Array, predicted: Array, joint: Array, noise: Array, gates: Gates, density: float = 0.0
) -> Indices:
    """The largest set of pairings that are compatible all together, and of those the nearest; ``(M,)`` as above.

    Joint compatibility branch and bound: Neira and Tardós 2001, "Data association in stochastic mapping using the
    joint compatibility test", algorithm 2. Pairings that each pass the gate but contradict each other given how
    their predictions hang together (all shifted by one wrong pose) are told apart. What is clear is decided as by
    `nearest_neighbour`.

    Args:
        z: ``(M, 2)`` sightings at one moment.
        predicted: ``(L, 2)``.
        joint: ``(2 L, 2 L)`` joint covariance of the predictions.
        noise: ``(M, 2, 2)`` covariance of each sighting.
        gates: see `Gates`; the joint gate has the same probability.
        density: landmarks a square metre.
    """
    if len(z) == 0 or len(predicted) == 0:
        return np.full(len(z), NEW)
    blocks = joint.reshape(len(predicted), 2, len(predicted), 2)
    own = np.einsum("iajb->ijab", blocks)[np.arange(len(predicted)), np.arange(len(predicted))]
    distance, likelihood = compatibility(z, predicted, own, noise)
    search = _Search(z, predicted, joint, noise, distance, gates)
    search.descend([], 0)
    return _judge(np.array(search.best), search.margins(), distance, likelihood, gates, density)


class _Search:
    """Depth-first search over pairings, one sighting a level; `best` is the best complete one so far."""

    def __init__(
        self, z: Array, predicted: Array, joint: Array, noise: Array, distance: Array, gates: Gates
    ) -> None:
        self.z, self.predicted, self.joint, self.noise = z, predicted, joint, noise
        self.candidates = [
            [int(j) for j in np.argsort(row, kind="stable") if row[j] <= gates.limit_known] for row in distance
        ]
        self.limits = [0.0, *(chi_square_limit(gates.known, 2 * k) for k in range(1, len(z) + 1))]
        self.best: list[int] = []
        self.best_rank = (-1, 0.0)
        self.tried = 0

    def descend(self, chosen: list[int], pairs: int, distance: float = 0.0) -> None:
        level = len(chosen)
        if level == len(self.z):
            if (pairs, -distance) > self.best_rank:
                self.best, self.best_rank = list(chosen), (pairs, -distance)
            return
        for landmark in self.candidates[level]:
            if landmark in chosen:
                continue
            if self.tried >= _MOST_TRIED and self.best:
                return
            self.tried += 1
            total = self._distance([*chosen, landmark])
            if total <= self.limits[pairs + 1] and self._may_win(level + 1, pairs + 1):
                self.descend([*chosen, landmark], pairs + 1, total)
        if self._may_win(level + 1, pairs):
            self.descend([*chosen, NEW], pairs, distance)

    def _may_win(self, level: int, pairs: int) -> bool:
        """Whether so many pairs, and all that may still follow, can reach the best."""
        return pairs + len(self.z) - level >= self.best_rank[0]

    def margins(self) -> Array:
        """How much likelier ``(M,)`` (in ``-2 log``) each best pair is than its best rival, given all other pairs."""
        out = np.full(len(self.z), np.inf)
        for row, landmark in enumerate(self.best):
            rivals = [j for j in self.candidates[row] if j not in self.best] if landmark >= 0 else []
            for rival in rivals:
                other = self._likelihood([*self.best[:row], rival, *self.best[row + 1 :]])
                out[row] = min(out[row], other - self._likelihood(self.best))
        return out

    def _likelihood(self, chosen: list[int]) -> float:
        """``-2 log`` likelihood of the pairs chosen, up to a constant."""
        covariance, difference = self._joint(chosen)
        _, determinant = np.linalg.slogdet(covariance)
        return float(difference @ np.linalg.solve(covariance, difference) + determinant)

    def _distance(self, chosen: list[int]) -> float:
        """Squared joint Mahalanobis distance of the pairs chosen."""
        covariance, difference = self._joint(chosen)
        return float(difference @ np.linalg.solve(covariance, difference))

    def _joint(self, chosen: list[int]) -> tuple[Array, Array]:
        """Covariance ``(2 k, 2 k)`` and value ``(2 k,)`` of the differences of the pairs chosen."""
        rows = [row for row, landmark in enumerate(chosen) if landmark >= 0]
        landmarks = [chosen[row] for row in rows]
        scalars = (2 * np.array(landmarks)[:, None] + np.arange(2)).reshape(-1)
        covariance = self.joint[np.ix_(scalars, scalars)].copy()
        for place, row in enumerate(rows):
            covariance[2 * place : 2 * place + 2, 2 * place : 2 * place + 2] += self.noise[row]
        return covariance, (self.z[rows] - self.predicted[landmarks]).reshape(-1)
