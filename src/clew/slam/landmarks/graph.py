"""The factor graph of robots that see landmarks and each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.factors import CalibratedBearing, CalibratedRange, Prior
from clew.geometry import SE2, Point2
from clew.graph import Factor, FactorGraph
from clew.slam.landmarks.model import PRIOR, Marks, SensorModel
from clew.slam.landmarks.track import RobotTrack, keys_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class RobotFactors:
    """The factors of one robot, kept for the estimation of its noise.

    Attributes:
        motion: between its keyframes.
        drift: of the scales of its odometry about zero.
        biases: of its views of landmarks about zero, and of those of other robots or None.
        sources: ``(6, S, 3, 3)`` covariance of each motion by source.
        sightings: range and bearing of landmarks.
        mates: range and bearing of other robots, or None.
        shares: ``(K,)`` part of each sighting of a landmark in all sightings of it, by whatever robot.
    """

    motion: Factor
    drift: Factor
    biases: tuple[Factor, Factor | None]
    sources: Array
    sightings: tuple[CalibratedRange, CalibratedBearing]
    mates: tuple[CalibratedRange, CalibratedBearing] | None
    shares: Array


def build_graph(
    tracks: Sequence[RobotTrack],
    models: Sequence[SensorModel],
    poses: Sequence[Array],
    landmarks: Mapping[int, Array],
    marks: Marks | None = None,
) -> tuple[FactorGraph, list[RobotFactors], list[Prior]]:
    """Poses, landmarks and calibrations of all robots; the first pose of the first robot is held.

    Returns the graph, the factors of each robot, and the priors of what sets marks apart: of landmarks, and of robots.

    Args:
        tracks: the robots.
        models: what is believed of each.
        poses: ``(N, 3)`` initial poses of each robot.
        landmarks: initial position ``(2,)`` of each landmark that is seen.
        marks: how much they differ; what is to be expected, if not given.
    """
    graph = FactorGraph()
    for track, array in zip(tracks, poses, strict=True):
        graph.add_pose(SE2.from_array(array), key=track.keys)
    marks = marks or Marks()
    seen_of_all = np.concatenate([track.log.landmarks.identity for track in tracks])
    identities, counts = np.unique(seen_of_all, return_counts=True)
    graph.add_point(np.array([landmarks[int(i)] for i in identities]).reshape(-1, 2), key=identities)
    apart = []
    for noise, all_seen in ((marks.landmarks, [track.log.landmarks for track in tracks]),
                            (marks.robots, [track.log.robots for track in tracks])):  # fmt: skip
        pairs = zip(tracks, all_seen, strict=True)
        marked = np.unique(np.concatenate([track.mark_keys(seen) for track, seen in pairs]))
        apart.append(_about_zero(graph, marked, np.broadcast_to([noise.share, noise.turn], (len(marked), 2))))
    kept = []
    for track, model in zip(tracks, models, strict=True):
        keys = track.calibration_keys
        graph.add_point(model.calibration.points, key=keys)
        drawn = -model.pull * PRIOR.points**2  # a force is a prior about another place
        graph.add(Prior(keys, Point2.from_array(drawn), sigmas=PRIOR.points))
        motion, sources = track.motion_factor(model)
        whiles = np.unique(track.drift_keys)
        drift = _about_zero(graph, whiles, np.broadcast_to([model.drift.speed, model.drift.turn], (len(whiles), 2)))
        seen, mates = track.log.landmarks, track.log.robots
        sightings = track.sighting_factors(seen, seen.identity, model.landmarks)
        bias = _about_zero(graph, *track.view_deviations(seen, model.landmarks))
        of_robots, of_mates = None, None
        if len(mates):
            target = keys_of(tracks, mates.identity, mates.timestamp)
            of_robots = track.sighting_factors(mates, target, model.robots, SE2)
            of_mates = _about_zero(graph, *track.view_deviations(mates, model.robots))
        for factor in (motion, *sightings, *(of_robots or ())):
            graph.add(factor)
        shares = 1.0 / counts[np.searchsorted(identities, seen.identity)]
        kept.append(RobotFactors(motion, drift, (bias, of_mates), sources, sightings, of_robots, shares))
    graph.set_constant(int(tracks[0].keys[0]))
    return graph, kept, apart


def _about_zero(graph: FactorGraph, keys: Indices, sigmas: Array) -> Prior:
    """Add points with the given keys that are near zero, by deviations ``(V, 2)``."""
    none = Point2.from_array(np.zeros((len(keys), 2)))
    graph.add_point(none, key=keys)
    prior = Prior(keys, none, sigmas=sigmas)
    graph.add(prior)
    return prior
