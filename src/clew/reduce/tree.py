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
from clew.reduce.relation import WORLD, Relations, is_pose, relations

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


def nearest_tree(
    blanket: Blanket, gaussian: Gaussian, conservative: bool, spared: NDArray[np.float64] | None = None
) -> tuple[list[Factor], float]:
    """Factors of the best tree, and its divergence from the blanket's Gaussian, nats.

    Args:
        blanket: what was known.
        gaussian: of `fix_frame`.
        conservative: take back information, from all edges alike, until no combination of the variables is known
            better than it was.
        spared: ``(k, k)`` nats that may be lost more for the tree to have an edge between two nodes.
    """
    edges = _candidates(blanket, gaussian)
    chosen = [e.take(rows) for e, rows in zip(edges, _spanning_tree(blanket, edges, spared), strict=True)]
    chosen = [e for e in chosen if len(e.log_determinant)]
    loss = 0.5 * (sum(float(e.log_determinant.sum()) for e in chosen) - gaussian.log_determinant)
    informations: list[Array] = [np.asarray(np.linalg.inv(e.covariance)) for e in chosen]
    if conservative:
        total = sum(
            np.einsum("pdi,pde,pej->ij", e.relations.jacobian, information, e.relations.jacobian)
            for e, information in zip(chosen, informations, strict=True)
        )
        # Eigenvalues of (tree's information) (covariance): above one, the tree claims too much.
        scale = max(float(np.linalg.eigvals(total @ gaussian.covariance).real.max()), 1.0)
        informations = [information / scale for information in informations]
        dim = sum(e.covariance.shape[0] * e.covariance.shape[1] for e in chosen)
        loss += 0.5 * dim * (1.0 / scale - 1.0 + np.log(scale))
    factors = [
        e.relations.factors(blanket, gaussian.step, information)
        for e, information in zip(chosen, informations, strict=True)
    ]
    return factors, max(float(loss), 0.0)


@dataclass(frozen=True)
class _Edges:
    """Relations that the tree may have, with their marginals: covariances ``(P, dim, dim)``."""

    relations: Relations
    covariance: Array
    log_determinant: Array

    def take(self, rows: list[int]) -> _Edges:
        r = self.relations
        part = Relations(r.kind, r.a[rows], r.b[rows], r.now[rows], r.jacobian[rows])
        return _Edges(part, self.covariance[rows], self.log_determinant[rows])


def _candidates(blanket: Blanket, gaussian: Gaussian) -> list[_Edges]:
    """All relations of two poses, of a pose and a point, and of either to the world."""
    # In the order of the keys: each pair one way round, so that parallel edges can be put together.
    order = sorted(range(len(blanket.keys)), key=blanket.keys.__getitem__)
    poses = np.array([i for i in order if is_pose(blanket.kinds[i])], dtype=np.int64)
    points = np.array([i for i, kind in enumerate(blanket.kinds) if not is_pose(kind)], dtype=np.int64)
    first, second = np.triu_indices(len(poses), 1)
    pairs = [(poses[first], poses[second]), (np.repeat(poses, len(points)), np.tile(points, len(poses)))]
    if gaussian.root == WORLD:
        pairs += [(np.full(len(nodes), WORLD), nodes) for nodes in (poses, points)]
    found = []
    for a, b in pairs:
        if len(a):
            seen = relations(blanket, a, b)
            covariance = seen.jacobian @ gaussian.covariance @ seen.jacobian.transpose(0, 2, 1)
            found.append(_Edges(seen, covariance, np.linalg.slogdet(covariance)[1]))
    return found


def _spanning_tree(blanket: Blanket, edges: list[_Edges], spared: Array | None) -> list[list[int]]:
    """Rows of each set of edges that make the minimum spanning tree (Kruskal).

    Points are leaves, for nothing is seen from them: the poses are joined first, then each point has its best edge.
    """
    part = {i: i for i in [*range(len(blanket.keys)), WORLD]}

    def root_of(node: int) -> int:
        while part[node] != node:
            node = part[node]
        return node

    def weights(e: _Edges) -> list[float]:
        between = e.relations.a != WORLD
        weight = e.log_determinant.copy()
        if spared is not None:  # half the logarithm counts
            weight[between] -= 2.0 * spared[e.relations.a[between], e.relations.b[between]]
        return [float(w) for w in weight]

    ranked = sorted(
        (not is_pose(e.relations.kind), weight, number, row)
        for number, e in enumerate(edges)
        for row, weight in enumerate(weights(e))
    )
    chosen: list[list[int]] = [[] for _ in edges]
    for _, _, number, row in ranked:
        seen = edges[number].relations
        a, b = int(seen.a[row]), int(seen.b[row])
        if root_of(a) != root_of(b):
            part[root_of(b)] = root_of(a)
            chosen[number].append(row)
    return chosen
