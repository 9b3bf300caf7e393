"""A recorded drive with features, mapped from its begin to its end; identities given, or found on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.factors import Between, PointObservation
from clew.geometry import SE2, Point2, se2
from clew.graph import FactorGraph
from clew.io import UNNAMED, FeatureLog
from clew.slam.landmarks.components import VarianceComponents
from clew.slam.landmarks.mapper import AssociationConfig, LandmarkMapper
from clew.slam.landmarks.start import dead_reckoning
from clew.solve import Solution, optimize

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_REDUNDANT = 20  # degrees of freedom from which on residuals tell how good measurements are


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """A robot's path and the landmarks that it saw, in the frame of its first pose.

    Measurements have the weights of the log in `graph`; how good they are in truth is found from the residuals and
    multiplies the covariances here (`unit_variance`).

    Attributes:
        keys: ``(N,)`` of the poses.
        T_world_robot: ``(N, 3)`` poses.
        T_odom_robot: ``(N, 3)`` where odometry alone leads.
        identity: ``(L,)`` numbers of the landmarks: those of the log, or counted from 0 in the order of first sight.
        position: ``(L, 2)`` metres.
        covariance: ``(L, 2, 2)`` of the positions.
        sightings: ``(L,)`` how often each was seen.
        landmark: ``(K,)`` identity of the landmark of each feature of the log, -1 for those that are of none.
        unit_variance: variance of measurements as a multiple of what the log says.
        components: the same by kind of measurement, where association had to find it; else None.
        exhausted: moments whose sightings could be paired off in so many ways that not all were tried.
        graph: all measurements at the solution.
        solution: of the graph.
    """

    keys: Indices
    T_world_robot: Array
    T_odom_robot: Array
    identity: Indices
    position: Array
    covariance: Array
    sightings: Indices
    landmark: Indices
    unit_variance: float
    components: VarianceComponents | None
    exhausted: int
    graph: FactorGraph
    solution: Solution


def map_features(
    log: FeatureLog, *, identities: bool = True, config: AssociationConfig | None = None,
    progress: Callable[[int], None] | None = None,
) -> FeatureMap:
    """Map a drive.

    Args:
        log: see `clew.io.FeatureLog`.
        identities: use the identities of the log, if it has any; otherwise they are found out.
        config: how; see `AssociationConfig`.
        progress: called with the number of features that have been associated, now and then.

    Raises:
        InputError: no features.
    """
    if not len(log.features.keys):
        raise InputError(f"{log.path}: there are no features in it, so there is nothing to map")
    if identities and log.identity is not None:
        return _result(log, log.identity, None, 0, _solve_given(log, log.identity))
    mapper = LandmarkMapper(config, first_key=int(log.keys[0]), landmark_key=int(log.keys[-1]) + 1)
    features = log.features
    first, last = (np.searchsorted(features.keys, log.keys, side=side).tolist() for side in ("left", "right"))
    for row, key in enumerate(log.keys.tolist()):
        if row:
            mapper.move(key, log.motion[row - 1], log.information[row - 1])
        if last[row] > first[row]:
            here = slice(first[row], last[row])
            mapper.see(features.measurement[here], features.information[here])
            if progress is not None:
                progress(last[row])
    solution = mapper.solve(final=True)
    found = mapper.landmarks
    keys, start = np.unique(found[found >= 0], return_index=True)
    number = np.empty(len(keys), np.int64)
    number[np.argsort(start, kind="stable")] = np.arange(len(keys))
    landmark = np.where(found >= 0, number[np.minimum(np.searchsorted(keys, found), len(keys) - 1)], UNNAMED)
    return _result(log, landmark, mapper.components, mapper.exhausted, solution)


def _solve_given(log: FeatureLog, identity: Indices) -> Solution:
    named = np.flatnonzero(identity >= 0)
    if not len(named):
        raise InputError(f"{log.path}: none of its {len(identity)} features has an identity; find them out instead")
    poses = dead_reckoning(log.motion)
    graph = FactorGraph()
    graph.add_pose(SE2.from_array(poses), key=log.keys)
    graph.set_constant(int(log.keys[0]))
    numbers, first = np.unique(identity[named], return_index=True)
    seen = log.features
    rows = named[first]
    where = se2.act(poses[np.searchsorted(log.keys, seen.keys[rows])], seen.measurement[rows])
    keys = int(log.keys[-1]) + 1 + numbers
    graph.add_point(where, key=keys)
    graph.add(Between(log.keys[:-1], log.keys[1:], log.motion, information=log.information))
    graph.add(
        PointObservation(seen.keys[named], keys[np.searchsorted(numbers, identity[named])], seen.measurement[named],
                         information=seen.information[named])
    )  # fmt: skip
    return optimize(graph)


def _result(
    log: FeatureLog, landmark: Indices, components: VarianceComponents | None, exhausted: int, solution: Solution
) -> FeatureMap:
    """Landmarks in the order of their keys, which is that of `landmark`'s numbers where identities were given."""
    graph = solution.graph
    block = next(b for b in graph.blocks() if b.kinds == (SE2, Point2))
    used = np.flatnonzero(landmark >= 0)
    order = np.argsort(log.features.keys[used], kind="stable")
    identity, row, count = np.unique(landmark[used[order]], return_inverse=True, return_counts=True)
    key = np.empty(len(identity), np.int64)
    key[row] = block.keys[:, 1]
    rows = np.argsort(solution.keys(Point2))
    rows = rows[np.searchsorted(solution.keys(Point2)[rows], key)]
    redundancy = 2 * (len(used) - len(identity))  # a relative pose determines the next pose, no more
    unit = solution.chi2 / redundancy if redundancy >= _REDUNDANT else 1.0
    poses = solution.values(SE2).array[np.argsort(solution.keys(SE2))]
    return FeatureMap(
        log.keys, poses, dead_reckoning(log.motion), identity, solution.values(Point2).array[rows],
        unit * solution.covariances(Point2)[rows], count, landmark, unit, components,
        exhausted, graph, solution,
    )  # fmt: skip
