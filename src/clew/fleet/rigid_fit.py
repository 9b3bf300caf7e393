"""Where one set of points stands to another, from pairs of the same points with their covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2, so2

Array = NDArray[np.float64]

ITERATIONS = 5  # Gauss-Newton from the closed form is quadratic; the covariances hardly change after the second


@dataclass(frozen=True, eq=False)
class RigidFit:
    """A least-squares fit.

    Attributes:
        T_a_b: ``(3,)`` pose of frame b in frame a.
        covariance: ``(3, 3)`` in the tangent of the pose.
        distances: ``(n,)`` squared Mahalanobis distance of each pair.
    """

    T_a_b: Array
    covariance: Array
    distances: Array


def fit_rigid(points_a: Array, points_b: Array, covariances_a: Array, covariances_b: Array) -> RigidFit:
    """Rigid motion that takes points b ``(n, 2)`` to points a ``(n, 2)``, ``n >= 2``, weighted by both covariances.

    Closed form (Arun, Huang & Blostein 1987) with scalar weights, then Gauss-Newton with the full covariances
    ``(n, 2, 2)``.
    """
    pose = _closed_form(points_a, points_b, 1.0 / np.trace(covariances_a + covariances_b, axis1=1, axis2=2))
    for _ in range(ITERATIONS):
        weights = np.linalg.inv(pair_covariances(pose, covariances_a, covariances_b))
        jacobian = se2.act_jacobians(np.broadcast_to(pose, (len(points_b), 3)), points_b)[0]
        weighted = np.swapaxes(jacobian, 1, 2) @ weights
        information = (weighted @ jacobian).sum(axis=0)
        information += 1e-12 * np.trace(information) * np.eye(3)  # points in one place tell no direction
        gradient = np.einsum("nij,nj->i", weighted, points_a - se2.act(pose, points_b))
        pose = se2.retract(pose, np.linalg.solve(information, gradient))
    differences = points_a - se2.act(pose, points_b)
    distances = mahalanobis(differences, pair_covariances(pose, covariances_a, covariances_b))
    return RigidFit(pose, np.asarray(np.linalg.inv(information)), distances)


def pair_covariances(T_a_b: Array, covariances_a: Array, covariances_b: Array) -> Array:
    """Covariances ``(..., 2, 2)`` of differences ``p_a - T_a_b p_b``, the pose ``(3,)`` taken as known."""
    rotation = so2.matrix(T_a_b[2:])
    return np.asarray(covariances_a + rotation @ covariances_b @ rotation.T)


def mahalanobis(differences: Array, covariances: Array) -> Array:
    """``d^T C^-1 d`` of differences ``(..., 2)`` with covariances ``(..., 2, 2)``."""
    xx, xy, yy = covariances[..., 0, 0], covariances[..., 0, 1], covariances[..., 1, 1]
    x, y = differences[..., 0], differences[..., 1]
    return np.asarray((yy * x * x - 2 * xy * x * y + xx * y * y) / (xx * yy - xy * xy))


def _closed_form(points_a: Array, points_b: Array, weights: Array) -> Array:
    share = weights / weights.sum()
    centre_a, centre_b = share @ points_a, share @ points_b
    a, b = points_a - centre_a, points_b - centre_b
    cosine = (share * (a * b).sum(axis=1)).sum()
    sine = (share * (b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])).sum()
    theta = np.arctan2(sine, cosine)
    turned = se2.act(np.array([0.0, 0.0, theta]), centre_b)
    return np.array([*(centre_a - turned), theta])
