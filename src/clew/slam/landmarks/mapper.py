"""Landmarks without identity: association while the robot drives, looked at again after each solve."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.factors import Between, PointObservation
from clew.geometry import SE2, Point2, se2
from clew.graph import FactorGraph
from clew.noise import information_from_covariance, information_from_matrix
from clew.place import NEW, Gates, joint_compatibility, nearest_neighbour
from clew.slam.landmarks.components import VarianceComponents, inverted
from clew.slam.landmarks.existence import never_there
from clew.slam.landmarks.filter import LandmarkFilter
from clew.slam.landmarks.linearised import expected_squares
from clew.slam.landmarks.record import Motions, Seen
from clew.slam.landmarks.review import (
    Compared,
    LooseSightings,
    contradicted,
    density_of,
    find_again,
    join,
    join_singles,
    points_of,
)
from clew.solve import Solution, optimize

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_LOG = logging.getLogger(__name__)

_FIRST = 20  # sightings before the first solve, which shows how noisy they are
_SHARE = 0.05  # of all sightings after which the graph of a long log is solved again
_ROUNDS = 30  # of looking at associations again, at most, in one solve
_QUIETER = 2.0  # times that the noise may prove smaller before all is associated again
_MARGIN = 1.5  # of the distance at which landmarks are kept in the filter
_SETTLED = 0.02  # change of a variance component, as a share, that is not worth another solve


@dataclass(frozen=True)
class AssociationConfig:
    """How sightings are told apart.

    Attributes:
        gates: see `clew.place.Gates`.
        solve_every: sightings between two solves of the graph; more in logs so long that this would be often.
    """

    gates: Gates = field(default_factory=Gates)
    solve_every: int = 150


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
        self._motions, self._seen = Motions(), Seen()
        self._fresh_poses: list[tuple[int, Array]] = []
        self._factors: tuple[Between, PointObservation] | None = None
        self._since = self._exhausted = 0
        self._compared = Compared()
        self._squares = (np.empty((0, 2)), np.empty((0, 2, 2)))  # of the sightings at the last solution
        self._density = 0.0
        self._final = False
        self._components = self._associated_with = VarianceComponents()

    # --- driving
    # ----------------------------------------------------------------------------------------------

    def move(self, key: int, motion: Array, information: Array) -> None:
        """Go on to a new pose with the given key by a motion ``(3,)`` with information ``(3, 3)``."""
        self._filter.move(motion, self._components.of_motion(inverted(information)))
        self._motions.append(self._pose, key, motion, information)
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
        noise = inverted(information_from_matrix(information, len(z), 2, "see: information"))
        self._seen.extend(self._pose, z, noise, self._associate(z, self._components.sightings * noise))
        self._since += len(z)
        if self._since >= self._interval:
            self.solve()
        return self.landmarks[len(self._seen) - len(z) :]

    @property
    def _interval(self) -> int:
        """Sightings from one solve to the next: few at first, and a share of all in a long log."""
        seen = len(self._seen)
        return max(min(self.config.solve_every, max(seen // 3, _FIRST)), int(_SHARE * seen))

    @property
    def components(self) -> VarianceComponents:
        """How noisy the measurements are against what their information says, from the residuals of the last solve."""
        return self._components

    @property
    def exhausted(self) -> int:
        """Moments at which the joint association stopped at its limit and took the best that it had found."""
        return self._exhausted

    @property
    def landmarks(self) -> Indices:
        """Key ``(K,)`` of each sighting's landmark in the order in which they came, -1 for those of none."""
        return np.array(self._seen.landmark, np.int64)

    def _replay(self) -> None:
        """Associate everything again from the begin, with the noise as it is known now."""
        first = int(self._motions.keys[0, 0])
        self.graph = FactorGraph()
        self.graph.add_pose(SE2(0.0, 0.0, 0.0), key=first, constant=True)
        self._filter = LandmarkFilter(np.zeros(3), [], np.zeros((0, 2)), np.zeros((3, 3)))
        self._fresh_poses, self._density, self._exhausted = [], 0.0, 0
        self._compared = Compared()
        pose, landmark = self._seen.pose, self._seen.landmark
        covariance = self._components.of_motion(inverted(self._motions.information))
        noise = self._components.sightings * self._seen.noise
        for row, key in enumerate([first, *self._motions.keys[:, 1].tolist()]):
            if row:
                self._filter.move(self._motions.motion[row - 1], covariance[row - 1])
                self._fresh_poses.append((key, self._filter.pose))
            here = slice(*np.searchsorted(pose, [key, key + 1]).tolist())
            if here.start < here.stop:
                landmark[here] = self._associate(self._seen.z[here], noise[here])

    def _associate(self, z: Array, noise: Array) -> Indices:
        predicted, own = self._filter.predict_each()
        gates = self.config.gates
        if len(z) > 1 and len(predicted):
            distance = ((z[:, None] - predicted[None]) ** 2).sum(axis=2)
            reach = 4.0 * (np.trace(own, axis1=1, axis2=2)[None] + np.trace(noise, axis1=1, axis2=2)[:, None])
            near = np.flatnonzero((distance <= gates.limit_new * reach).any(axis=0))
            some, joint = self._filter.predict(near)
            joint = joint.reshape(2 * len(near), 2 * len(near))
            moment = joint_compatibility(z, some, joint, noise, gates, self._density)
            found = moment.landmark
            if moment.exhausted:
                self._exhausted += 1
                _LOG.info("pose %d: %d sightings among %d landmarks can be paired off in more ways than the %d tried",
                          self._pose, len(z), len(near), moment.tried)  # fmt: skip
            if len(near):
                found = np.where(found >= 0, near[np.maximum(found, 0)], found)
        else:
            found = nearest_neighbour(z, predicted, own, noise, gates, self._density)
        keys = np.full(len(z), -1, np.int64)
        known = np.flatnonzero(found >= 0)
        if len(known):
            keys[known] = np.array(self._filter.keys)[found[known]]
            self._filter.see(found[known], z[known], noise[known])
        for row in np.flatnonzero(found == NEW).tolist():
            keys[row] = self._new_key()
            self._filter.add(int(keys[row]), z[row], noise[row])
        return keys

    def _new_key(self) -> int:
        self._next_landmark += 1
        return self._next_landmark - 1

    # --- solving
    # ----------------------------------------------------------------------------------------------

    def solve(self, final: bool = False) -> Solution:
        """Bring the graph up to date, solve it, and look at all associations again.

        Args:
            final: the log has ended: decide what is still unclear, and solve to the end.
        """
        if final:
            self._compared = Compared()  # with all that is known in the end, everything once more
        self._grow()
        solution = self._optimize()
        self._suspected = np.zeros(len(self._seen), bool)
        for _ in range(_ROUNDS):
            if not self._reweigh(solution):
                if self._components.quieter(self._associated_with) > _QUIETER:
                    self._associated_with = self._components
                    self._replay()
                    self._grow()
                elif not self._review(solution, final):
                    break
            solution = self._optimize()
        if final:
            self._rename(join_singles(solution, self._seen))
            landmark = self._seen.landmark
            landmark[np.isin(landmark, never_there(solution, self._seen))] = -1
            self._final = True
            solution = self._optimize(final)
        self._restart(solution)
        return solution

    def _optimize(self, final: bool = False) -> Solution:
        self._write_factors()
        tolerance, limit = (1e-9, 100) if final else (1e-4, 30)
        return optimize(self.graph, init="file", max_iterations=limit, cost_tolerance=tolerance, update=True)

    def _grow(self) -> None:
        """Move what happened since the last solve into the graph."""
        self._since = 0
        if self._fresh_poses:
            keys, poses = zip(*self._fresh_poses, strict=True)
            self.graph.add_pose(SE2.from_array(np.array(poses)), key=np.array(keys))
        self._fresh_poses = []
        for key, point in zip(self._filter.keys, self._filter.points, strict=True):
            if key not in self.graph:
                self.graph.add_point(point, key=key)

    def _write_factors(self) -> None:
        """Replace the measurements in the graph by what they are taken for now."""
        old = list(self.graph.block_ids())
        if old:
            self.graph.remove(np.concatenate(old))
        parts = VarianceComponents() if self._final else self._components
        keys, motion = self._motions.keys, self._motions.motion
        information = parts.motion_information(self._motions.information)
        motions = Between(keys[:, 0], keys[:, 1], motion, information=information)
        if len(keys):
            self.graph.add(motions)
        used = np.flatnonzero(self._seen.landmark >= 0)
        landmark = self._seen.landmark[used]
        noise = information_from_covariance(parts.sightings * self._seen.noise[used], len(used), 2)
        sightings = PointObservation(self._seen.pose[used], landmark, self._seen.z[used], information=noise)
        if len(used):
            self.graph.add(sightings)
        unseen = np.setdiff1d(self.graph.keys(Point2), landmark)
        if len(unseen):
            self.graph.remove_variable(unseen)
        self._factors = (motions, sightings)

    def _reweigh(self, solution: Solution) -> bool:
        """Take the noise from the residuals; whether it changed."""
        assert self._factors is not None
        motions, sightings = self._factors
        if not len(sightings.keys):
            return False
        self._squares = expected_squares(solution, sightings)
        if not len(motions.keys):
            return False
        before = self._components
        self._components = before.updated(solution, motions, sightings, self._squares)
        return self._components.change(before) > _SETTLED

    def _review(self, solution: Solution, final: bool) -> bool:
        """Merge landmarks that are one, and give sightings to the landmark that they fit; whether anything changed."""
        assert self._factors is not None
        landmark = self._seen.landmark
        if not (landmark >= 0).any():
            return False
        if self._rename(join(solution, self._seen, self._compared)):
            return True
        used = np.flatnonzero(landmark >= 0)
        wrong = used[contradicted(self._factors[1], self._squares, self.config.gates)]
        wrong = wrong[~self._suspected[wrong]]
        self._suspected[wrong] = True
        if len(wrong):
            landmark[wrong] = -1
            return True
        return self._find_again(solution, final)

    def _find_again(self, solution: Solution, final: bool) -> bool:
        """Give sightings without a landmark to one, or make one of them."""
        landmark = self._seen.landmark
        loose = np.flatnonzero(landmark < 0)
        keys, counts = np.unique(landmark[landmark >= 0], return_counts=True)
        points = points_of(solution, keys)
        density = density_of(points, counts)
        changed = False
        for pose in np.unique(self._seen.pose[loose]).tolist():
            here = np.flatnonzero(self._seen.pose == pose)
            mine = here[landmark[here] < 0]
            noise = self._components.sightings * self._seen.noise[mine]
            taken = landmark[here][landmark[here] >= 0]
            group = LooseSightings(pose, self._seen.z[mine], noise, taken)
            found = find_again(solution, group, keys, points, self.config.gates, density)
            for row, key in zip(mine.tolist(), found.tolist(), strict=True):
                if key >= 0:
                    landmark[row] = key
                elif key == NEW or final:
                    landmark[row] = self._new_key()
                    where = se2.act(solution.value(pose).array, self._seen.z[row])
                    self.graph.add_point(where, key=int(landmark[row]))
                changed |= bool(landmark[row] >= 0)
        return changed

    def _rename(self, into: dict[int, int]) -> bool:
        """Give the sightings of landmarks that are gone to those that they are; whether there are any."""
        landmark = self._seen.landmark
        for gone, kept in into.items():
            while kept in into:
                kept = into[kept]
            landmark[landmark == gone] = kept
        return bool(into)

    def _restart(self, solution: Solution) -> None:
        """Take over pose, landmarks and their joint marginal from the graph."""
        at = solution.value(self._pose).array
        keys, points = np.empty(0, np.int64), np.zeros((0, 2))
        if Point2 in solution.kinds:
            keys, points = solution.keys(Point2), solution.values(Point2).array
            order = np.argsort(keys)
            keys, points = keys[order], points[order]
            used = self._seen.landmark[self._seen.landmark >= 0]
            self._density = density_of(points, np.bincount(np.searchsorted(keys, used), minlength=len(keys)))
            near = np.linalg.norm(points - at[:2], axis=1) <= self._reach(solution)
            keys, points = keys[near], points[near].copy()
        covariance = solution.joint_covariance([self._pose, *keys.tolist()])
        self._filter = LandmarkFilter(at, keys.tolist(), points, covariance)

    def _reach(self, solution: Solution) -> float:
        """Metres within which landmarks may be seen before the next solve."""
        sight = float(np.linalg.norm(self._seen.z, axis=1).max(initial=0.0))
        back = min(self._interval, len(self._seen))
        since = np.searchsorted(self._motions.keys[:, 1], self._seen.pose[-back])
        driven = float(np.linalg.norm(self._motions.motion[since:, :2], axis=1).sum())
        spread = np.sqrt(np.trace(solution.covariance(self._pose)[:2, :2]))
        return float(_MARGIN * (sight + driven) + 4.0 * spread)
