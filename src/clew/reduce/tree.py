"""The tree of relative poses that is nearest to a Gaussian on a blanket.

Of all trees of independent relative-pose measurements the nearest, by the divergence of Kullback and Leibler, has for
each edge the marginal of its relative pose (Carlevaris-Bianco, Kaess, Eustice: Generic node removal for factor-graph
SLAM, T-RO 2014; Mazuran, Burgard, Tipaldi: Nonlinear factor recovery for long-term SLAM, IJRR 2016). The change from
tangents to the relative poses of a spanning tree has a determinant of one, so that the divergence is

    D = 1/2 (sum over edges of log det Sigma_edge - log det Sigma),

and the minimum spanning tree by ``log det Sigma_edge`` is the best tree (Chow and Liu 1968, without a frame).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.graph import Factor
from clew.reduce.blanket import Blanket, covariance_of
from clew.reduce.relation import WORLD, is_pose, measured, relation, see_jacobian

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gaussian:
    """A blanket's distribution once its frame is fixed.

    Attributes:
        root: the node that holds still, a pose or `WORLD`.
        covariance: ``(n, n)`` of all tangents; zero for the root.
        log_determinant: of the covariance of the others.
        step: ``(n,)`` tangents from the blanket's values to the mean.
    """

    root: int
    covariance: Array
    log_determinant: float
    step: Array


def fix_frame(blanket: Blanket) -> Gaussian:
    """Hold the world, or where nothing ties to it the blanket's first pose, and find mean and covariance."""
    n = int(blanket.starts[-1])
    root = WORLD if blanket.absolute else next(i for i, kind in enumerate(blanket.kinds) if is_pose(kind))
    free = np.ones(n, dtype=np.bool_)
    if root != WORLD:
        free[blanket.span(root)] = False
    rows = np.flatnonzero(free)
    inverse, log_determinant = covariance_of(blanket.information[np.ix_(rows, rows)])
    covariance = np.zeros((n, n))
    covariance[np.ix_(rows, rows)] = inverse
    return Gaussian(root, covariance, log_determinant, -covariance @ blanket.gradient)


def nearest_tree(blanket: Blanket, gaussian: Gaussian, conservative: bool) -> tuple[list[Factor], float]:
    """Factors of the best tree, and its divergence from the blanket's Gaussian, nats.

    Args:
        blanket: what was known.
        gaussian: of `fix_frame`.
        conservative: take back information, from all edges alike, until no combination of the variables is known
            better than it was.
    """
    edges = _spanning_tree(blanket, gaussian)
    design = np.concatenate([e.jacobian for e in edges])
    loss = 0.5 * (sum(e.log_determinant for e in edges) - gaussian.log_determinant)
    informations = [np.linalg.inv(e.covariance) for e in edges]
    if conservative:
        start, total = 0, np.zeros((design.shape[1], design.shape[1]))
        for information in informations:
            rows = design[start : start + len(information)]
            start += len(information)
            total += rows.T @ information @ rows
        # Eigenvalues of (tree's information) (covariance): above one, the tree claims too much.
        excess = float(np.linalg.eigvals(total @ gaussian.covariance).real.max())
        scale = max(excess, 1.0)
        informations = [information / scale for information in informations]
        loss += 0.5 * start * (1.0 / scale - 1.0 + np.log(scale))
    factors = []
    for e, information in zip(edges, informations, strict=True):
        z, turn = measured(blanket, e.a, e.b, e.jacobian @ gaussian.step)
        information = turn.T @ information @ turn
        factors.append(relation(blanket, e.a, e.b, z, 0.5 * (information + information.T)))
    return factors, max(float(loss), 0.0)


@dataclass(frozen=True)
class _Edge:
    a: int
    b: int
    jacobian: Array
    covariance: Array
    log_determinant: float


def _spanning_tree(blanket: Blanket, gaussian: Gaussian) -> list[_Edge]:
    """Prim's algorithm from the root; points are leaves, for nothing can be seen from them."""
    count = len(blanket.keys)
    best: dict[int, _Edge] = {}
    left = [i for i in range(count) if i != gaussian.root]
    newest = gaussian.root
    edges: list[_Edge] = []
    while left:
        if newest == WORLD or is_pose(blanket.kinds[newest]):
            for i in left:
                edge = _edge(blanket, gaussian, newest, i)
                if i not in best or edge.log_determinant < best[i].log_determinant:
                    best[i] = edge
        poses = [i for i in left if is_pose(blanket.kinds[i])]  # before points: they may be nearer to these
        newest = min(poses or left, key=lambda i: best[i].log_determinant)
        edges.append(best[newest])
        left.remove(newest)
    return edges


def _edge(blanket: Blanket, gaussian: Gaussian, a: int, b: int) -> _Edge:
    if a != WORLD and is_pose(blanket.kinds[b]) and blanket.keys[b] < blanket.keys[a]:
        a, b = b, a  # each pair one way round, so that parallel edges can be put together
    jacobian = see_jacobian(blanket, a, b)
    covariance = jacobian @ gaussian.covariance @ jacobian.T
    return _Edge(a, b, jacobian, covariance, float(np.linalg.slogdet(covariance)[1]))
