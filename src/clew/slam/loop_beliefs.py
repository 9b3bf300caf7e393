"""The closures that are believed, and how they are taken out again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import SE2, se2
from clew.place import Closure, Verdict
from clew.slam.closure_log import ClosureLog
from clew.slam.pose_graph import PoseGraph

Array = NDArray[np.float64]

WORST = 0.5  # closures with this share of the largest residual go with the worst; others may but be strained by it


@dataclass(frozen=True, eq=False)
class _Belief:
    closure: Closure
    factor: int


class Beliefs:
    """Confirmed closures, each an edge of the graph.

    Args:
        graph: that they are edges of.
        most_residual: a closure with a larger squared residual after optimisation is contradicted.
    """

    def __init__(self, graph: PoseGraph, most_residual: float) -> None:
        self._graph = graph
        self._most_residual = most_residual
        self._held: list[_Belief] = []
        self._of_source: dict[int, list[Closure]] | None = None  # the same by keyframe; None: to be made anew
        self._whole = 0  # how many of them are whole, as of then
        self._past = ClosureLog()  # in the graph for good: a keyframe of theirs was pruned

    def __len__(self) -> int:
        return len(self._past) + len(self._held)

    @property
    def everyone(self) -> list[Closure]:
        """All of them, those first that are in the graph for good."""
        return [*self._past, *self.held]

    @property
    def held(self) -> list[Closure]:
        """Those that can still be taken out, in the order in which they came."""
        return [belief.closure for belief in self._held]

    def of(self, source: int) -> list[Closure]:
        """Those of `held` that close one keyframe."""
        return self._by_source().get(source, [])

    @property
    def whole_count(self) -> int:
        """How many of `held` are not partial."""
        self._by_source()
        return self._whole

    def _by_source(self) -> dict[int, list[Closure]]:
        """Those held by keyframe; made anew only where they have changed since."""
        if self._of_source is None:
            self._of_source = {}
            for closure in self.held:
                self._of_source.setdefault(closure.source, []).append(closure)
            self._whole = sum(not closure.is_partial for closure in self.held)
        return self._of_source

    def add(self, closure: Closure) -> list[Closure]:
        """Believe a closure; returns partial ones of the same keyframe, for which it stands from now on."""
        closure = replace(closure, verdict=Verdict.CONFIRMED)
        replaced = [b for b in self._held if b.closure.is_partial and b.closure.source == closure.source]
        for belief in replaced:
            self._graph.remove(belief.factor)
            self._held.remove(belief)
        self._held.append(_Belief(closure, self._graph.add_closure(closure, closure.information)))
        self._of_source = None
        return [replace(belief.closure, verdict=Verdict.REDUNDANT) for belief in replaced]

    def forget(self, keyframes: set[int]) -> None:
        """Keyframes have been pruned: what their closures said is in the graph for good."""
        ended = [c for c in self.held if c.source in keyframes or c.target in keyframes]
        if ended:
            self._past.add(ended)
            self._held = [b for b in self._held
                          if b.closure.source not in keyframes and b.closure.target not in keyframes]
            self._of_source = None

    def withdraw(self) -> list[Closure]:
        """Take out, the worst first, what the optimised graph contradicts, and optimise again; returns it."""
        withdrawn: list[Closure] = []
        while self._held:
            residuals = self._residuals()
            bad = residuals > max(self._most_residual, WORST * float(residuals.max()))
            if not bad.any():
                break
            for index in np.flatnonzero(bad):
                self._graph.remove(self._held[index].factor)
                withdrawn.append(replace(self._held[index].closure, verdict=Verdict.WITHDRAWN))
            self._held = [self._held[index] for index in np.flatnonzero(~bad)]
            self._of_source = None
            self._graph.optimise()
        return withdrawn

    def overturn(self, group: Sequence[Closure]) -> list[Closure] | None:
        """Try what becomes of the graph if closures that contradict it are right.

        They are believed if all of them then stand, and no more than they are must go for them; otherwise all is as
        before.

        Args:
            group: that agree with each other.

        Returns:
            What was withdrawn for them, and partial closures that they stand for; None if they are not believed.
        """
        before, poses = list(self._held), self._graph.poses.copy()
        replaced = [partial for closure in group for partial in self.add(closure)]
        self._graph.optimise()
        withdrawn = self.withdraw()
        ends = {(c.source, c.target) for c in group}
        lost = [c for c in withdrawn if (c.source, c.target) in ends]
        if not lost and len(withdrawn) <= len(group):
            return withdrawn + replaced
        for belief in self._held:
            self._graph.remove(belief.factor)
        self._held, self._of_source = [], None
        for belief in before:
            self.add(belief.closure)
        self._graph.set_poses(poses[self._graph.graph.keys(SE2)])
        self._graph.optimise()
        return None

    def _residuals(self) -> Array:
        """Squared residuals of those held, ``(n,)``."""
        closures, poses = self.held, self._graph.poses
        measured = np.stack([c.T_target_source for c in closures])
        information = np.stack([c.information for c in closures])
        between = se2.between(poses[[c.target for c in closures]], poses[[c.source for c in closures]])
        error = se2.between(measured, between)
        return np.asarray(np.einsum("mi,mij,mj->m", error, information, error))
