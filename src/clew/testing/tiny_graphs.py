"""Tiny graphs whose answers are worked out by hand, for tests of solvers and of your own factors.

Each function builds a fresh graph with initial values away from the answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.factors import Bearing, Between, Prior
from clew.geometry import SE2, SE3, Point2
from clew.graph import FactorGraph
from clew.noise import Huber

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TinyGraph:
    """A graph and what solving it must give.

    Attributes:
        graph: to be solved.
        values: storage of each variable at the optimum, by key.
        cost: ``sum rho(e^T Omega e)`` at the optimum.
        covariances: covariance of the tangents of some variables, by key.
    """

    graph: FactorGraph
    values: dict[int, Array]
    cost: float
    covariances: dict[int, Array] = field(default_factory=dict)


def two_poses() -> TinyGraph:
    """A prior and one step ahead by one metre, all sigmas one.

    The second covariance is ``Ad I Ad^T + I`` with the adjoint ``Ad`` of a step back: the heading of the
    first pose swings the second sideways.
    """
    graph = FactorGraph()
    a, b = graph.add_pose(SE2(0.3, -0.2, 0.1)), graph.add_pose(SE2(0.7, 0.4, -0.2))
    graph.add(Prior(a, SE2(0.0, 0.0, 0.0), sigmas=1.0))
    graph.add(Between(a, b, SE2(1.0, 0.0, 0.0), sigmas=1.0))
    second = np.array([[2.0, 0.0, 0.0], [0.0, 3.0, 1.0], [0.0, 1.0, 2.0]])
    return TinyGraph(graph, {a: np.zeros(3), b: np.array([1.0, 0.0, 0.0])}, 0.0, {a: np.eye(3), b: second})


def two_opinions() -> TinyGraph:
    """A point believed at (0, 0) with sigma 1 and at (4, 2) with sigma 2: the mean weighted by 1 and 1/4."""
    graph = FactorGraph()
    point = graph.add_point(Point2(-3.0, 7.0))
    graph.add(Prior(point, Point2(0.0, 0.0), sigmas=1.0))
    graph.add(Prior(point, Point2(4.0, 2.0), sigmas=2.0))
    # information 1 + 1/4; cost 0.8^2 + 0.4^2 + (3.2^2 + 1.6^2) / 4
    return TinyGraph(graph, {point: np.array([0.8, 0.4])}, 4.0, {point: 0.8 * np.eye(2)})


def stretched_line(space: int = 2) -> TinyGraph:
    """Two steps of 1 m and a closure that says 2.3 m: each of the three residuals ends at 0.1 m.

    Minimises ``(a - 1)^2 + (b - 1)^2 + (a + b - 2.3)^2``: ``a = b = 1.1``, cost 0.03. In the plane (`space`
    is 2) along x, in space (3) along z.
    """
    graph = FactorGraph()
    kinds: dict[int, type[Any]] = {2: SE2, 3: SE3}
    kind = kinds[space]
    axis = {2: 0, 3: 2}[space]

    def ahead(distance: float) -> Any:
        translation = np.zeros(kind.dim)
        translation[axis] = distance
        return kind.identity().retract(translation)

    keys = [graph.add_pose(ahead(1.4 * step).retract(np.full(kind.dim, 0.02 * step))) for step in range(3)]
    graph.add(Prior(keys[0], kind.identity(), sigmas=1.0))
    for a, b, distance, role in ((0, 1, 1.0, "odometry"), (1, 2, 1.0, "odometry"), (0, 2, 2.3, "loop")):
        graph.add(Between(keys[a], keys[b], ahead(distance), sigmas=1.0, role=role))
    return TinyGraph(graph, {key: ahead(1.1 * step).array for step, key in enumerate(keys)}, 0.03)


def triangle() -> TinyGraph:
    """A landmark seen at 45 degrees to the left and to the right from two known poses 2 m apart: at (1, 1).

    The rows of the Jacobian are (-1/2, 1/2) and (-1/2, -1/2), so the information is ``I / (2 sigma^2)``.
    """
    graph = FactorGraph()
    left = graph.add_pose(SE2(0.0, 0.0, 0.0), constant=True)
    right = graph.add_pose(SE2(2.0, 0.0, np.pi / 2), constant=True)
    landmark = graph.add_point(Point2(0.8, 1.3))
    graph.add(Bearing(left, landmark, np.pi / 4, sigmas=0.1))
    graph.add(Bearing(right, landmark, np.pi / 4, sigmas=0.1))
    values = {left: np.zeros(3), right: np.array([2.0, 0.0, np.pi / 2]), landmark: np.ones(2)}
    return TinyGraph(graph, values, 0.0, {landmark: 0.02 * np.eye(2)})


def outlier() -> TinyGraph:
    """A point believed at x = 0, and at x = 10 with a Huber loss of scale 1, which pulls with force 1 only.

    Minimises ``x^2 + 2 |x - 10| - 1``: ``x = 1``, cost ``1 + 18 - 1``.
    """
    graph = FactorGraph()
    point = graph.add_point(Point2(0.0, 0.0))
    graph.add(Prior(point, Point2(0.0, 0.0), sigmas=1.0))
    graph.add(Prior(point, Point2(10.0, 0.0), sigmas=1.0, kernel=Huber(1.0)))
    return TinyGraph(graph, {point: np.array([1.0, 0.0])}, 18.0)


#: Every tiny graph, by name.
TINY_GRAPHS: dict[str, Callable[[], TinyGraph]] = {
    "two_poses": two_poses,
    "two_opinions": two_opinions,
    "stretched_line 2D": stretched_line,
    "stretched_line 3D": lambda: stretched_line(3),
    "triangle": triangle,
    "outlier": outlier,
}
