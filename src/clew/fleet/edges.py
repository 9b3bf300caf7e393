"""Where two robots stand to each other by relative poses between their graphs, the wrong ones left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from clew.fleet.robot import InterRobotEdges, RobotGraph

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SAME_EDGE = 1e-6  # metres and radians


@dataclass(frozen=True, eq=False)
class EdgeAgreement:
    """The relative pose that most edges agree on.

    Attributes:
        T_a_b: ``(storage,)``.
        edges: those that agree, from poses of a to poses of b.
        count: how many there were.
        runner_up: how many agree on the best pose that none of `edges` proposes.
    """

    T_a_b: Array
    edges: InterRobotEdges
    count: int
    runner_up: int


def edges_between(a: RobotGraph, b: RobotGraph) -> InterRobotEdges | None:
    """All edges between two robots, whoever measured them, as seen from a; each once; None if there are none."""
    functions = a.pose_kind.functions
    parts = []
    forth, back = _to(a, b.name), _to(b, a.name)
    if forth is not None:
        parts.append(forth)
    if back is not None:
        # z = T_a_b becomes z^-1, and its tangent at b is seen from a: e' = -Ad(z) e.
        adjoint = functions.adjoint(functions.inverse(back.measurement))
        information = np.swapaxes(adjoint, 1, 2) @ back.information @ adjoint
        parts.append(InterRobotEdges(back.other_poses, np.full(len(back), b.name), back.poses,
                                     functions.inverse(back.measurement), information))
    if not parts:
        return None
    joined = [np.concatenate([getattr(part, name) for part in parts])
              for name in ("poses", "others", "other_poses", "measurement", "information")]
    # Both robots' files may hold the same edge, which turned round twice is the same but for rounding.
    order = np.lexsort((*joined[3].T, joined[2], joined[0]))
    joined = [column[order] for column in joined]
    apart = np.abs(functions.local(joined[3][:-1], joined[3][1:])).max(axis=1)
    again = (joined[0][1:] == joined[0][:-1]) & (joined[2][1:] == joined[2][:-1]) & (apart < SAME_EDGE)
    first = np.concatenate([[True], ~again])
    return InterRobotEdges(*(column[first] for column in joined))


def agree_on_edges(a: RobotGraph, b: RobotGraph, edges: InterRobotEdges, confidence: float,
                   slack: tuple[float, float]) -> EdgeAgreement:
    """The edge whose relative pose most others confirm (the largest consensus; all are tried).

    Args:
        a, b: the robots.
        edges: from a to b.
        confidence: of the gate on the residual of an edge.
        slack: standard deviations of what the robots' own graphs are wrong by, metres and radians.
    """
    kind: Any = a.pose_kind
    functions = kind.functions
    poses_a, poses_b = a.graph.values(edges.poses).array, b.graph.values(edges.other_poses).array
    proposals = functions.compose(functions.compose(poses_a, edges.measurement), functions.inverse(poses_b))
    predicted = functions.compose(functions.inverse(poses_a)[None],
                                  functions.compose(proposals[:, None], poses_b[None]))
    residuals = functions.local(np.broadcast_to(edges.measurement, predicted.shape), predicted)
    extra = np.diag([slack[0] ** 2] * kind.space + [slack[1] ** 2] * (kind.dim - kind.space))
    weights = np.linalg.inv(np.linalg.inv(edges.information) + extra)
    distances = np.einsum("efi,fij,efj->ef", residuals, weights, residuals)
    agree = distances < chi2.ppf(confidence, kind.dim)
    counts = agree.sum(axis=1)
    best = int(np.lexsort((np.where(agree, distances, 0).sum(axis=1), -counts))[0])
    others = counts[~agree[best]]
    rows = np.flatnonzero(agree[best])
    chosen = InterRobotEdges(edges.poses[rows], edges.others[rows], edges.other_poses[rows],
                             edges.measurement[rows], edges.information[rows])
    return EdgeAgreement(proposals[best], chosen, len(edges), int(others.max(initial=0)))


def _to(robot: RobotGraph, other: str) -> InterRobotEdges | None:
    edges = robot.edges
    if edges is None or not np.any(edges.others == other):
        return None
    rows = np.flatnonzero(edges.others == other)
    return InterRobotEdges(edges.poses[rows], edges.others[rows], edges.other_poses[rows],
                           edges.measurement[rows], edges.information[rows])
