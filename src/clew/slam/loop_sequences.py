"""Partial closures in a row along a corridor: where along it were they, by all of them together?"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place import Closure, along_all, blurred, evidence_along, told
from clew.scan import merge_surfels
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.loop_matching import UNKNOWN
from clew.slam.loop_uncertainty import deformation, way_covariance
from clew.slam.places import Places
from clew.slam.pose_graph import PoseGraph

Array = NDArray[np.float64]

GAP = 6.0  # metres of way between two matches of a sequence at most
BEND = 0.97  # cosine between their lines at least
STEP = 0.05  # metres between offsets
FARTHEST = 5.0  # metres; of an offset
ABOUT = 0.8  # metres; farther off would be another place,
SURE = 0.99  # which it is not, with this probability
TAILS = 3.0  # degrees of freedom of the errors of whole closures


@dataclass(frozen=True)
class _Link:
    """One match of a sequence.

    Attributes:
        closure: what is believed of it.
        T_predicted: ``(3,)`` pose of the source seen from the target by the graph,
        covariance: ``(3, 3)`` and its covariance.
        line: ``(2,)`` direction of the corridor, in the target's frame.
    """

    closure: Closure
    T_predicted: Array
    covariance: Array
    line: Array

    @property
    def deviation(self) -> float:
        """Of the prediction along the line, metres."""
        return float(np.sqrt(self.along(self.covariance)))

    @property
    def middle(self) -> Array:
        """``(3,)`` as measured across the line, and as predicted along it."""
        middle: Array = self.closure.T_target_source.copy()
        middle[:2] += self.line * (self.line @ (self.T_predicted[:2] - middle[:2]))
        return middle

    def at(self, offset: float, variance: float) -> Closure:
        """The closure with what is known along the line: how far from the middle, and how well."""
        T = self.middle
        T[:2] += offset * self.line
        axis = np.append(se2.matrix(T)[:2, :2].T @ self.line, 0.0)
        information = self.closure.information + np.outer(axis, axis) / variance
        miss = se2.between(self.T_predicted, T)
        return replace(
            self.closure, T_target_source=T, information=information, is_partial=False,
            within=2.0 * float(np.sqrt(variance)), innovation=(float(np.hypot(miss[0], miss[1])), float(abs(miss[2]))),
        )  # fmt: skip

    def along(self, covariance: Array) -> float:
        """Variance along the line of a covariance ``(3, 3)`` in the source's tangent."""
        turn = se2.matrix(self.closure.T_target_source)[:2, :2]
        return float(self.line @ turn @ covariance[:2, :2] @ turn.T @ self.line)


