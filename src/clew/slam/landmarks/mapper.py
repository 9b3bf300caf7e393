"""Landmarks without identity: association while the robot drives, looked at again after each solve."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.factors import Between, PointObservation
from clew.geometry import SE2, Point2, se2
from clew.graph import FactorGraph, Role
from clew.noise import information_from_covariance, information_from_matrix
from clew.place import NEW, Gates, joint_compatibility, nearest_neighbour
from clew.slam.landmarks.filter import LandmarkFilter
from clew.slam.landmarks.review import merge_landmarks, reassign
from clew.solve import Solution, optimize

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


#: Redundant measurements before their residuals tell the variance of unit weight, and limits of that.
_ENOUGH = 50
_SMALLEST_UNIT, _LARGEST_UNIT = 0.06, 2.0


@dataclass(frozen=True)
class AssociationConfig:
    """How sightings are told apart.

    Attributes:
        gates: see `clew.place.Gates`.
        joint: tell sightings of one moment apart jointly (branch and bound) rather than each by itself.
        solve_every: sightings between two solves of the graph.
        fewest_sightings: a landmark that was seen less often when the log ends was none, and is removed.
    """

    gates: Gates = field(default_factory=Gates)
    joint: bool = True
    solve_every: int = 200
    fewest_sightings: int = 1


class LandmarkMapper:
    """SLAM with landmarks that all look alike; poses and sightings come one by one.

    Pose keys count from `first_key`; landmark keys follow `landmark_key`. A sighting that is unclear stays without
    landmark until the next solve has shown where it belongs.
    """

    def __init__(
        self, config: AssociationConfig | None = None, *, first_key: int = 0, landmark_key: int = 1_000_000_000
    ) -> None:
        self.config = config or AssociationConfig()
        self.graph = FactorGraph()
        self._pose = int(self.graph.add_pose(SE2(0.0, 0.0, 0.0), key=first_key, constant=True))
        self._next_landmark = landmark_key
        self._filter = LandmarkFilter(np.zeros(3), [], np.zeros((0, 2)), np.zeros((3, 3)))
        self._steps: list[tuple[int, int, Array, Array]] = []  # from, to, motion, information; not in the graph yet
        self._fresh_poses: list[tuple[int, Array]] = []
        self._seen: list[tuple[int, Array, Array]] = []  # pose, sighting, covariance
        self._landmark: list[int] = []  # key of each sighting's landmark, or -1
        self._since = 0
        self._unit = 1.0

    # --- driving
    # ----------------------------------------------------------------------------------------------

    def move(self, key: int, motion: Array, information: Array) -> None:
        """Go on to a new pose with the given key by a motion ``(3,)`` with information ``(3, 3)``."""
        self._filter.move(motion, np.asarray(self._unit * np.linalg.inv(information), np.float64))
        self._steps.append((self._pose, key, motion, information))
        self._fresh_poses.append((key, self._filter.pose))
        self._pose = key

    def see(self, points: ArrayLike, information: ArrayLike) -> Indices:
        """Sightings ``(M, 2)`` from the newest pose, in its frame; all of them at once, for they are different ones.

        Returns:
            Keys ``(M,)`` of the landmarks that they were taken for, -1 where it is unclear.

        Raises:
            InputError: shapes that do not fit, or numbers that are not finite.
        """
        z = np.atleast_2d(np.asarray(points, np.float64))
        if z.ndim != 2 or z.shape[1] != 2 or not np.isfinite(z).all():
            raise InputError(f"see: sightings must be finite and (M, 2), got shape {z.shape}")
        noise = np.asarray(
            np.linalg.inv(information_from_matrix(information, len(z), 2, "see: information")), np.float64
        )
        keys = self._associate(z, np.asarray(self._unit * noise, np.float64))
        for row, key in enumerate(keys.tolist()):
            self._seen.append((self._pose, z[row], noise[row]))
            self._landmark.append(key)
        self._since += len(z)
        if self._since >= self.config.solve_every:
            self.solve()
            keys = np.array(self._landmark[len(self._landmark) - len(z) :])
        return keys

    @property
    def unit_variance(self) -> float:
        """Variance of the measurements as a share of what they claim, from the residuals of the last solve."""
        return self._unit

    def _associate(self, z: Array, noise: Array) -> Indices:
        predicted, own = self._filter.predict_each()
        if self.config.joint and len(z) > 1 and len(predicted):
            distance = ((z[:, None] - predicted[None]) ** 2).sum(axis=2)
            reach = 4.0 * (np.trace(own, axis1=1, axis2=2)[None] + np.trace(noise, axis1=1, axis2=2)[:, None])
            near = np.flatnonzero((distance <= self.config.gates.new * reach).any(axis=0))
            some, joint = self._filter.predict(near)
            found = joint_compatibility(z, some, joint.reshape(2 * len(near), 2 * len(near)), noise, self.config.gates)
            if len(near):
                found = np.where(found >= 0, near[np.maximum(found, 0)], found)
        else:
            found = nearest_neighbour(z, predicted, own, noise, self.config.gates)
        keys = np.full(len(z), -1, np.int64)
        for row, landmark in enumerate(found.tolist()):
            if landmark >= 0:
                keys[row] = self._filter.keys[landmark]
                self._filter.see(landmark, z[row], noise[row])
            elif landmark == NEW:
                keys[row] = self._next_landmark
                self._filter.add(self._next_landmark, z[row], noise[row])
                self._next_landmark += 1
        return keys

    # --- solving
    # ----------------------------------------------------------------------------------------------

    def solve(self, final: bool = False) -> Solution:
        """Bring the graph up to date, solve it, and look at all associations again.

        Args:
            final: the log has ended: remove what has been seen too seldom, and solve to the end.
        """
        self._grow()
        solution = self._optimize(final)
        for _ in range(5 if final else 1):
            changed = self._review(solution)
            if not changed:
                break
            self._write_sightings()
            solution = self._optimize(final)
        if final and self.config.fewest_sightings > 1:
            self._drop_seldom()
            self._write_sightings()
            solution = self._optimize(final)
        self._restart(solution)
        return solution

    def _optimize(self, final: bool) -> Solution:
        tolerance, limit = (1e-9, 100) if final else (1e-3, 8)
        solution = optimize(self.graph, init="file", max_iterations=limit, cost_tolerance=tolerance, update=True)
        used = int(np.sum(np.array(self._landmark, np.int64) >= 0))
        redundancy = 2 * (used - len(self.graph.keys(Point2)))  # a relative pose determines the next pose, no more
        if redundancy >= _ENOUGH:
            self._unit = min(max(solution.chi2 / redundancy, _SMALLEST_UNIT), _LARGEST_UNIT)
        return solution

    def _grow(self) -> None:
        """Move what happened since the last solve into the graph."""
        self._since = 0
        if self._fresh_poses:
            keys, poses = zip(*self._fresh_poses, strict=True)
            self.graph.add_pose(SE2.from_array(np.array(poses)), key=np.array(keys))
            a, b, motion, information = zip(*self._steps, strict=True)
            self.graph.add(Between(np.array(a), np.array(b), np.array(motion), information=np.array(information)))
        self._fresh_poses, self._steps = [], []
        for key, point in zip(self._filter.keys, self._filter.points, strict=True):
            if key not in self.graph:
                self.graph.add_point(point, key=key)
        self._write_sightings()

    def _write_sightings(self) -> None:
        """Replace the sightings in the graph by the associations as they are now."""
        old = list(self.graph.block_ids(Role.OBSERVATION))
        if old:
            self.graph.remove(np.concatenate(old))
        landmark = np.array(self._landmark, np.int64)
        used = np.flatnonzero(landmark >= 0)
        if len(used):
            pose, z, noise = (np.array(column)[used] for column in zip(*self._seen, strict=True))
            information = information_from_covariance(noise, len(used), 2)
            self.graph.add(PointObservation(pose, landmark[used], z, information=information))
        unseen = np.setdiff1d(self.graph.keys(Point2), landmark)
        if len(unseen):
            self.graph.remove_variable(unseen)

    def _review(self, solution: Solution) -> bool:
        """Merge landmarks that are one, and give sightings to the landmark that they fit; whether anything changed."""
        if not self._seen:
            return False
        before = np.array(self._landmark, np.int64)
        pose, z, noise = (np.array(column) for column in zip(*self._seen, strict=True))
        after = merge_landmarks(solution, pose, noise, before, self.config.gates, self._unit)
        if np.array_equal(after, before):
            after, fresh = reassign(solution, pose, z, self._unit * noise, before, self.config.gates)
            for row in fresh[:1].tolist():  # one at a time: the others may be of the same landmark
                after[row] = self._next_landmark
                where = se2.act(solution.value(int(pose[row])).array, z[row])
                self.graph.add_point(where, key=self._next_landmark)
                self._next_landmark += 1
        self._landmark = after.tolist()
        return not np.array_equal(after, before)

    def _drop_seldom(self) -> None:
        landmark = np.array(self._landmark, np.int64)
        keys, counts = np.unique(landmark, return_counts=True)
        seldom = keys[counts < self.config.fewest_sightings]
        landmark[np.isin(landmark, seldom)] = -1
        self._landmark = landmark.tolist()

    def _restart(self, solution: Solution) -> None:
        """Take over pose, landmarks and their joint marginal from the graph."""
        keys = solution.keys(Point2) if Point2 in solution.kinds else np.empty(0, np.int64)
        points = solution.values(Point2).array.copy() if len(keys) else np.zeros((0, 2))
        covariance = self._unit * solution.joint_covariance([self._pose, *keys.tolist()])
        self._filter = LandmarkFilter(solution.value(self._pose).array, keys.tolist(), points, covariance)

    # --- results
    # ----------------------------------------------------------------------------------------------

    @property
    def landmarks(self) -> Indices:
        """Key ``(K,)`` of each sighting's landmark in the order in which they came, -1 for those of none."""
        return np.array(self._landmark, np.int64)


