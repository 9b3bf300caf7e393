"""Finding loop closures and deciding which to believe."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.geometry import se2
from clew.place import Closure, Submap, Verdict, VerificationOptions, agree, build_submap, describe, similarity, verify
from clew.scan import without_normal_noise
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.pose_graph import LEAST_INFORMATION, PoseGraph
from clew.slam.sensor import SensorModel

Array = NDArray[np.float64]

QUERY_VOXEL = 0.05  # metres
FLOOR = np.diag([0.05, 0.05, 0.02]) ** 2  # covariance that any prediction has at least
NOISY = 2.0  # the residual of a match may be so many deviations of a return
SHORTLIST = 12  # nearest candidates whose uncertainty and appearance are looked at


@dataclass
class _Accepted:
    closure: Closure
    factor: int


class LoopCloser:
    """Proposes closures of the newest keyframe with older ones and adds to the graph those that are confirmed.

    A candidate must look alike, match a submap in one place only, overlap, and not contradict free space
    (`clew.place.verify`); it must agree with the graph within its uncertainty; and, unless it hardly moves the robot,
    it waits until others from different places agree with it. After optimisation, a closure that no longer fits
    is withdrawn.
    """

    def __init__(self, keyframes: KeyframeStore, graph: PoseGraph, config: SlamConfig, sensor: SensorModel) -> None:
        self._keyframes = keyframes
        self._graph = graph
        self._config = config
        self._sensor = sensor
        self._submaps: OrderedDict[int, Submap] = OrderedDict()
        self._descriptors: dict[int, Array] = {}
        self._accepted: list[_Accepted] = []
        self._waiting: list[Closure] = []
        self._rejected: list[Closure] = []
        self._last_attempt = -np.inf
        self._pending = 0  # closures since the last optimisation

    @property
    def accepted(self) -> list[Closure]:
        """Closures that the graph holds."""
        return [a.closure for a in self._accepted]

    @property
    def rejected(self) -> list[Closure]:
        """Candidates that were turned down, with the reason; those that still wait are among them."""
        return self._rejected + self._waiting

    def attempt(self) -> bool:
        """Look for closures of the newest keyframe; whether keyframes have moved.

        Closures that change next to nothing are optimised a few at a time (`settle`).
        """
        options = self._config.closing
        source = len(self._keyframes) - 1
        path = self._keyframes[source].path
        if path - self._last_attempt < options.every:
            return False
        anchors = self._older_anchors(source)
        if not len(anchors):
            return False
        self._last_attempt = path
        members = np.arange(max(0, source + 1 - options.query_keyframes), source + 1)
        query = self._keyframes.surfels(source, members, QUERY_VOXEL)
        appearance = describe(query.points)
        anchors, covariances = self._candidates(source, anchors, appearance)
        if not len(anchors):
            return False
        alike = self._similarities(anchors, appearance)
        order = np.argsort(-alike, kind="stable")
        order = order[alike[order] >= options.similarity][: options.candidates]
        poses = self._graph.poses
        worth = self._sensor.return_information(options.information_scale)
        proposals = []
        for i in order:
            window = self._window(covariances[i])
            T_predicted = se2.between(poses[anchors[i]], poses[source])
            closure = verify(
                self._submap(int(anchors[i])), query, source, T_predicted, window,
                np.linalg.inv(covariances[i] + FLOOR) / worth, float(alike[i]),
                self._verification(), self._sensor.alignment,
            )  # fmt: skip
            proposals.append(self._gate(closure, T_predicted, covariances[i]))
        return self._decide(proposals)

    # --- candidates -------------------------------------------------------------------------------------------------

    def _older_anchors(self, source: int) -> NDArray[np.int64]:
        """Anchors whose submaps are complete, a good stretch of path before the source."""
        options = self._config.closing
        paths = self._keyframes.paths
        last = min(source - options.submap_keyframes, int(np.searchsorted(paths, paths[source] - options.path)))
        return np.arange(0, max(last, 0), options.anchor_every, dtype=np.int64)

    def _candidates(
        self, source: int, anchors: NDArray[np.int64], appearance: Array
    ) -> tuple[NDArray[np.int64], Array]:
        """Anchors that may be near the source, given its uncertainty, with relative covariances.

        The nearest ones; and while the robot may be far from where it is believed, those within its uncertainty
        that look most alike.
        """
        options = self._config.closing
        poses = self._graph.poses
        tree = cKDTree(poses[anchors, :2])
        position = poses[source, :2]
        ceiling = options.window_ceiling[0] + options.reach
        found = tree.query(position, k=SHORTLIST, distance_upper_bound=ceiling)
        near = anchors[np.asarray(found[1])[np.isfinite(found[0])]]
        if not len(near):
            return near, np.zeros((0, 3, 3))
        covariances, spread = self._uncertainty(source, near)
        if spread.max() > options.reach:
            within = tree.query_ball_point(position, min(options.reach + float(spread.max()), ceiling))
            wide = np.setdiff1d(anchors[np.asarray(within, dtype=np.int64)], near)
            alike = self._similarities(wide, appearance)
            wide = wide[np.argsort(-alike, kind="stable")[:SHORTLIST]]
            if len(wide):
                near = np.concatenate([near, wide])
                covariances, spread = self._uncertainty(source, near)
        possible = np.hypot(*(poses[near, :2] - position).T) <= options.reach + spread
        return near[possible], covariances[possible]

    def _uncertainty(self, source: int, anchors: NDArray[np.int64]) -> tuple[Array, Array]:
        """Covariances ``(A, 3, 3)`` of the source seen from anchors, and how far off it may be, metres."""
        covariances = self._config.closing.caution * self._graph.relative_covariances(source, anchors)
        return covariances, self._config.closing.sigmas * np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1])

    def _similarities(self, anchors: NDArray[np.int64], appearance: Array) -> Array:
        if not len(anchors):
            return np.zeros(0)
        return similarity(np.stack([self._describe(int(a)) for a in anchors]), appearance)

    def _window(self, covariance: Array) -> Array:
        options = self._config.closing
        sigma = np.sqrt(np.array([covariance[0, 0] + covariance[1, 1], covariance[2, 2]]))
        half = np.clip(options.sigmas * sigma, options.window_floor, options.window_ceiling)
        return np.array([half[0], half[0], half[1]])

    def _members(self, anchor: int) -> NDArray[np.int64]:
        half = self._config.closing.submap_keyframes
        return np.arange(max(0, anchor - half), min(len(self._keyframes), anchor + half + 1))

    def _submap(self, anchor: int) -> Submap:
        if anchor in self._submaps:
            self._submaps.move_to_end(anchor)
            return self._submaps[anchor]
        members = self._members(anchor)
        submap = build_submap(
            anchor, self._keyframes.clouds(members), self._keyframes.relative(anchor, members),
            self._keyframes.sensors(members),
        )  # fmt: skip
        self._submaps[anchor] = submap
        if len(self._submaps) > self._config.closing.cached_submaps:
            self._submaps.popitem(last=False)
        return submap

    def _describe(self, anchor: int) -> Array:
        if anchor not in self._descriptors:
            surfels = self._keyframes.surfels(anchor, self._members(anchor), QUERY_VOXEL)
            self._descriptors[anchor] = describe(surfels.points)
        return self._descriptors[anchor]

    # --- decisions --------------------------------------------------------------------------------------------------

    def _gate(self, closure: Closure, T_predicted: Array, covariance: Array) -> Closure:
        """Agreement with the graph: the innovation against its covariance."""
        if closure.verdict is not Verdict.WAITING:
            return closure
        error = se2.between(T_predicted, closure.T_target_source)
        distance = float(error @ np.linalg.solve(covariance + FLOOR, error))
        if distance > self._config.closing.gate:
            return replace(closure, verdict=Verdict.DISAGREES)
        return closure

    def _decide(self, proposals: list[Closure]) -> bool:
        """Confirm what has support; keep waiting what may still get it."""
        self._rejected += [p for p in proposals if p.verdict is not Verdict.WAITING]
        candidates = [p for p in proposals if p.verdict is Verdict.WAITING]
        if not candidates:
            self._expire()
            return False
        best = max(candidates, key=lambda c: c.likelihood * c.overlap)
        if any(not self._agree(best, c) for c in candidates):
            self._rejected += [replace(c, verdict=Verdict.AMBIGUOUS) for c in candidates]
            self._expire()
            return False
        supporters: list[Closure] = []
        if not self._is_tracked(best):
            supporters = [w for w in self._waiting if w.source != best.source and self._agree(best, w)]
            if len({w.source for w in supporters}) < self._config.closing.supporters:
                self._waiting += candidates
                self._expire()
                return False
        for closure in [best, *supporters]:
            self._accept(closure)
        self._rejected += [replace(c, verdict=Verdict.REDUNDANT) for c in candidates if c is not best]
        taken = {id(closure) for closure in supporters}
        self._waiting = [w for w in self._waiting if id(w) not in taken]
        self._expire()
        self._pending += 1
        options = self._config.closing
        settled = best.innovation[0] < options.settled[0] and best.innovation[1] < options.settled[1]
        if settled and self._pending < options.batch:
            return False
        self.settle()
        return True

    def settle(self) -> None:
        """Optimise with the closures that were accepted since the last time, and withdraw what no longer fits."""
        if self._pending:
            self._pending = 0
            self._graph.optimise()
            self._withdraw()

    def _is_tracked(self, closure: Closure) -> bool:
        distance, angle = self._config.closing.tracked
        return bool(self._accepted) and closure.innovation[0] < distance and closure.innovation[1] < angle

    def _agree(self, a: Closure, b: Closure) -> bool:
        keyframes = self._keyframes
        path = abs(keyframes[a.source].path - keyframes[b.source].path) + abs(
            keyframes[a.target].path - keyframes[b.target].path
        )
        T_source = se2.between(keyframes[a.source].T_local_robot, keyframes[b.source].T_local_robot)
        poses = self._graph.poses
        T_target = se2.between(poses[a.target], poses[b.target])
        return agree(a, b, T_source, T_target, path, self._config.consistency)

    def _expire(self) -> None:
        """Turn down what has waited in vain."""
        path = self._keyframes[len(self._keyframes) - 1].path - self._config.closing.support_path
        old = [w for w in self._waiting if self._keyframes[w.source].path < path]
        self._rejected += [replace(w, verdict=Verdict.ALONE) for w in old]
        self._waiting = [w for w in self._waiting if self._keyframes[w.source].path >= path]

    def _accept(self, closure: Closure) -> None:
        information = self._information(closure.information)
        closure = replace(closure, verdict=Verdict.CONFIRMED)
        self._accepted.append(_Accepted(closure, self._graph.add_closure(closure, information)))

    def _information(self, of_returns: Array) -> Array:
        """What closures ``(..., 3, 3)`` tell the graph."""
        worth = self._sensor.return_information(self._config.closing.information_scale)
        return worth * without_normal_noise(of_returns, self._sensor.normal_variance) + LEAST_INFORMATION

    def _verification(self) -> VerificationOptions:
        """The limits, the one on residuals no tighter than the noise of returns allows."""
        options = self._config.verification
        return replace(options, rms=max(options.rms, NOISY * self._sensor.return_deviation))

    def _withdraw(self) -> None:
        """Take out closures that the optimised graph contradicts."""
        if not self._accepted:
            return
        poses = self._graph.poses
        closures = [a.closure for a in self._accepted]
        measured = np.stack([c.T_target_source for c in closures])
        information = self._information(np.stack([c.information for c in closures]))
        between = se2.between(poses[[c.target for c in closures]], poses[[c.source for c in closures]])
        error = se2.between(measured, between)
        residual = np.einsum("mi,mij,mj->m", error, information, error)
        contradicted = residual > self._config.closing.residual
        if not contradicted.any():
            return
        for accepted in (self._accepted[i] for i in np.flatnonzero(contradicted)):
            self._graph.remove(accepted.factor)
            self._rejected.append(replace(accepted.closure, verdict=Verdict.WITHDRAWN))
        self._accepted = [self._accepted[i] for i in np.flatnonzero(~contradicted)]
        self._graph.optimise()