class SequenceMatcher:
    """Makes whole closures of partial ones where a sequence of them fits at one place alone."""

    def __init__(
        self, keyframes: KeyframeStore, graph: PoseGraph, places: Places, config: SlamConfig
    ) -> None:
        self._keyframes = keyframes
        self._graph = graph
        self._places = places
        self._options = config.closing
        self._voxel = config.verification.fine_voxel

    def match(self, held: Sequence[Closure], stop: Callable[[], bool] | None = None) -> list[Closure]:
        """Whole closures for those partial ones among `held` whose place along their corridor has become clear.

        Args:
            held: all that are believed.
            stop: asked before each match is looked at whether to leave this sequence and the others as they are.
        """
        found: list[Closure] = []
        for chain in self._chains(sorted(held, key=lambda c: c.source)):
            if len(chain) > 1 and any(link.closure.is_partial for link in chain):
                resolved = self._resolve(chain, stop)
                if resolved is None:
                    break
                found += resolved
        return found

    def _chains(self, held: list[Closure]) -> list[list[_Link]]:
        """Closures that follow each other along one line; a chain for each of the times that the corridor was driven
        before."""
        poses, paths = self._graph.poses, self._keyframes.paths
        partial = [c for c in held if c.is_partial]
        if not partial:
            return []
        lines = {id(c): self._line(c) for c in partial}
        sources = np.array([paths[c.source] for c in partial])
        chains: list[list[_Link]] = []
        for closure in held:
            nearest = partial[int(np.argmin(np.abs(sources - paths[closure.source])))]
            if abs(paths[nearest.source] - paths[closure.source]) > GAP:
                continue
            line = lines[id(nearest)]
            turn = poses[nearest.target, 2] - poses[closure.target, 2]
            line = se2.act(np.array([0.0, 0.0, turn]), line[None])[0]
            link = self._link(closure, line)
            chain = next((chain for chain in reversed(chains) if self._follows(chain[-1], link)), None)
            if chain is None:
                chains.append([link])
                continue
            if self._world(chain[-1]) @ self._world(link) < 0.0:
                link = replace(link, line=-link.line)
            chain.append(link)
        return chains

    def _line(self, closure: Closure) -> Array:
        """Direction ``(2,)`` in which a partial closure knows nothing, in the target's frame."""
        axis = np.linalg.eigh(closure.information[:2, :2])[1][:, 0]
        return np.asarray(se2.matrix(closure.T_target_source)[:2, :2] @ axis)

    def _link(self, closure: Closure, line: Array) -> _Link:
        poses = self._graph.poses
        T_predicted = se2.between(poses[closure.target], poses[closure.source])
        covariance = self._graph.relative_covariances(closure.source, np.array([closure.target]))[0]
        return _Link(closure, T_predicted, self._options.caution * covariance, line)

    def _world(self, link: _Link) -> Array:
        return np.asarray(se2.matrix(self._graph.poses[link.closure.target])[:2, :2] @ link.line)

    def _follows(self, a: _Link, b: _Link) -> bool:
        paths = self._keyframes.paths
        return bool(
            abs(paths[b.closure.source] - paths[a.closure.source]) <= GAP
            and abs(paths[b.closure.target] - paths[a.closure.target]) <= 2.0 * GAP
            and abs(self._world(a) @ self._world(b)) > BEND
        )

    def _resolve(self, chain: list[_Link], stop: Callable[[], bool] | None) -> list[Closure] | None:
        """Closures that have become whole; None where it was stopped."""
        half = min(self._options.sigmas * max(link.deviation for link in chain), FARTHEST)
        count = int(np.ceil(half / STEP))
        if count < 2:
            return []
        offsets: Array = STEP * np.arange(-count, count + 1, dtype=np.float64)
        evidence = np.zeros((len(chain), len(offsets)))
        for row, link in zip(evidence, chain, strict=True):
            if stop is not None and stop():
                return None
            row[:] = self._evidence(link, offsets)
        prior = -0.5 * np.square(offsets / chain[0].deviation)
        variances = [self._freedom(a, b) for a, b in itertools.pairwise(chain)]
        found = []
        for link, by_all, by_others in zip(chain, *along_all(evidence, variances, offsets, prior), strict=True):
            offset, variance = told(by_all, by_others, offsets)
            clear = float(by_all[np.abs(offsets - by_all @ offsets) <= ABOUT].sum()) >= SURE
            if link.closure.is_partial and clear and variance < UNKNOWN**2 and abs(offset) <= half:
                found.append(replace(link.at(offset, variance), in_row=len(chain)))
        return found

    def _evidence(self, link: _Link, offsets: Array) -> Array:
        closure = link.closure
        if not closure.is_partial:
            miss = float(link.line @ (closure.T_target_source[:2] - link.T_predicted[:2]))
            squared = np.square(offsets - miss) / link.along(np.asarray(np.linalg.inv(closure.information)))
            return np.asarray(-0.5 * (TAILS + 1.0) * np.log1p(squared / TAILS))
        points = merge_surfels(self._places.query(closure.source).surfels, self._voxel).points
        alone = evidence_along(self._places.submap(closure.target), points, link.middle, link.line, offsets)
        return blurred(alone, link.along(deformation(self._keyframes, closure, self._options)), offsets)

    def _freedom(self, a: _Link, b: _Link) -> float:
        """Variance of the way between two links along the line of the second, square metres."""
        one, other = a.closure, b.closure
        source, target = sorted((one.source, other.source)), sorted((one.target, other.target))
        total = way_covariance(self._keyframes, other.source, source[0], source[1], 0.0)
        total += way_covariance(
            self._keyframes, other.target, target[0], target[1], -float(other.T_target_source[2])
        )
        return b.along(self._options.caution * total)
