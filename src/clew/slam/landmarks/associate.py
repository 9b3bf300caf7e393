"""A recorded drive with features that nobody has recognised, mapped from its begin to its end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.factors import Between
from clew.geometry import SE2
from clew.graph import FactorGraph
from clew.slam.landmarks.mapper import AssociationConfig, LandmarkMapper
from clew.solve import Solution

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def associate_features(
    graph: FactorGraph, pose: Indices, points: Array, information: Array, config: AssociationConfig | None = None,
    progress: Callable[[int], None] | None = None,
) -> tuple[Indices, LandmarkMapper, Solution]:
    """Drive along a graph's odometry and associate features seen on the way.

    Args:
        graph: poses in the plane, each tied to the one before it by a relative pose.
        pose: ``(K,)`` key of the pose of each feature (`clew.io.Features`).
        points: ``(K, 2)`` features in the frame of the pose, metres.
        information: ``(K, 2, 2)``.
        config: see `AssociationConfig`.
        progress: called with the number of features done, now and then.

    Returns:
        Key ``(K,)`` of the landmark of each feature, the mapper, and the solution of its graph.

    Raises:
        InputError: a pose that no relative pose ties to the one before it, or no features.
    """
    if len(pose) == 0:
        raise InputError("there are no features to associate; the file holds none")
    keys, motion, weight = chain(graph)
    order = np.argsort(pose, kind="stable")
    first, last = (np.searchsorted(pose[order], keys, side=side).tolist() for side in ("left", "right"))
    mapper = LandmarkMapper(config, first_key=int(keys[0]), landmark_key=int(keys[-1]) + 1)
    for row, key in enumerate(keys.tolist()):
        if row:
            mapper.move(key, motion[row - 1], weight[row - 1])
        if last[row] > first[row]:
            rows = order[first[row] : last[row]]
            mapper.see(points[rows], information[rows])
            if progress is not None:
                progress(last[row])
    solution = mapper.solve(final=True)
    landmarks = np.empty(len(order), np.int64)
    landmarks[order] = mapper.landmarks
    return landmarks, mapper, solution


def chain(graph: FactorGraph) -> tuple[Indices, Array, Array]:
    """Keys ``(N,)`` of a graph's poses in order, with motion ``(N - 1, 3)`` and information from each to the next.

    Raises:
        InputError: a pose without a relative pose to the one before it.
    """
    keys = np.sort(graph.keys(SE2))
    motion, information = np.full((len(keys) - 1, 3), np.nan), np.zeros((len(keys) - 1, 3, 3))
    for block in graph.blocks():
        if isinstance(block, Between):
            place = np.searchsorted(keys, block.keys)
            rows = np.flatnonzero(place[:, 1] - place[:, 0] == 1)
            motion[place[rows, 0]], information[place[rows, 0]] = block.measurement[rows], block.information[rows]
    missing = keys[1:][np.isnan(motion[:, 0])]
    if len(missing):
        raise InputError(f"pose {missing[0]} has no relative pose to the one before it; give a graph with odometry")
    return keys, motion, information
