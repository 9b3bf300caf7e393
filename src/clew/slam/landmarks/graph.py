"""The factor graph of robots that see landmarks and each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.factors import CalibratedBearing, CalibratedRange, Prior
from clew.geometry import SE2, Point2
from clew.graph import Factor, FactorGraph
from clew.slam.landmarks.model import PRIOR, SensorModel
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
    """

    motion: Factor
    drift: Factor
    biases: tuple[Factor, Factor | None]
    sources: Array
    sightings: tuple[CalibratedRange, CalibratedBearing]
    mates: tuple[CalibratedRange, CalibratedBearing] | None


def build_graph(
    tracks: Sequence[RobotTrack],
    models: Sequence[SensorModel],
    poses: Sequence[Array],
    landmarks: Mapping[int, Array],
) -> tuple[FactorGraph, list[RobotFactors]]:
    """Poses, landmarks and calibrations of all robots; the first pose of the first robot is held.

    Args:
        tracks: the robots.
        models: what is believed of each.
        poses: ``(N, 3)`` initial poses of each robot.
        landmarks: initial position ``(2,)`` of each landmark that is seen.
    """
    graph = FactorGraph()
    for track, array in zip(tracks, poses, strict=True):
        graph.add_pose(SE2.from_array(array), key=track.keys)
    identities = np.unique(np.concatenate([track.log.landmarks.identity for track in tracks]))
    graph.add_point(np.array([landmarks[int(i)] for i in identities]).reshape(-1, 2), key=identities)
    kept = []
    for track, model in zip(tracks, models, strict=True):
        keys = track.calibration_keys
        graph.add_point(model.calibration.points, key=keys)
        drawn = -model.pull * PRIOR.points**2  # a force is a prior about another place
        graph.add(Prior(keys, Point2.from_array(drawn), sigmas=PRIOR.points))
        motion, sources = track.motion_factor(model)
        drift = _about_zero(graph, track.drift_keys, (model.drift.speed, model.drift.turn))
        seen, mates = track.log.landmarks, track.log.robots
        sightings = track.sighting_factors(seen, seen.identity, model.landmarks)
        bias = _about_zero(graph, track.view_keys(seen), (model.landmarks.range_bias, model.landmarks.bearing_bias))
        of_robots, of_mates = None, None
        if len(mates):
            target = keys_of(tracks, mates.identity, mates.timestamp)
            of_robots = track.sighting_factors(mates, target, model.robots, SE2)
            of_mates = _about_zero(graph, track.view_keys(mates), (model.robots.range_bias, model.robots.bearing_bias))
        for factor in (motion, *sightings, *(of_robots or ())):
            graph.add(factor)
        kept.append(RobotFactors(motion, drift, (bias, of_mates), sources, sightings, of_robots))
    graph.set_constant(int(tracks[0].keys[0]))
    return graph, kept


def _about_zero(graph: FactorGraph, keys: Indices, sigmas: tuple[float, float]) -> Prior:
    """Add points that are near zero."""
    each = np.unique(keys)
    none = Point2.from_array(np.zeros((len(each), 2)))
    graph.add_point(none, key=each)
    prior = Prior(each, none, sigmas=sigmas)
    graph.add(prior)
    return prior
