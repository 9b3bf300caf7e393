"""What one robot brings to a merge: its solved graph, its landmarks, and what it saw of others."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import SE2, SE3, Point2
from clew.graph import FactorGraph
from clew.solve import Solution, Status, optimize

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Names = NDArray[np.str_]


@dataclass(frozen=True, eq=False)
class LandmarkMap:
    """Point landmarks in a robot's own world frame.

    Attributes:
        keys: ``(L,)`` of the graph's variables.
        identities: ``(L,)`` text, empty for a landmark that carries none.
        positions: ``(L, 2)`` metres.
        covariances: ``(L, 2, 2)`` about the best alignment of the map as a whole.
        sightings: ``(L,)`` how often each was seen.
    """

    keys: Index
    identities: Names
    positions: Array
    covariances: Array
    sightings: Index

    def __len__(self) -> int:
        return len(self.keys)


@dataclass(frozen=True, eq=False)
class Encounters:
    """``K`` sightings of other robots by range and bearing; robots are told apart by their names.

    Attributes:
        poses: ``(K,)`` keys of the poses from which the others were seen.
        others: ``(K,)`` names of the robots seen.
        other_poses: ``(K,)`` keys of their poses at that moment, in their own graphs.
        ranges: ``(K,)`` metres.
        bearings: ``(K,)`` radians from the observer's x axis.
        covariance: ``(2, 2)`` of (range, bearing).
        mounting: standard deviation of what was seen about the other robot's centre, metres.
    """

    poses: Index
    others: Names
    other_poses: Index
    ranges: Array
    bearings: Array
    covariance: Array
    mounting: float = 0.02

    def __len__(self) -> int:
        return len(self.poses)


@dataclass(frozen=True, eq=False)
class InterRobotEdges:
    """``E`` relative poses between a pose of this robot and one of another.

    Attributes:
        poses: ``(E,)`` keys of this robot's poses.
        others: ``(E,)`` names of the other robots.
        other_poses: ``(E,)`` keys in their graphs.
        measurement: ``(E, storage)`` pose of the other as seen from this one.
        information: ``(E, dim, dim)``.
    """

    poses: Index
    others: Names
    other_poses: Index
    measurement: Array
    information: Array

    def __len__(self) -> int:
        return len(self.poses)


@dataclass(frozen=True, eq=False)
class RobotGraph:
    """One robot, solved by itself; made by `robot_graph`.

    Attributes:
        name: by which others know it.
        solution: its own solve; the solved graph is ``solution.graph``.
        landmarks: in its own world frame.
        encounters: with other robots, by range and bearing, or None.
        edges: relative poses to poses of others, or None.
    """

    name: str
    solution: Solution
    landmarks: LandmarkMap
    encounters: Encounters | None = None
    edges: InterRobotEdges | None = None
    graph: FactorGraph = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "graph", self.solution.graph)

    @property
    def pose_kind(self) -> type[Any]:
        """`SE2` or `SE3`."""
        return SE3 if len(self.graph.keys(SE3)) else SE2


def robot_graph(
    name: str,
    graph: FactorGraph,
    identities: dict[int, str] | None = None,
    *,
    encounters: Encounters | None = None,
    edges: InterRobotEdges | None = None,
    init: str = "file",
) -> RobotGraph:
    """Solve a robot's graph by itself and take stock of its landmarks.

    Args:
        name: of the robot; encounters and edges of others refer to it.
        graph: poses of one kind and landmarks in one frame, its own.
        identities: what is known of landmarks, by key; landmarks that are not named carry none.
        encounters, edges: what the robot measured of others.
        init: initial guess of the solve, as in `clew.optimize`.

    Raises:
        InputError: the graph has no pose or poses of two kinds, two landmarks of one identity, an identity for
            no landmark, or measurements that leave the landmarks free.
    """
    kinds = [kind for kind in (SE2, SE3) if len(graph.keys(kind))]
    if len(kinds) != 1:
        raise InputError(f"robot {name}: a graph to be merged needs poses of one kind, this one has "
                         f"{' and '.join(kind.name for kind in kinds) or 'none'}")
    keys = graph.keys(Point2)
    identities = identities or {}
    names = np.array([identities.get(int(key), "") for key in keys], dtype=np.str_).reshape(len(keys))
    strangers = set(identities) - set(keys.tolist())
    if strangers:
        raise InputError(f"robot {name}: identities for keys that are no landmarks of its graph: "
                         f"{_some(map(str, sorted(strangers)))}")
    known, counts = np.unique(names[names != ""], return_counts=True)
    if (counts > 1).any():
        raise InputError(f"robot {name}: two landmarks carry the same identity: {_some(known[counts > 1])}; "
                         "make them one before merging")
    solution = optimize(graph, init=init)
    if len(keys) and solution.status is Status.UNDERCONSTRAINED:
        raise InputError(f"robot {name}: {solution.status.value}")
    return RobotGraph(name, solution, _landmarks(graph, solution, keys, names), encounters, edges)


def _landmarks(graph: FactorGraph, solution: Solution, keys: Index, names: Names) -> LandmarkMap:
    if not len(keys):
        return LandmarkMap(keys, names, np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0, np.int64))
    seen = [block.keys[:, 1] for block in graph.blocks() if block.kinds[1:] == (Point2,)]
    of_key, counts = np.unique(np.concatenate([keys, *seen]), return_counts=True)
    sightings = counts[np.searchsorted(of_key, keys)] - 1
    positions = solution.values(Point2).array
    covariances = _shape_covariances(positions, solution.joint_covariance(keys))
    return LandmarkMap(keys, names, positions, covariances, sightings)


def _shape_covariances(positions: Array, joint: Array) -> Array:
    """Covariances ``(L, 2, 2)`` of the landmarks about the best alignment of the map as a whole.

    What the robot does not know about its start moves all landmarks together and says nothing about their
    distances; Baarda's S-transformation (1973) with the rigid motions of the map as its null space takes it out.
    """
    motions = np.zeros((len(positions), 2, 3))
    motions[:, 0, 0] = motions[:, 1, 1] = 1.0
    centred = positions - positions.mean(axis=0)
    motions[:, 0, 2], motions[:, 1, 2] = -centred[:, 1], centred[:, 0]
    basis = np.linalg.svd(motions.reshape(-1, 3), full_matrices=False)[0]
    projector = np.eye(2 * len(positions)) - basis @ basis.T
    shape = (projector @ joint @ projector).reshape(len(positions), 2, len(positions), 2)
    each = np.arange(len(positions))
    return np.asarray(shape[each, :, each, :])


def _some(names: Any) -> str:
    """The first few names, and how many more there are."""
    texts = [str(name) for name in names]
    return ", ".join(texts[:8]) + (f" and {len(texts) - 8} more" if len(texts) > 8 else "")
