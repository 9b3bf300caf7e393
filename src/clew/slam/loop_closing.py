"""Finding loop closures and deciding which to believe."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place import Closure, Verdict, VerificationOptions, agree, look_back, verify
from clew.scan import without_normal_noise
from clew.slam.closure_log import ClosureLog
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.loop_candidates import Candidate, find_candidates
from clew.slam.loop_uncertainty import deformation, way_covariance
from clew.slam.places import Places, Query
from clew.slam.pose_graph import LEAST_INFORMATION, PoseGraph
from clew.slam.sensor import SensorModel

Array = NDArray[np.float64]

MISSES = 4  # keyframes in a row that still cannot be closed, after which no more are tried
FLOOR = np.diag([0.05, 0.05, 0.02]) ** 2  # covariance that any prediction has at least
NOISY = 2.0  # the residual of a match may be so many deviations of a return


@dataclass
class _Accepted:
    closure: Closure
    factor: int


class LoopCloser:
    """Proposes closures of the newest keyframe with older ones and adds to the graph those that are confirmed.

    A candidate must look alike, match a submap in one place only, overlap, and not contradict free space
    (`clew.place.verify`); it must agree with the graph within its uncertainty; and, unless it hardly moves a robot
    whose place is certain, it waits until others agree with it that share no scan with it. Keyframes that could not be
    closed, because several places looked alike, are tried again once the robot knows where it is. After optimisation,
    a closure that no longer fits is withdrawn.
    """

    def __init__(self, keyframes: KeyframeStore, graph: PoseGraph, config: SlamConfig, sensor: SensorModel) -> None:
        self._keyframes = keyframes
        self._graph = graph
        self._config = config
        self._sensor = sensor
        self._places = Places(keyframes, config)
        self._accepted: list[_Accepted] = []
        self._past = ClosureLog()  # believed, and taken into the graph for good: a keyframe of theirs was pruned
        self._waiting: list[Closure] = []
        self._rejected = ClosureLog()
        self._open: deque[int] = deque(maxlen=config.closing.open_sources)
        self._last_attempt = -np.inf
        self._pending = 0  # closures since the last optimisation

    @property
    def accepted(self) -> list[Closure]:
        """Closures that are believed."""
        return [*self._past, *(a.closure for a in self._accepted)]

    @property
    def accepted_count(self) -> int:
        """How many closures are believed."""
        return len(self._past) + len(self._accepted)

    @property
    def rejected(self) -> list[Closure]:
        """Candidates that were turned down, with the reason; those that still wait are among them."""
        return [*self._rejected, *self._waiting]

    @property
    def needed(self) -> set[int]:
        """Keyframes of closures that still wait, and those that are to be tried again."""
        return {k for w in self._waiting for k in (w.source, w.target)}.union(self._open)

    def forget(self, keyframes: list[int]) -> None:
        """Keyframes have been pruned: what their closures said is in the graph for good."""
        gone = set(keyframes)
        self._places.forget(keyframes)
        ended = [a for a in self._accepted if a.closure.source in gone or a.closure.target in gone]
        if ended:
            self._past.add(a.closure for a in ended)
            over = {id(a) for a in ended}
            self._accepted = [a for a in self._accepted if id(a) not in over]

    def attempt(self, known: bool = False) -> bool:
        """Look for closures of the newest keyframe; whether keyframes have moved.

        Closures that change next to nothing are optimised a few at a time (`settle`).

        Args:
            known: the place has been seen often: one more closure says little, so that attempts are rarer.
        """
        source = len(self._keyframes) - 1
        path = self._keyframes[source].path
        options = self._config.closing
        if path - self._last_attempt < (options.every_known if known else options.every):
            return False
        if not self._places.end(source):
            return False
        self._last_attempt = path
        proposals = self._propose(source)
        self._expire()
        if not proposals:
            return False
        accepted = len(self._accepted)
        moved = self._decide(proposals)
        if len(self._accepted) == accepted:
            self._open.append(source)
        elif len(self._accepted) > accepted + 1:  # with its supporters
            closed = {a.closure.source for a in self._accepted[accepted:]}
            self._open = deque((k for k in self._open if k not in closed), self._open.maxlen)
            self._catch_up()
        return moved

    def _propose(self, source: int) -> list[Closure]:
        """Match a keyframe against the places where it may be."""
        query = self._places.query(source)
        candidates = find_candidates(self._graph, self._places, query, self._config.closing)
        return [self._match(query, candidate) for candidate in candidates]

    def _match(self, query: Query, candidate: Candidate) -> Closure:
        """The evidence for one candidate."""
        verification = self._verification()
        submap = self._places.submap(candidate.anchor)
        worth = self._sensor.return_information(self._config.closing.information_scale)
        prior = np.linalg.inv(candidate.covariance + FLOOR) / worth
        closure = verify(
            submap, query.surfels, query.source, candidate.T_predicted, candidate.centre, candidate.half_window, prior,
            candidate.similarity, verification, self._sensor.alignment, may_slide=candidate.is_near,
        )  # fmt: skip
        if closure.verdict is not Verdict.WAITING:
            return closure
        closure = look_back(closure, submap, self._places.submap_of(query.source, query.members), verification)
        closure = replace(closure, information=self._information(closure), is_certain=candidate.is_certain)
        return self._gate(closure, candidate)

    def _information(self, closure: Closure) -> Array:
        """What a match is worth to the graph: that of its returns, and of the ways along which they were seen."""
        worth = self._sensor.return_information(self._config.closing.information_scale)
        of_returns = without_normal_noise(closure.information, self._sensor.normal_variance)
        information = worth * of_returns + LEAST_INFORMATION
        bent = deformation(self._keyframes, closure, self._config.closing)
        return np.asarray(np.linalg.inv(np.linalg.inv(information) + bent), dtype=np.float64)

    def finish(self) -> None:
        """Try all keyframes once more that could not be closed, until no more can, now that the whole way is known."""
        before = -1
        while self.accepted_count > before:
            before = self.accepted_count
            self.settle()
            self._catch_up(len(self._open))

    def _catch_up(self, patience: int = MISSES) -> None:
        """Try keyframes again that could not be closed, the latest first, now that the robot knows where it is.

        Each that is closed makes the ones before it certain in turn.

        Args:
            patience: after so many in a row that still cannot be closed, no more are tried.
        """
        left: list[int] = []
        missed = 0
        while self._open and missed < patience:
            source = self._open.pop()
            accepted = len(self._accepted)
            query = self._places.query(source)
            candidates = find_candidates(self._graph, self._places, query, self._config.closing)
            if any(c.is_near for c in candidates):  # otherwise the robot could still be in another place
                proposals = [self._match(query, candidate) for candidate in candidates]
                if any(p.is_certain or p.is_partial for p in proposals):
                    self._waiting = [w for w in self._waiting if w.source != source]
                    self._rejected.forget(source)
                    self._decide(proposals)
                    self.settle()
            if len(self._accepted) > accepted:
                missed = 0
            else:
                missed += 1
                left.append(source)
        self._open.extend(reversed(left))

    # --- decisions --------------------------------------------------------------------------------------------------

    def _gate(self, closure: Closure, candidate: Candidate) -> Closure:
        """Agreement with the graph: the innovation against its covariance."""
        error = se2.between(candidate.T_predicted, closure.T_target_source)
        distance = float(error @ np.linalg.solve(candidate.covariance + FLOOR, error))
        disagrees = closure.verdict is Verdict.WAITING and distance > self._config.closing.gate
        return replace(closure, distance=distance, verdict=Verdict.DISAGREES if disagrees else closure.verdict)

    def _decide(self, proposals: list[Closure]) -> bool:
        """Confirm what has support, keep waiting what may still get it; whether keyframes have moved."""
        candidates = [p for p in proposals if p.verdict is Verdict.WAITING]
        self._rejected.add(p for p in proposals if p.verdict is not Verdict.WAITING)
        if not candidates:
            return False
        best = max(candidates, key=lambda c: (not c.is_partial, c.likelihood * c.overlap))
        if any(not self._agree(best, rival) for rival in self._rivals(best, proposals)):
            self._rejected.add(replace(c, verdict=Verdict.AMBIGUOUS) for c in candidates)
            return False
        supporters = [] if self._is_tracked(best) else self._supporters(best)
        if supporters is None:
            self._waiting += candidates
            return False
        for closure in [best, *supporters]:
            self._accept(replace(closure, supporters=len(supporters)))
        self._rejected.add(replace(c, verdict=Verdict.REDUNDANT) for c in candidates if c is not best)
        taken = {id(closure) for closure in supporters}
        self._waiting = [w for w in self._waiting if id(w) not in taken]
        self._pending += 1
        options = self._config.closing
        settled = best.innovation[0] < options.settled[0] and best.innovation[1] < options.settled[1]
        if settled and not supporters and self._pending < options.batch:
            return False
        self.settle()
        return True

    def _rivals(self, best: Closure, proposals: list[Closure]) -> list[Closure]:
        """What must agree with the best proposal: all others that stand, and while the robot may be anywhere those
        that match as well, though at several poses."""
        ratio = self._config.verification.rival_ratio
        return [p for p in proposals if p.verdict is Verdict.WAITING or (
            p.verdict is Verdict.AMBIGUOUS and not best.is_certain and p.likelihood >= ratio * best.likelihood)]

    def _supporters(self, best: Closure) -> list[Closure] | None:
        """Waiting closures that agree with one, one for each stretch of path; None if they are too few.

        One of a robot whose place is certain may count on those that are believed, as well as on those that wait.
        """
        options = self._config.closing
        paths = self._keyframes.paths
        believed = [a.closure for a in self._accepted] if best.is_certain else []
        others = [c for c in [*self._waiting, *believed] if c.source != best.source and not c.is_partial
                  and abs(paths[c.source] - paths[best.source]) <= options.support_path]
        agreeing = [c for c in others if self._agree(best, c, self._freedom(best, c))]
        chosen = [best]
        for closure in sorted(agreeing, key=lambda w: w.likelihood * w.overlap, reverse=True):
            path = paths[closure.source]
            if all(abs(path - paths[c.source]) >= options.support_apart for c in chosen):
                chosen.append(closure)
        if len(chosen) <= options.supporters:
            return None
        return [c for c in chosen[1:] if c.verdict is Verdict.WAITING]

    def _freedom(self, a: Closure, b: Closure) -> Array:
        """Covariance ``(3, 3)`` of the way between two closures, in the axes of the second's source.

        That of the sources by their steps; of the targets too where they are on one stretch of path.
        """
        options, paths = self._config.closing, self._keyframes.paths
        total = way_covariance(self._keyframes, b.source, min(a.source, b.source), max(a.source, b.source), 0.0)
        if abs(paths[a.target] - paths[b.target]) <= options.support_path:
            first, last = min(a.target, b.target), max(a.target, b.target)
            total += way_covariance(self._keyframes, b.target, first, last, -float(b.T_target_source[2]))
        return options.caution * total

    def settle(self) -> None:
        """Optimise with the closures that were accepted since the last time, and withdraw what no longer fits."""
        if self._pending:
            self._pending = 0
            self._graph.optimise()
            self._withdraw()

    def _is_tracked(self, closure: Closure) -> bool:
        distance, angle = self._config.closing.tracked
        known = closure.is_certain or closure.is_partial  # the latter tells nothing of what is not known
        return known and bool(self._accepted) and closure.innovation[0] < distance and closure.innovation[1] < angle

    def _agree(self, a: Closure, b: Closure, freedom: Array | None = None) -> bool:
        paths = self._keyframes.paths
        path = abs(paths[a.source] - paths[b.source]) + abs(paths[a.target] - paths[b.target])
        T_source = self._keyframes.relative(a.source, np.array([b.source]))[0]
        poses = self._graph.poses
        T_target = se2.between(poses[a.target], poses[b.target])
        return agree(a, b, T_source, T_target, path, self._config.consistency, freedom)

    def _expire(self) -> None:
        """Turn down what has waited in vain."""
        paths = self._keyframes.paths
        path = paths[-1] - self._config.closing.support_path
        self._rejected.add(replace(w, verdict=Verdict.ALONE) for w in self._waiting if paths[w.source] < path)
        self._waiting = [w for w in self._waiting if paths[w.source] >= path]

    def _accept(self, closure: Closure) -> None:
        closure = replace(closure, verdict=Verdict.CONFIRMED)
        self._accepted.append(_Accepted(closure, self._graph.add_closure(closure, closure.information)))

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
        information = np.stack([c.information for c in closures])
        between = se2.between(poses[[c.target for c in closures]], poses[[c.source for c in closures]])
        error = se2.between(measured, between)
        residual = np.einsum("mi,mij,mj->m", error, information, error)
        contradicted = residual > self._config.closing.residual
        if not contradicted.any():
            return
        for accepted in (self._accepted[i] for i in np.flatnonzero(contradicted)):
            self._graph.remove(accepted.factor)
            self._rejected.add([replace(accepted.closure, verdict=Verdict.WITHDRAWN)])
        self._accepted = [self._accepted[i] for i in np.flatnonzero(~contradicted)]
        self._graph.optimise()
