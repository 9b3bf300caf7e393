"""The graph with its calibration applied: nothing but poses, landmarks and factors that all know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between, PointObservation
from clew.geometry import SE2, Point2, se2, wrap
from clew.graph import Factor, FactorGraph
from clew.io import Sightings
from clew.slam.landmarks.model import SensorModel, SightingNoise
from clew.slam.landmarks.track import TAIL, RobotTrack, keys_of
from clew.solve import Solution

Array = NDArray[np.float64]


def plain_graph(tracks: Sequence[RobotTrack], models: Sequence[SensorModel], solution: Solution) -> FactorGraph:
    """Odometry as `Between`, sightings as `PointObservation`, at the values of the solution.

    Sightings of robots are relative poses without any information about the heading. Robust weights are in the
    covariances, for files have no kernels: outliers at the solution have little weight. The graph has its minimum
    where the solution is: see `_points`.
    """
    graph = FactorGraph()
    identities = np.unique(np.concatenate([track.log.landmarks.identity for track in tracks]))
    for track in tracks:
        graph.add_pose(SE2.from_array(_values(solution, SE2, track.keys)), key=track.keys)
    graph.add_point(_values(solution, Point2, identities), key=identities)
    for track, model in zip(tracks, models, strict=True):
        motion, _ = track.motion_factor(model)
        drift = _values(solution, Point2, track.drift_keys)
        parameters = [*np.broadcast_to(model.calibration.points[:2, None], (2, len(drift), 2)), drift]
        graph.add(
            Between(track.keys[:-1], track.keys[1:], motion.motion_at(*parameters), information=motion.information)
        )
        seen, mates = track.log.landmarks, track.log.robots
        keys = track.keys[track.rows(seen)]
        weights = _weights(solution, track.sighting_factors(seen, seen.identity, model.landmarks))
        local = se2.act(se2.inverse(_values(solution, SE2, keys)), _values(solution, Point2, seen.identity))
        bias = _values(solution, Point2, track.view_keys(seen))
        points, information = _points(track, model, seen, model.landmarks, weights, local, bias)
        graph.add(PointObservation(keys, seen.identity, points, information=information))
        if len(mates):
            target = keys_of(tracks, mates.identity, mates.timestamp)
            weights = _weights(solution, track.sighting_factors(mates, target, model.robots, SE2))
            keys = track.keys[track.rows(mates)]
            local = se2.between(_values(solution, SE2, keys), _values(solution, SE2, target))[:, :2]
            bias = _values(solution, Point2, track.view_keys(mates))
            points, information = _points(track, model, mates, model.robots, weights, local, bias)
            padded = np.zeros((len(mates), 3, 3))
            padded[:, :2, :2] = information
            flat = np.column_stack([points, np.zeros(len(points))])
            graph.add(
                Between(keys, target, flat, information=padded, role="observation")
            )
    graph.set_constant(int(tracks[0].keys[0]))
    return graph


def _values(solution: Solution, kind: type, keys: NDArray[np.int64]) -> Array:
    order = np.argsort(solution.keys(kind))
    rows = order[np.searchsorted(solution.keys(kind), keys, sorter=order)]
    values: Array = solution.values(kind).array[rows]
    return values


def _weights(solution: Solution, pair: tuple[Factor, Factor]) -> Array:
    """Robust weight ``(K, 2)`` of each range and bearing at the solution, t distribution included."""
    out = []
    for factor in pair:
        values = [_values(solution, kind, factor.keys[:, p]) for p, kind in enumerate(factor.kinds)]
        error = factor.residual(*values, measurement=factor.measurement)[:, 0]
        assert factor.kernel is not None
        out.append(factor.kernel.weight(error**2 * factor.information[:, 0, 0]) * (TAIL + 1.0) / TAIL)
    return np.stack(out, axis=1)


def _points(
    track: RobotTrack, model: SensorModel, seen: Sightings, noise: SightingNoise,
    weights: Array, local: Array, bias: Array,
) -> tuple[Array, Array]:
    """Positions ``(K, 2)`` in the robot's frame, and their information.

    The errors of range and bearing, less the ``bias (K, 2)`` of their view, are laid off along and across the ray on
    which the solution has it, ``local (K, 2)``: so each costs what it costs in the solution. On the measured ray a
    bearing that is far off would turn into an error of the range, which no weight has reckoned with.
    """
    unbiased = replace(seen, range=seen.range - bias[:, 0], bearing=seen.bearing - bias[:, 1])
    distance, bearing = track.corrected(unbiased, model.calibration)
    view = local - [model.calibration.forward, model.calibration.left]
    far = np.hypot(*view.T)
    ray = view / far[:, None]
    across = np.stack([-ray[:, 1], ray[:, 0]], axis=1)
    turned = wrap(bearing - np.arctan2(view[:, 1], view[:, 0]))
    along_weight = weights[:, 0] * (seen.range / distance) ** 2 / noise.range**2
    across_weight = weights[:, 1] / (noise.bearing * far) ** 2
    information = (
        along_weight[:, None, None] * ray[:, :, None] * ray[:, None, :]
        + across_weight[:, None, None] * across[:, :, None] * across[:, None, :]
    )
    return local + (distance - far)[:, None] * ray + (far * turned)[:, None] * across, information
