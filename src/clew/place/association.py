"""Which landmark is it? Proposals from predictions and their joint uncertainty, handed in as arrays.

A sighting ``z`` of landmark ``j`` is compatible with it if ``(z - h_j)^T (C_jj + R)^-1 (z - h_j)`` passes a chi-square
gate, with ``h_j`` where the landmark should be seen and ``C`` the joint covariance of all those predictions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_SMALLEST_DETERMINANT = 1e-30

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
    distance = squared_distance(z[:, None] - predicted[None], total)
    return distance, distance + np.log(determinant(total))


def squared_distance(difference: Array, covariance: Array) -> Array:
    """Squared Mahalanobis distances ``(...)`` of differences ``(..., 2)`` with covariances ``(..., 2, 2)``."""
    x, y = difference[..., 0], difference[..., 1]
    xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    distance: Array = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant(covariance)
    return distance


def determinant(matrix: Array) -> Array:
    """Determinants ``(...)`` of ``(..., 2, 2)``, positive even where rounding says otherwise."""
    xx, xy, yy = matrix[..., 0, 0], matrix[..., 0, 1], matrix[..., 1, 1]
    out: Array = np.maximum(xx * yy - xy * xy, _SMALLEST_DETERMINANT)
    return out


def nearest_neighbour(
    z: Array, predicted: Array, covariance: Array, noise: Array, gates: Gates, density: float = 0.0
) -> Indices:
    """The likeliest compatible landmark ``(M,)`` of each sighting, `NEW` or `UNCLEAR`.

    Sightings at one moment are of different landmarks: of all ways to pair them off, the likeliest is taken. A pair
    counts if no other landmark is nearly as likely, and if the gate is so small that hardly a landmark would be in it
    by chance; where the robot knows its place too badly for that, the sighting is `NEW`, and `join_landmarks` is to
    find out what it is. For the arguments see `compatibility`; `density` is that of landmarks, a square metre.
    """
    from scipy.optimize import linear_sum_assignment  # slow to import, and laser jobs have no landmarks

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
