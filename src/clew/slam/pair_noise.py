"""How much pairs of scans contradict each other, and what each of them is worth for that.

What the returns of a pair are worth by themselves counts on flat walls and on normals and partners without error. The
residuals of many pairs about the poses that agree best with all of them show what they are worth in this building: a
variance factor (Förstner 1979, "Ein Verfahren zur Schätzung von Varianz- und Kovarianzkomponenten").

The noise of a scan is in all the pairs that it takes part in. Of ``n`` scans that see one surface, each with variance
``v``, the best estimate of the surface leaves the scans as if each pair of them held ``1 / (n v)``, where the error of
a pair has the variance ``2 v``. So a pair whose error has the covariance ``C`` enters the graph with ``2 C^-1 / n``.
The steps of the front end know their covariance (`clew.slam.match_noise`), but rest on the same scans: they count among
the pairs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.motion import bounded

Array = NDArray[np.float64]

PRIOR_WEIGHT = 20.0  # redundant numbers that the variance assumed beforehand counts for
ROUNDS = 10
CONDITIONED = 0.3  # share of the strongest direction's information from which on the weakest one follows the residuals
TOLD = 1.0 / 0.01**2  # per square metre; what is known so much worse rests on odometry, not on returns
BOTH_SCANS = 2.0  # the noise of a pair is that of two scans
TINY = 1e-300


def returns_once(pairs: NDArray[np.int32], count: int) -> Array:
    """Share ``(P,)`` of their returns that pairs ``(P, 2)`` of `count` keyframes may count as their own.

    A scan that is in ``n - 1`` pairs is one of ``n`` that see a surface: each pair has an ``n``-th, or what lies
    between the shares of its two scans.
    """
    times = 1 + np.bincount(pairs.reshape(-1), minlength=count)[pairs]
    return np.asarray(1.0 / np.sqrt(times[:, 0] * times[:, 1]), dtype=np.float64)


def pair_variance(error: Array, information: Array, keyframes: int) -> float:
    """Variance of pairs as a multiple of what their returns are worth, from their residuals.

    Directions that a pair measures least are not asked: along a corridor nothing moves it.

    Args:
        error: ``(P, 3)`` of the relative poses at the optimum.
        information: ``(P, 3, 3)`` of the returns of each pair.
        keyframes: how many poses these residuals have been used for.
    """
    values, vectors, unit = _directions(information)
    squares = (np.einsum("pij,pi->pj", vectors, error / unit) ** 2 * values)[:, 1:]
    variance = float(squares.mean())
    for _ in range(ROUNDS):
        variance = float(bounded(squares, max(variance, TINY)).mean())
    redundant = float(max(len(error) - keyframes + 1, 0))
    if not redundant:
        return 1.0
    variance *= len(error) / redundant
    return (PRIOR_WEIGHT + redundant * variance) / (PRIOR_WEIGHT + redundant)


def with_variance(information: Array, variance: Array | float) -> Array:
    """Information ``(P, 3, 3)`` of pairs for the graph, before it is shared among those that a scan is in.

    A direction that returns hardly measure, as along a corridor, keeps what it has: what it rests on, bent ends and
    rough surfaces, is alike in all pairs and does not show in their residuals. `variance` is one of all, or ``(P,)``.
    """
    gain = np.asarray(BOTH_SCANS / variance)[..., None]
    values, vectors, unit = _directions(information)
    # Squared, so that what is a tenth as well known, and rests on odometry, is hardly touched.
    follows = np.square(np.clip(values / np.maximum(CONDITIONED * values[:, 2:], TOLD), 0.0, 1.0))
    gains = 1.0 + (gain - 1.0) * follows
    root = (vectors * np.sqrt(gains * values)[:, None, :]) / unit[:, :, None]
    return np.asarray(root @ np.swapaxes(root, 1, 2))


def _directions(information: Array) -> tuple[Array, Array, Array]:
    """Eigenvalues ``(P, 3)``, rising, and eigenvectors ``(P, 3, 3)`` of information in units ``(P, 3)`` that make
    rotation as well known as the translation that is known best: a lone pillar leaves a turn about it open."""
    best = np.linalg.eigvalsh(information[:, :2, :2])[:, 1]
    unit = np.ones((len(information), 3))
    unit[:, 2] = np.sqrt(np.maximum(best, TINY) / np.maximum(information[:, 2, 2], TINY))
    values, vectors = np.linalg.eigh(information * unit[:, :, None] * unit[:, None, :])
    return np.maximum(values, 0.0), vectors, unit