def associate_features(
    graph: FactorGraph, pose: Indices, points: Array, information: Array, config: AssociationConfig | None = None
) -> tuple[LandmarkMapper, Solution]:
    """Drive along a graph's odometry and associate features seen on the way.

    Args:
        graph: poses in the plane, each tied to the one before it by a relative pose.
        pose: ``(K,)`` key of the pose of each feature (`clew.io.Features`).
        points: ``(K, 2)`` features in the frame of the pose, metres.
        information: ``(K, 2, 2)``.
        config: see `AssociationConfig`.

    Returns:
        The mapper, whose `landmarks` are in the order of the features, and the solution of its graph.

    Raises:
        InputError: a pose that no relative pose ties to the one before it, or no features.
    """
    if len(pose) == 0:
        raise InputError("there are no features to associate; the file holds none")
    keys = np.sort(graph.keys(SE2))
    steps: dict[int, tuple[Array, Array]] = {}
    for block in graph.blocks():
        if isinstance(block, Between):
            place = np.searchsorted(keys, block.keys)
            for row in np.flatnonzero(place[:, 1] - place[:, 0] == 1).tolist():
                steps[int(block.keys[row, 1])] = (block.measurement[row], block.information[row])
    missing = [int(key) for key in keys[1:] if int(key) not in steps]
    if missing:
        raise InputError(f"pose {missing[0]} has no relative pose to the one before it; give a graph with odometry")
    order = np.argsort(pose, kind="stable")
    bounds = np.searchsorted(pose[order], keys, side="left"), np.searchsorted(pose[order], keys, side="right")
    mapper = LandmarkMapper(config, first_key=int(keys[0]), landmark_key=int(keys[-1]) + 1)
    for key, first, last in zip(keys.tolist(), *(bound.tolist() for bound in bounds), strict=True):
        if key != keys[0]:
            mapper.move(key, *steps[key])
        if last > first:
            rows = order[first:last]
            mapper.see(points[rows], information[rows])
    solution = mapper.solve(final=True)
    back = np.empty(len(order), np.int64)
    back[order] = mapper.landmarks
    mapper._landmark = back.tolist()
    return mapper, solution
