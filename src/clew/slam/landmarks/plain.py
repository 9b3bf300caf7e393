"""The graph with its calibration applied: nothing but poses, landmarks and factors that all know."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between, CalibratedBearing, CalibratedRange, PointObservation
from clew.geometry import SE2, Point2, se2
from clew.graph import FactorGraph
from clew.slam.landmarks.graph import RobotFactors
from clew.slam.landmarks.model import SensorModel
from clew.slam.landmarks.track import RobotTrack, keys_of
from clew.solve import Solution

Array = NDArray[np.float64]


def plain_graph(
    tracks: Sequence[RobotTrack], models: Sequence[SensorModel], solution: Solution, factors: Sequence[RobotFactors]
) -> FactorGraph:
    """Odometry as `Between`, sightings as `PointObservation`, at the values of the solution.

    Sightings of robots are relative poses without any information about the heading. Sightings have the information
    that they are told to have by `factors`, for files have no kernels: outliers at the solution have little. The
    graph has its minimum where the solution is: see `_points`.
    """
    graph = FactorGraph()
    identities = np.unique(np.concatenate([track.log.landmarks.identity for track in tracks]))
    for track in tracks:
        graph.add_pose(SE2.from_array(_values(solution, SE2, track.keys)), key=track.keys)
    graph.add_point(_values(solution, Point2, identities), key=identities)
    for track, model, told in zip(tracks, models, factors, strict=True):
        motion, _ = track.motion_factor(model)
        drift = _values(solution, Point2, track.drift_keys)
        parameters = [*np.broadcast_to(model.calibration.points[:2, None], (2, len(drift), 2)), drift]
        graph.add(
            Between(track.keys[:-1], track.keys[1:], motion.motion_at(*parameters), information=motion.information)
        )
        seen, mates = track.log.landmarks, track.log.robots
        pair = track.sighting_factors(seen, seen.identity, model.landmarks)
        points, information = _points(solution, pair, told.sightings)
        keys = track.keys[track.rows(seen)]
        graph.add(PointObservation(keys, seen.identity, points, information=information))
        if len(mates):
            target = keys_of(tracks, mates.identity, mates.timestamp)
            assert told.mates is not None
            pair = track.sighting_factors(mates, target, model.robots, SE2)
            points, information = _points(solution, pair, told.mates)
            padded = np.zeros((len(mates), 3, 3))
            padded[:, :2, :2] = information
            flat = np.column_stack([points, np.zeros(len(points))])
            keys = track.keys[track.rows(mates)]
            graph.add(Between(keys, target, flat, information=padded, role="observation"))
    graph.set_constant(int(tracks[0].keys[0]))
    return graph


def _values(solution: Solution, kind: type, keys: NDArray[np.int64]) -> Array:
    order = np.argsort(solution.keys(kind))
    rows = order[np.searchsorted(solution.keys(kind), keys, sorter=order)]
    values: Array = solution.values(kind).array[rows]
    return values


_Pair = tuple[CalibratedRange, CalibratedBearing]


def _points(solution: Solution, pair: _Pair, told: _Pair) -> tuple[Array, Array]:
    """Positions ``(K, 2)`` in the robot's frame, and their information.

    The errors of range and bearing are laid off along and across the ray on which the solution has what was seen: so
    each draws as it does in the solution. On the measured ray a bearing that is far off
    would turn into an error of the range, which no weight has reckoned with.
    """
    ranges, bearings = pair
    values = [_values(solution, kind, ranges.keys[:, k]) for k, kind in enumerate(ranges.kinds)]
    local = se2.act(se2.inverse(values[0]), values[1][:, :2])
    view = local - values[-1]  # from where the camera is mounted
    ray = view / np.hypot(*view.T)[:, None]
    across = np.stack([-ray[:, 1], ray[:, 0]], axis=1)
    information = np.zeros((len(local), 2, 2))
    for factor, counted, direction in ((ranges, told[0], ray), (bearings, told[1], across)):
        values = [_values(solution, kind, factor.keys[:, k]) for k, kind in enumerate(factor.kinds)]
        error, jacobians = factor.linearise(*values)
        rate = np.linalg.norm(jacobians[1][:, 0, :2], axis=1)  # of the measured number by metres
        weight = factor.information[:, 0, 0]
        assert factor.kernel is not None
        weight = weight * factor.kernel.weight(error[:, 0] ** 2 * weight)
        share = counted.information[:, 0, 0]
        local = local - (weight / share * error[:, 0] / rate)[:, None] * direction
        information += (share * rate**2)[:, None, None] * direction[:, :, None] * direction[:, None, :]
    return local, information
