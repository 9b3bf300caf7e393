"""What a picture of a factor graph shows, taken from a graph or its solution."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.evaluate import FactorResiduals
from clew.geometry import SE2, SE3, Point2, Point3, so2, so3
from clew.graph import FactorGraph, Role
from clew.solve import Solution

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Role of the edges that a solver did not believe, beside those of `clew.graph.Role`.
REJECTED_ROLE = "rejected"
_DOUBTED = 0.1  # robust weight below which an edge counts as rejected


@dataclass(frozen=True, eq=False)
class Scene:
    """Positions of poses, landmarks and edges, in the plane (``d = 2``) or in space (``d = 3``).

    Attributes:
        poses: ``(N, d)`` metres, world frame.
        edges: for each role (`clew.graph.Role`, its value, or "rejected") the ``(M, 2, d)`` positions of both
            ends of its edges.
        points: ``(P, d)`` landmarks.
        pose_covariances: ``(N, d, d)`` of the poses' positions, world frame, or None.
        point_covariances: ``(P, d, d)`` of the landmarks, or None.
        robots: names, if there are several robots.
        robot_of_pose: ``(N,)`` number of the robot of each pose, -1 for none; with `robots`.
        robot_of_edge: ``(M,)`` likewise for the odometry edges.

    Raises:
        InputError: the shapes do not fit together, or a number is not finite.
    """

    poses: Array
    edges: Mapping[str, Array] = field(default_factory=dict)
    points: Array | None = None
    pose_covariances: Array | None = None
    point_covariances: Array | None = None
    robots: Sequence[str] = ()
    robot_of_pose: Index | None = None
    robot_of_edge: Index | None = None

    def __post_init__(self) -> None:
        poses = np.asarray(self.poses, dtype=np.float64)
        dim = poses.shape[-1]
        points = np.zeros((0, dim)) if self.points is None else np.asarray(self.points, dtype=np.float64)
        edges = {str(getattr(role, "value", role)): np.asarray(ends, dtype=np.float64)
                 for role, ends in self.edges.items()}
        fits = poses.ndim == 2 and dim in (2, 3) and points.ndim == 2 and points.shape[1] == dim
        if not fits or any(ends.ndim != 3 or ends.shape[1:] != (2, dim) for ends in edges.values()):
            raise InputError("a picture of a graph needs poses (N, d), landmarks (P, d) and edges (M, 2, d) with "
                             "d = 2 or 3")
        for what, given, count in (("poses", self.pose_covariances, len(poses)),
                                   ("landmarks", self.point_covariances, len(points))):
            if given is not None and given.shape != (count, dim, dim):
                raise InputError(
                    f"ellipses of {count} {what} need covariances ({count}, {dim}, {dim}), not {given.shape}"
                )
        for what, numbers, count in (("poses", self.robot_of_pose, len(poses)),
                                     ("odometry edges", self.robot_of_edge, len(edges.get("odometry", ())))):
            if numbers is not None and np.shape(numbers) != (count,):
                raise InputError(f"give the robot of each of the {count} {what}, not {np.shape(numbers)}")
        covariances = {"pose covariances": self.pose_covariances, "landmark covariances": self.point_covariances}
        for name, values in {"poses": poses, "landmarks": points, **covariances, **edges}.items():
            if values is not None and not np.isfinite(values).all():
                raise InputError(f"a picture of a graph needs finite positions; some {name} are not")
        for name, value in (("poses", poses), ("points", points), ("edges", edges)):
            object.__setattr__(self, name, value)

    @property
    def landmarks(self) -> Array:
        """``(P, d)``; empty if there are none."""
        return np.zeros((0, self.dim)) if self.points is None else self.points

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.poses.shape[1])


def graph_scene(
    graph: FactorGraph,
    *,
    robots: Mapping[str, ArrayLike] | None = None,
    rejected: ArrayLike | None = None,
    residuals: FactorResiduals | None = None,
) -> Scene:
    """The scene of a graph at its current values.

    Args:
        graph: poses of one kind, landmarks, and the factors between them.
        robots: keys of the poses of each robot, by its name.
        rejected: ``(R, 2)`` keys of the poses of edges that were not believed and are not in the graph.
        residuals: of `clew.evaluate.factor_residuals`; edges with a weight below a tenth count as rejected too.

    Raises:
        InputError: poses or landmarks of two kinds, or a key that is not in the graph.
    """
    tables = {table.kind: table for table in graph.variables() if len(table.keys)}
    where = {kind: table.values[:, : kind.space] for kind, table in tables.items()}
    poses = _only(where, (SE2, SE3), "poses")
    points = _only(where, (Point2, Point3), "landmarks")
    dim = 3 if SE3 in where or Point3 in where else 2
    parts: dict[str, list[Array]] = {}
    firsts = []
    for block, ids in zip(graph.blocks(), graph.block_ids(), strict=True):
        if len(block.kinds) > 1 and all(kind in where for kind in block.kinds[:2]):
            rows = graph.positions(block.keys)
            ends = np.stack([where[kind][rows[:, n]] for n, kind in enumerate(block.kinds[:2])], axis=1)
            believed = _believed(ids, residuals)
            parts.setdefault(block.role.value, []).append(ends[believed])
            parts.setdefault(REJECTED_ROLE, []).append(ends[~believed])
            if block.role is Role.ODOMETRY:
                firsts.append(block.keys[believed, 0])
    if rejected is not None and len(keys := np.asarray(rejected, dtype=np.int64).reshape(-1, 2)):
        kind = graph.kind(int(keys[0, 0]))
        parts.setdefault(REJECTED_ROLE, []).append(where[kind][graph.positions(keys)])
    edges = {role: np.concatenate(ends) for role, ends in parts.items()}
    names, of_pose, of_edge = tuple(robots or ()), None, None
    if robots and poses is not None:
        of_pose = _robot_of(tables[poses].keys, robots)
        of_edge = _robot_of(np.concatenate([*firsts, np.empty(0, np.int64)]), robots)
    return Scene(
        np.zeros((0, dim)) if poses is None else where[poses],
        edges,
        None if points is None else where[points],
        robots=names, robot_of_pose=of_pose, robot_of_edge=of_edge,
    )  # fmt: skip


def solution_scene(
    solution: Solution,
    *,
    covariances: bool = True,
    robots: Mapping[str, ArrayLike] | None = None,
    rejected: ArrayLike | None = None,
    residuals: FactorResiduals | None = None,
) -> Scene:
    """The scene of a solved graph, with how sure its positions are.

    Args:
        solution: of `clew.optimize`.
        covariances: whether to ask for the covariances of poses and landmarks.
        robots: keys of the poses of each robot, by its name.
        rejected: ``(R, 2)`` keys of the poses of edges that were not believed and are not in the graph.
        residuals: of `clew.evaluate.factor_residuals`; edges with a weight below a tenth count as rejected too.

    Raises:
        InputError: the graph changed since it was solved, or measurements that leave variables free have no
            covariances.
    """
    plain = graph_scene(solution.graph, robots=robots, rejected=rejected, residuals=residuals)
    if not covariances:
        return plain
    of_poses = of_points = None
    for kind in solution.kinds:
        block = solution.covariances(kind)[:, : kind.space, : kind.space]
        if kind in (Point2, Point3):
            of_points = block
        else:  # the translation of a pose's tangent is in the pose's own frame
            storage = solution.values(kind).array
            turn = so2.matrix(storage[:, 2:]) if kind is SE2 else so3.matrix(storage[:, 3:])
            of_poses = turn @ block @ np.swapaxes(turn, 1, 2)
    return replace(plain, pose_covariances=of_poses, point_covariances=of_points)


def _only(where: Mapping[type, Array], kinds: tuple[type, ...], what: str) -> type | None:
    found = [kind for kind in kinds if kind in where]
    if len(found) > 1:
        raise InputError(f"the graph has {what} in the plane and in space; draw them one after the other")
    return found[0] if found else None


def _believed(ids: Index, residuals: FactorResiduals | None) -> NDArray[np.bool_]:
    """Which factors keep at least a tenth of their weight."""
    if residuals is None:
        return np.ones(len(ids), dtype=np.bool_)
    return np.asarray(residuals.weight[np.searchsorted(residuals.ids, ids)] >= _DOUBTED)


def _robot_of(keys: Index, robots: Mapping[str, ArrayLike]) -> Index:
    """Number of the robot of each pose, -1 for none."""
    numbers = np.full(len(keys), -1, dtype=np.int64)
    for number, own in enumerate(robots.values()):
        numbers[np.isin(keys, np.asarray(own))] = number
    return numbers
