"""Where may the robot be again? Older places within its uncertainty, each with the window in which to search."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.slam.config import ClosingOptions
from clew.slam.places import Places, Query
from clew.slam.pose_graph import PoseGraph

Array = NDArray[np.float64]

SHORTLIST = 12  # nearest anchors whose uncertainty and appearance are looked at
LOST_SHORTLIST = 60  # and those that look most alike, while the robot may be far from where it is believed
CERTAIN = 2.0  # metres; half of the window
DOUBTED_ANGLE = 0.3  # radians; half of the window where the prediction is doubted
APART = 3.0  # metres; anchors nearer to each other than this are one place


@dataclass(frozen=True)
class Candidate:
    """An older place to match against.

    Attributes:
        anchor: keyframe whose submap it is.
        similarity: likeness of the descriptors.
        T_predicted: ``(3,)`` pose of the source seen from the anchor by the graph,
        covariance: ``(3, 3)`` and its covariance, in the source's tangent.
        centre: ``(3,)`` middle of the search window: what is predicted, or, if that says little, where the two see the
            same: a laser that looks ahead sees a place from elsewhere on the way back.
        half_window: ``(3,)`` its half size, metres, metres, radians.
        is_doubted: whether the prediction is doubted, so that it is searched for beyond its covariance.
    """

    anchor: int
    similarity: float
    T_predicted: Array
    covariance: Array
    centre: Array
    half_window: Array
    is_doubted: bool = False

    @property
    def prior(self) -> Array:
        """``(3, 3)`` covariance with which the prediction pulls at the match."""
        return np.diag(self.half_window**2) if self.is_doubted else self.covariance

    @property
    def may_slide(self) -> bool:
        """Whether a match that tells nothing along one direction is of use."""
        return self.is_near and not self.is_doubted

    def doubted(self, reach: float) -> Candidate:
        """The same place, searched for as if nothing were known but that it is near."""
        half = np.maximum(self.half_window, [reach, reach, DOUBTED_ANGLE])
        return replace(self, half_window=half, is_doubted=True)

    @property
    def is_certain(self) -> bool:
        """Whether the robot is known well enough that a match beside it could not be another place."""
        return bool(self.half_window[0] <= CERTAIN)

    @property
    def is_near(self) -> bool:
        """Whether the window lies about the predicted pose."""
        return self.centre is self.T_predicted


def find_candidates(graph: PoseGraph, places: Places, query: Query, options: ClosingOptions) -> list[Candidate]:
    """Older places where the robot may be, those that look most alike first.

    While the robot is known to a few metres these are the nearest ones, searched about the predicted pose. Otherwise
    every place within the uncertainty is one, found by its appearance and searched around, so that it does not matter
    how far the robot has drifted.
    """
    poses = graph.poses
    position = poses[query.source, :2]

    def are_anchors(keyframes: NDArray[np.int64]) -> NDArray[np.bool_]:
        return places.are_anchors(keyframes, query.source)

    chosen = graph.near.nearest(position, SHORTLIST, are_anchors)
    if not len(chosen):
        return []
    covariances, spread = _uncertainty(graph, query.source, chosen, options)
    lost = bool(spread.max() > options.reach)
    if lost:
        wide = graph.near.within(position, options.reach + 2.0 * float(spread.max()))
        wide = wide[are_anchors(wide)]
        alike = places.similarities(wide, query.appearance)
        chosen = np.union1d(chosen, wide[np.argsort(-alike, kind="stable")[:LOST_SHORTLIST]])
        covariances, spread = _uncertainty(graph, query.source, chosen, options)
    possible = np.hypot(*(poses[chosen, :2] - position).T) <= options.reach + spread
    chosen, covariances = chosen[possible], covariances[possible]
    alike = places.similarities(chosen, query.appearance)
    most = options.lost_candidates if lost else options.candidates
    candidates: list[Candidate] = []
    for i in np.argsort(-alike, kind="stable"):
        if alike[i] < options.similarity or len(candidates) >= most:
            break
        here = poses[chosen[i], :2]
        if lost and any(np.hypot(*(poses[c.anchor, :2] - here)) < APART for c in candidates):
            continue
        T_predicted = se2.between(poses[chosen[i]], poses[query.source])
        same_view = places.view(int(chosen[i])) - se2.act(np.array([0.0, 0.0, T_predicted[2]]), query.view[None])[0]
        centre, half = _window(T_predicted, same_view, covariances[i], options)
        candidates.append(Candidate(int(chosen[i]), float(alike[i]), T_predicted, covariances[i], centre, half))
    return candidates


def _uncertainty(
    graph: PoseGraph, source: int, anchors: NDArray[np.int64], options: ClosingOptions
) -> tuple[Array, Array]:
    """Covariances ``(A, 3, 3)`` of the source seen from anchors, and how far off it may be, metres."""
    covariances = options.caution * graph.relative_covariances(source, anchors)
    return covariances, options.sigmas * np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1])


def _window(
    T_predicted: Array, same_view: Array, covariance: Array, options: ClosingOptions
) -> tuple[Array, Array]:
    """Middle and half size of the window."""
    sigma = np.sqrt(np.array([covariance[0, 0] + covariance[1, 1], covariance[2, 2]]))
    half = np.maximum(options.sigmas * sigma, options.window_floor)
    centre = T_predicted
    if half[0] > options.reach:  # the place itself is searched around, and others are candidates of their own
        centre = np.append(same_view, T_predicted[2])
    return centre, np.array([min(half[0], options.reach), min(half[0], options.reach), min(half[1], np.pi)])
