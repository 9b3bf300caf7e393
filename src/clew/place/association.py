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

NEW = -1  # no landmark that is known
UNCLEAR = -2  # neither one that is known for sure, nor for sure a new one


def chi_square_limit(probability: float, dim: int) -> float:
    """What a chi-square variable of `dim` degrees of freedom exceeds with a probability of ``1 - probability``."""
    return float(chdtri(dim, 1.0 - probability))


@dataclass(frozen=True)
class Gates:
    """When a sighting is of a known landmark, and when of a new one.

    Attributes:
        known: squared Mahalanobis distance up to which a landmark is compatible (99 % for two dimensions).
        new: distance to all known ones from which on a sighting is of a new landmark; in between it is unclear.
        margin: how much likelier (difference of ``-2 log`` likelihoods) the best landmark must be than the second.
    """

    known: float = 9.21
    new: float = 13.8
    margin: float = 0.0


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


def nearest_neighbour(z: Array, predicted: Array, covariance: Array, noise: Array, gates: Gates) -> Indices:
    """The likeliest compatible landmark ``(M,)`` of each sighting, `NEW` or `UNCLEAR`.

    Sightings at one moment are of different landmarks: of all ways to pair them off, the likeliest is taken. For the
    arguments see `compatibility`.
    """
    out = np.full(len(z), NEW)
    if len(z) == 0 or len(predicted) == 0:
        return out
    distance, likelihood = compatibility(z, predicted, covariance, noise)
    allowed = distance <= gates.known
    nearest = distance.min(axis=1)
    out[nearest <= gates.new] = UNCLEAR
    if not allowed.any():
        return out
    lowest = likelihood[allowed].min()
    # Any pair that is allowed is worth more than none: the cost of none is above all others'.
    none = likelihood[allowed].max() - lowest + gates.known + 1.0
    cost = np.hstack([np.where(allowed, likelihood - lowest, 1e6), np.full((len(z), len(z)), none)])
    rows, columns = linear_sum_assignment(cost)
    paired = columns < len(predicted)
    rows, columns = rows[paired], columns[paired]
    if gates.margin > 0.0:
        rivals = np.where(allowed, likelihood, np.inf)[rows]
        best = rivals[np.arange(len(rows)), columns]
        rivals[np.arange(len(rows)), columns] = np.inf
        clear = rivals.min(axis=1, initial=np.inf) - best >= gates.margin
        rows, columns = rows[clear], columns[clear]
    out[rows] = columns
    return out


def joint_compatibility(z: Array, predicted: Array, joint: Array, noise: Array, gates: Gates) -> Indices:
    """The largest set of pairings that are compatible all together, and of those the nearest; ``(M,)`` as above.

    Joint compatibility branch and bound: Neira and Tardós 2001, "Data association in stochastic mapping using the
    joint compatibility test", algorithm 2. Pairings that each pass the gate but contradict each other given how
    their predictions hang together (all shifted by one wrong pose) are told apart.

    Args:
        z: ``(M, 2)`` sightings at one moment.
        predicted: ``(L, 2)``.
        joint: ``(2 L, 2 L)`` joint covariance of the predictions.
        noise: ``(M, 2, 2)`` covariance of each sighting.
        gates: see `Gates`; the joint gate has the same probability.
    """
    out = np.full(len(z), NEW)
    if len(z) == 0 or len(predicted) == 0:
        return out
    blocks = joint.reshape(len(predicted), 2, len(predicted), 2)
    own = np.einsum("iajb->ijab", blocks)[np.arange(len(predicted)), np.arange(len(predicted))]
    distance, _ = compatibility(z, predicted, own, noise)
    out[distance.min(axis=1) <= gates.new] = UNCLEAR
    search = _Search(z, predicted, joint, noise, distance, gates)
    search.descend([], 0)
    for row, landmark in enumerate(search.best):
        if landmark >= 0:
            out[row] = landmark
    return out


class _Search:
    """Depth-first search over pairings, one sighting a level; `best` is the best complete one so far."""

    def __init__(
        self, z: Array, predicted: Array, joint: Array, noise: Array, distance: Array, gates: Gates
    ) -> None:
        self.z, self.predicted, self.joint, self.noise = z, predicted, joint, noise
        self.candidates = [
            [int(j) for j in np.argsort(row, kind="stable") if row[j] <= gates.known] for row in distance
        ]
        probability = 1.0 - np.exp(-gates.known / 2.0)  # of the gate, in two dimensions
        self.limits = [0.0, *(chi_square_limit(probability, 2 * k) for k in range(1, len(z) + 1))]
        self.best: list[int] = []
        self.best_rank = (-1, 0.0)

    def descend(self, chosen: list[int], pairs: int, distance: float = 0.0) -> None:
        level = len(chosen)
        if level == len(self.z):
            if (pairs, -distance) > self.best_rank:
                self.best, self.best_rank = list(chosen), (pairs, -distance)
            return
        for landmark in self.candidates[level]:
            if landmark in chosen:
                continue
            total = self._distance([*chosen, landmark])
            if total <= self.limits[pairs + 1] and self._may_win(level + 1, pairs + 1):
                self.descend([*chosen, landmark], pairs + 1, total)
        if self._may_win(level + 1, pairs):
            self.descend([*chosen, NEW], pairs, distance)

    def _may_win(self, level: int, pairs: int) -> bool:
        """Whether so many pairs, and all that may still follow, can reach the best."""
        return pairs + len(self.z) - level >= self.best_rank[0]

    def _distance(self, chosen: list[int]) -> float:
        """Squared joint Mahalanobis distance of the pairs chosen."""
        rows = [row for row, landmark in enumerate(chosen) if landmark >= 0]
        landmarks = [chosen[row] for row in rows]
        scalars = (2 * np.array(landmarks)[:, None] + np.arange(2)).reshape(-1)
        covariance = self.joint[np.ix_(scalars, scalars)].copy()
        for place, row in enumerate(rows):
            covariance[2 * place : 2 * place + 2, 2 * place : 2 * place + 2] += self.noise[row]
        difference = (self.z[rows] - self.predicted[landmarks]).reshape(-1)
        return float(difference @ np.linalg.solve(covariance, difference))
