"""What a variable says about its neighbours: elimination by the Schur complement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpocon, dpotrf, dpotri

from clew.graph import Factor, FactorGraph

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Directions that are known worse than this share of the best one count as known that badly: a factor that says nothing
#: of a direction stays one that says next to nothing.
WEAKEST = 1e-10


@dataclass(frozen=True)
class Blanket:
    """The Gaussian that the factors of an eliminated variable leave on its Markov blanket.

    Attributes:
        keys: the ``k`` variables of the blanket, in the order in which the factors name them.
        kinds: their manifolds.
        values: their values, ``(storage,)`` each.
        starts: ``(k + 1,)`` where the tangent of each begins in the arrays below.
        information: ``(n, n)`` of all tangents, at the values.
        gradient: ``(n,)`` half the derivative of the cost by the tangents, at the values.
        absolute: whether the factors tie the blanket to the world; otherwise they only tell relative poses.
    """

    keys: list[int]
    kinds: list[type[Any]]
    values: list[Array]
    starts: Index
    information: Array
    gradient: Array
    absolute: bool

    def span(self, node: int) -> slice:
        """Place of a variable's tangent."""
        return slice(int(self.starts[node]), int(self.starts[node + 1]))


def eliminate(graph: FactorGraph, key: int) -> Blanket:
    """Linearise the factors of a variable at the graph's values, robust weights included, and eliminate it.

    Factors of one variable are taken as ties to the world, all others as functions of relative poses alone.
    """
    factors = list(graph.touching([key]))
    seen = dict.fromkeys(int(k) for factor in factors for k in factor.keys.ravel())
    seen.pop(key, None)
    order = [key, *seen]
    place = {k: number for number, k in enumerate(order)}
    kinds = [graph.kind(k) for k in order]
    starts = np.concatenate([[0], np.cumsum([kind.dim for kind in kinds])]).astype(np.int64)
    size = int(starts[-1])
    information, gradient = np.zeros((size, size)), np.zeros(size)
    for factor in factors:
        _accumulate(graph, factor, place, starts, information, gradient)
    d = int(starts[1])
    # Of a variable that its factors leave free in some direction, that direction says nothing.
    gain = information[d:, :d] @ np.linalg.pinv(information[:d, :d], rcond=1e-12, hermitian=True)
    reduced = information[d:, d:] - gain @ information[:d, d:]
    return Blanket(
        order[1:], kinds[1:], [graph.value(k).array for k in order[1:]], starts[1:] - d,
        0.5 * (reduced + reduced.T), gradient[d:] - gain @ gradient[:d],
        any(len(factor.kinds) == 1 for factor in factors),
    )  # fmt: skip


def _accumulate(
    graph: FactorGraph, factor: Factor, place: dict[int, int], starts: Index, information: Array, gradient: Array
) -> None:
    """Add the normal equations of a block of factors."""
    error, jacobians = factor.linearise(*(graph.values(keys).array for keys in factor.keys.T))
    weighted = factor.information
    if factor.kernel is not None:
        squared = np.einsum("mi,mij,mj->m", error, weighted, error)
        weighted = factor.kernel.weight(squared)[:, None, None] * weighted
    rows = [
        starts[[place[k] for k in keys.tolist()]][:, None] + np.arange(jacobian.shape[2])
        for keys, jacobian in zip(factor.keys.T, jacobians, strict=True)
    ]
    for row, left in zip(rows, jacobians, strict=True):
        half = left.transpose(0, 2, 1) @ weighted
        np.add.at(gradient, row, np.einsum("mij,mj->mi", half, error))
        for column, right in zip(rows, jacobians, strict=True):
            np.add.at(information, (row[:, :, None], column[:, None, :]), half @ right)


def covariance_of(information: Array) -> tuple[Array, float]:
    """Inverse of a positive semidefinite matrix, and the logarithm of its determinant.

    Scaled to a unit diagonal, so that metres and radians compare; eigenvalues below `WEAKEST` are lifted to it.
    """
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    scaled = information / np.outer(scale, scale)
    inverse, log_determinant = _by_cholesky(scaled) or _by_eigenvalues(scaled)
    return inverse / np.outer(scale, scale), -log_determinant - 2.0 * float(np.log(scale).sum())


def _by_cholesky(matrix: Array) -> tuple[Array, float] | None:
    """Inverse and logarithm of the determinant where no direction is nearly unknown; None otherwise.

    A neighbourhood may be a hundred poses: this takes a tenth of the time of eigenvalues.
    """
    factor, status = dpotrf(matrix, lower=1)
    if status:
        return None
    reciprocal_condition, _ = dpocon(factor, np.abs(matrix).sum(axis=0).max(), uplo="L")
    if reciprocal_condition <= len(matrix) * WEAKEST:  # of 1-norms: at most n below that of eigenvalues
        return None
    lower, _ = dpotri(factor, lower=1)
    return np.tril(lower) + np.tril(lower, -1).T, 2.0 * float(np.log(np.diag(factor)).sum())


def _by_eigenvalues(matrix: Array) -> tuple[Array, float]:
    """The same with the eigenvalues that are too small lifted."""
    values, vectors = np.linalg.eigh(matrix)
    values = np.maximum(values, WEAKEST * values[-1])
    return (vectors / values) @ vectors.T, float(np.log(values).sum())
