"""Finding loop closures and deciding which to believe."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place import Closure, Verdict, agree
from clew.slam.closure_log import ClosureLog
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.loop_beliefs import Beliefs
from clew.slam.loop_candidates import find_candidates
from clew.slam.loop_matching import LoopMatcher
from clew.slam.loop_sequences import SequenceMatcher
from clew.slam.loop_uncertainty import way_covariance
from clew.slam.places import Places
from clew.slam.pose_graph import PoseGraph
from clew.slam.sensor import SensorModel

Array = NDArray[np.float64]

MISSES = 4  # keyframes in a row that still cannot be closed, after which no more are tried
ROUNDS = 3  # at most in which all are tried again at the end
DOUBT = 4  # attempts in a row at known places that end in nothing, after which the prediction is doubted for once


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
        self._places = Places(keyframes, config)
        self._matcher = LoopMatcher(keyframes, self._places, config, sensor)
        self._sequences = SequenceMatcher(keyframes, graph, self._places, config)
        self._beliefs = Beliefs(graph, config.closing.residual)
        self._waiting: list[Closure] = []
        self._dissent: list[Closure] = []  # sound, but they disagree with the graph
        self._in_vain = 0  # attempts in a row at known places
        self._rejected = ClosureLog()
        self._open: deque[int] = deque(maxlen=config.closing.open_sources)
        self._last_attempt = -np.inf
        self._pending = 0  # closures since the last optimisation

    @property
    def accepted(self) -> list[Closure]:
        """Closures that are believed."""
        return self._beliefs.everyone

    @property
    def accepted_count(self) -> int:
        """How many closures are believed."""
        return len(self._beliefs)

    @property
    def rejected(self) -> list[Closure]:
        """Candidates that were turned down, with the reason; those that still wait are among them."""
        return [*self._rejected, *self._waiting, *self._dissent]

    @property
    def redundant_count(self) -> int:
        """How many candidates say the same as one that is believed."""
        return self._rejected.count(Verdict.REDUNDANT)

    @property
    def turned_down_count(self) -> int:
        """How many candidates are neither believed nor redundant; those that still wait are among them."""
        return len(self._rejected) + len(self._waiting) + len(self._dissent) - self.redundant_count

    @property
    def needed(self) -> set[int]:
        """Keyframes of closures that still wait, and those that are to be tried again."""
        return {k for w in [*self._waiting, *self._dissent] for k in (w.source, w.target)}.union(self._open)

    def forget(self, keyframes: list[int]) -> None:
        """Keyframes have been pruned: what their closures said is in the graph for good."""
        self._places.forget(keyframes)
        self._beliefs.forget(set(keyframes))

    def look_again(self) -> None:
        """Returns of keyframes have changed."""
        self._places.renew()

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
        if not self._places.can_close(source):
            return False
        self._last_attempt = path
        proposals = self._propose(source)
        self._expire()
        if not proposals:
            return False
        if self._overturn(proposals):
            same = [replace(p, verdict=Verdict.REDUNDANT) for p in proposals if p.verdict is Verdict.WAITING]
            self._rejected.add([*same, *(p for p in proposals if p.verdict is not Verdict.WAITING)])
            return True
        accepted = self.accepted_count
        moved = self._decide(proposals)
        # Where many keyframes stand already, one more need not stay for its closure.
        is_needed = not (known and (self._in_vain or any(p.is_certain for p in proposals)))
        if is_needed and all(c.is_partial for c in self._beliefs.of(source)):
            self._open.append(source)
        if self.accepted_count > accepted + 1:  # with its supporters
            self._reopen({c.source for c in self._beliefs.held[accepted - self.accepted_count :]}, set())
        return moved

    def _reopen(self, closed: set[int], opened: set[int]) -> None:
        """Much has become clear: keyframes that are closed now, others that no longer are, and all those still open."""
        self._open = deque(sorted(opened.union(self._open) - closed), self._open.maxlen)
        self._catch_up()

    def _propose(self, source: int) -> list[Closure]:
        """Match a keyframe against the places where it may be.

        Where several in a row did not find what the graph says must be there, the graph may be wrong: then it is looked
        for farther away.
        """
        query = self._places.query(source)
        candidates = find_candidates(self._graph, self._places, query, self._config.closing)
        proposals = [self._matcher.match(query, candidate) for candidate in candidates]
        in_vain = any(c.is_certain for c in candidates) and all(p.verdict is not Verdict.WAITING for p in proposals)
        self._in_vain = self._in_vain + 1 if in_vain else 0
        if in_vain and self._in_vain % DOUBT == 0:
            reach = self._config.closing.reach
            return [self._matcher.match(query, c.doubted(reach)) for c in candidates if c.is_near]
        return proposals

    def finish(
        self, progress: Callable[[int, int], None] | None = None, stop: Callable[[], bool] | None = None
    ) -> None:
        """Try all keyframes once more that could not be closed, or only in part, now that the whole way is known.

        Args:
            progress: called with how many have been tried, and the most there can be; with 0 first, if there are any.
            stop: asked before each, and before each partial closure in a row, whether to leave the others as they are.
        """
        most, tried = ROUNDS * len(self._open), 0

        def may_go_on() -> bool:
            nonlocal tried
            if progress is not None:
                progress(tried, most)
            tried += 1
            return stop is None or not stop()

        for _ in range(ROUNDS):
            before = self._known()
            self.settle()
            self._catch_up(may_go_on)
            if stop is not None and stop():
                break
            self._match_sequences(stop)
            if self._known() == before:
                break

    def _match_sequences(self, stop: Callable[[], bool] | None = None) -> None:
        """Make whole what is partial where several in a row are clear together."""
        for closure in self._sequences.match(self._beliefs.held, stop):
            replaced = self._beliefs.add(closure)
            self._rejected.add(c for c in replaced if c.target != closure.target)
            self._pending += 1
        self.settle()

    def _known(self) -> tuple[int, int]:
        """How many closures are believed, and how many of those that can be taken out are whole."""
        return len(self._beliefs), self._beliefs.whole_count

    def _catch_up(self, thorough: Callable[[], bool] | None = None) -> None:
        """Try keyframes again that could not be closed, the latest first, now that the robot knows where it is.

        Each that is closed makes the ones before it certain in turn.

        Args:
            thorough: asked before each: all are tried as long as it says so, those too that were closed in part;
                without it until several in a row cannot be.
        """
        left: list[int] = []
        missed = 0
        while self._open and (missed < MISSES if thorough is None else thorough()):
            source = self._open.pop()
            held = self._beliefs.of(source)
            if not all(c.is_partial for c in held):
                continue
            if held and thorough is None:
                left.append(source)
                continue
            before = self._known()
            self._try_again(source, held)
            if self._known() != before:
                missed = 0
            else:
                missed += 1
                left.append(source)
        self._open.extend(reversed(left))

    def _try_again(self, source: int, held: list[Closure]) -> None:
        """Match a keyframe again that is not closed, or by partial closures alone."""
        query = self._places.query(source)
        candidates = find_candidates(self._graph, self._places, query, self._config.closing)
        if not any(c.is_near for c in candidates):  # the robot could still be in another place
            return
        proposals = [self._matcher.match(query, candidate) for candidate in candidates]
        if held:
            ends = {c.target for c in held}
            proposals = [p for p in proposals if not p.is_partial or p.target not in ends]
            if not any(p.is_certain and not p.is_partial and p.verdict is Verdict.WAITING for p in proposals):
                return
        if any(p.is_certain or p.is_partial for p in proposals):
            self._waiting = [w for w in self._waiting if w.source != source]
            self._dissent = [w for w in self._dissent if w.source != source]
            self._rejected.forget(source)
            self._decide(proposals)
            self.settle()

    # --- decisions --------------------------------------------------------------------------------------------------

    def _decide(self, proposals: list[Closure]) -> bool:
        """Confirm what has support, keep waiting what may still get it; whether keyframes have moved."""
        candidates = [p for p in proposals if p.verdict is Verdict.WAITING]
        self._rejected.add(p for p in proposals if p.verdict is not Verdict.WAITING)
        if not candidates:
            return False
        best = max(candidates, key=lambda c: (not c.is_partial, c.likelihood * c.overlap))
        if any(not self._agree(best, rival, _unknown(best, rival)) for rival in self._rivals(best, proposals)):
            self._rejected.add(replace(c, verdict=Verdict.AMBIGUOUS) for c in candidates)
            return False
        supporters = [] if self._is_tracked(best) else self._supporters(best)
        if supporters is None:
            self._waiting += candidates
            return False
        for closure in [best, *supporters]:
            self._rejected.add(self._beliefs.add(replace(closure, supporters=len(supporters))))
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
        """Waiting closures that agree with one, of different stretches of path; None if they are too few.

        One of a robot whose place is certain, and that fits nowhere else nearly as well, may count on those that are
        believed, as well as on those that wait.
        """
        believed = self._beliefs.held if best.is_certain and best.rival == 0.0 else []
        believed = [c for c in believed if not c.is_partial]
        chosen = self._apart(best, [*self._waiting, *believed])
        return None if chosen is None else [c for c in chosen if c.verdict is Verdict.WAITING]

    def _apart(self, best: Closure, others: list[Closure]) -> list[Closure] | None:
        """Those of others that agree with one, of different stretches of path; None if they are too few."""
        options = self._config.closing
        paths = self._keyframes.paths
        near = [c for c in others if c.source != best.source
                and abs(paths[c.source] - paths[best.source]) <= options.support_path]
        agreeing = [c for c in near if self._agree(best, c, self._freedom(best, c))]
        chosen = [best]
        for closure in sorted(agreeing, key=lambda w: w.likelihood * w.overlap, reverse=True):
            path = paths[closure.source]
            if all(abs(path - paths[c.source]) >= options.support_apart for c in chosen):
                chosen.append(closure)
        return chosen[1:] if len(chosen) > options.supporters else None

    def _overturn(self, proposals: list[Closure]) -> bool:
        """Believe several that agree with each other though not with the graph, if more of it would not have to go.

        A wrong closure makes the graph sure of what is wrong: all right ones that follow disagree with it.
        """
        best = max((p for p in proposals if p.verdict is Verdict.DISAGREES and not p.is_partial),
                   key=lambda c: c.likelihood * c.overlap, default=None)
        if best is None or any(not self._agree(best, rival, _unknown(best, rival))
                               for rival in self._rivals(best, proposals)):
            return False
        supporters = self._apart(best, self._dissent)
        self._dissent.append(best)
        proposals.remove(best)
        if supporters is None:
            return False
        group = [*supporters, best]
        withdrawn = self._beliefs.overturn([replace(c, supporters=len(supporters)) for c in group])
        taken = {id(c) for c in group}
        self._dissent = [c for c in self._dissent if id(c) not in taken]
        if withdrawn is None:
            self._rejected.add(group)
            return False
        self._rejected.add(withdrawn)
        self._pending = 0
        self._reopen({c.source for c in group}, {c.source for c in withdrawn})
        return True

    def _freedom(self, a: Closure, b: Closure) -> Array:
        """Covariance ``(3, 3)`` of the way between two closures, in the axes of the second's source.

        That of the sources by their steps; of the targets too where they are on one stretch of path.
        """
        options, paths = self._config.closing, self._keyframes.paths
        total = way_covariance(self._keyframes, b.source, min(a.source, b.source), max(a.source, b.source), 0.0)
        if abs(paths[a.target] - paths[b.target]) <= options.support_path:
            first, last = min(a.target, b.target), max(a.target, b.target)
            total += way_covariance(self._keyframes, b.target, first, last, -float(b.T_target_source[2]))
        return np.asarray(options.caution * total)

    def settle(self) -> None:
        """Optimise with the closures that were accepted since the last time, and withdraw what no longer fits."""
        if self._pending:
            self._pending = 0
            self._graph.optimise()
            self._rejected.add(self._beliefs.withdraw())

    def _is_tracked(self, closure: Closure) -> bool:
        distance, angle = self._config.closing.tracked
        known = closure.is_certain or closure.is_partial  # the latter tells nothing of what is not known
        return known and len(self._beliefs) > 0 and closure.innovation[0] < distance and closure.innovation[1] < angle

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
        self._rejected.add(c for c in self._dissent if paths[c.source] < path)
        self._waiting = [w for w in self._waiting if paths[w.source] >= path]
        self._dissent = [c for c in self._dissent if paths[c.source] >= path]


def _unknown(best: Closure, rival: Closure) -> Array | None:
    """Covariance ``(3, 3)`` of what partial closures of one keyframe do not tell, so that they agree in the rest.

    While the robot may be farther off, a partial one shows that a match along its line is not the only one.
    """
    partial = [np.linalg.inv(c.information) for c in (best, rival) if c.is_partial and best.is_certain]
    return np.sum(partial, axis=0) if partial else None
