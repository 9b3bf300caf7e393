"""Keyframes that say nothing new are taken out, with what they knew kept.

A place that is visited again and again would add keyframes, edges and scans for ever. Where enough keyframes look at it
from the same side, one is taken out for each that comes: its edges are replaced by what they said of its neighbours
(`clew.reduce`), its returns are forgotten, and the scans that hung on it hang on a keyframe that stays. The oldest
stay, for much is tied to them, and the newest, for the world changes; those in between go. (Kretzschmar and Stachniss,
"Information-theoretic compression of pose graphs for laser-based SLAM", IJRR 2012, keep what is most informative.)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2, wrap
from clew.scan import SourceClouds, align, index_cloud, join
from clew.slam.attachments import PARTNERS
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.pose_graph import PoseGraph

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RADII = (0.2, 0.1)  # metres; partners of returns
WEAK_PRIOR = np.diag([1 / 0.05**2, 1 / 0.05**2, 1 / 0.02**2])  # as in `clew.slam.refine`


@dataclass(frozen=True)
class Pruned:
    """What has been taken out so far.

    Attributes:
        keyframes: how many.
        information_loss_nats: divergence of what replaces their edges from what these said, summed up.
    """

    keyframes: int = 0
    information_loss_nats: float = 0.0


class Pruner:
    """Takes redundant keyframes out of the store and the graph."""

    def __init__(self, keyframes: KeyframeStore, graph: PoseGraph, config: SlamConfig) -> None:
        self._keyframes = keyframes
        self._graph = graph
        self._config = config
        self._judged = 0  # keyframes before this one have been looked at
        self.pruned = Pruned()

    def prune(self, needed: set[int]) -> list[int]:
        """Look at the keyframes that have come of age since the last time; returns those that were taken out.

        Args:
            needed: keyframes that must stay for now.
        """
        options = self._config.pruning
        if not options.enabled:
            return []
        paths = self._keyframes.paths
        ripe = min(int(np.searchsorted(paths, paths[-1] - options.path)), len(paths) - options.recent)
        if ripe - self._judged < options.batch:
            return []
        comers, self._judged = self._keyframes.between(self._judged, ripe), ripe
        gone: list[int] = []
        lost = 0.0
        degrees = self._graph.degrees()
        for comer in comers.tolist():
            redundant = self._redundant(comer, ripe, needed)[: options.candidates]
            # What hangs on few others loses little, and leaves few edges behind.
            for candidate in sorted(redundant, key=degrees.__getitem__):
                attached = self._attach(candidate, ripe)
                if attached is None:
                    continue
                loss = self._graph.prune(candidate, *attached, options.most_loss)
                if loss is not None:
                    self._keyframes.drop([candidate])
                    gone.append(candidate)
                    lost += loss
                    break
        if gone:
            self._graph.tidy()
            self.pruned = Pruned(self.pruned.keyframes + len(gone), self.pruned.information_loss_nats + lost)
        return gone

    def crowded(self, keyframe: int) -> bool:
        """Whether enough keyframes look at the place of this one from its side already."""
        return len(self._beside(keyframe, self._judged)) >= self._config.pruning.cover

    def _beside(self, keyframe: int, end: int) -> Index:
        """Those before ``end`` that stand near a keyframe and face the same way, itself among them."""
        near = self._about(keyframe, self._config.pruning.radius, end)
        return np.asarray(near[self._look_alike(np.array([keyframe]), near)[0]])

    def _about(self, keyframe: int, radius: float, end: int) -> Index:
        """Those before ``end`` within ``radius`` metres of a keyframe."""
        near = self._graph.near.within(self._graph.poses[keyframe, :2], radius)
        return near[near < end]

    def _look_alike(self, of: Index, among: Index) -> NDArray[np.bool_]:
        """``(O, A)`` which keyframes stand near each other and face the same way."""
        options = self._config.pruning
        poses = self._graph.poses
        a, b = poses[of][:, None], poses[among][None]
        near = np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1]) <= options.radius
        return np.asarray(near & (np.abs(wrap(a[..., 2] - b[..., 2])) <= options.angle))

    def _redundant(self, comer: int, ripe: int, needed: set[int]) -> list[int]:
        """Keyframes about a new one that are covered by others, in the order in which they may go."""
        options = self._config.pruning
        group = self._beside(comer, ripe)
        if len(group) <= options.cover:
            return []
        everyone = self._about(comer, 2.0 * options.radius, ripe)
        near = self._look_alike(group, everyone)
        older = (near & (everyone[None] < group[:, None])).sum(axis=1)
        covered = near.sum(axis=1) > options.cover
        # The oldest of the newer half goes first; the older half stays.
        chosen = group[covered & (older >= options.cover // 2)]
        return [int(k) for k in chosen if k and int(k) not in needed]

    def _attach(self, keyframe: int, ripe: int) -> tuple[Index, Array, Array] | None:
        """The oldest neighbours, which stay, with its pose seen from each and the information of that.

        By the returns of both; None where these do not agree with any. What they do not tell, as along a corridor, the
        present poses tell.
        """
        options = self._config.pruning
        near = self._beside(keyframe, ripe)
        partners = near[near != keyframe][:PARTNERS]
        if not len(partners):
            return None
        clouds = join([index_cloud(cloud) for cloud in self._keyframes.clouds(partners)])
        start = se2.between(self._graph.poses[partners], self._graph.poses[keyframe])
        pairs = np.stack([np.arange(len(partners)), np.zeros(len(partners))], axis=1).astype(np.int32)
        fine = align(
            clouds, SourceClouds.single(self._keyframes[keyframe].points), pairs, start,
            prior_information=np.broadcast_to(WEAK_PRIOR, (len(partners), 3, 3)),
            options=replace(self._config.alignment, radius_start=RADII[0], radius_end=RADII[1]),
        )  # fmt: skip
        moved = se2.between(start, fine.T_target_source)
        good = (fine.overlap >= options.overlap) & (np.hypot(moved[:, 0], moved[:, 1]) <= options.movement)
        if not good.any():
            return None
        return partners[good], fine.T_target_source[good], fine.information[good] + WEAK_PRIOR
