"""Which landmarks are none: seen once or twice, and not seen where they would have been."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import binom

from clew.geometry import se2
from clew.slam.landmarks.record import Seen
from clew.slam.landmarks.review import points_of
from clew.solve import Solution

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_ESTABLISHED = 4  # sightings of a landmark that is there beyond doubt
_LOWEST_RATE = 0.1  # quantile of the rates at which established landmarks are seen when in view
_IMPROBABLE = 0.001
_EDGE = 0.02  # share of sightings at each border of the field of view that is not counted on


def never_there(solution: Solution, seen: Seen) -> Indices:
    """Keys of landmarks that prove to be false sightings.

    What the sensor sees is read from the sightings themselves: ranges and bearings at which there are any, and how
    often an established landmark in that field was seen. A landmark that was seen fewer times than even one of those
    that are seen most seldom would have been, beyond chance, was none.
    """
    used = seen.landmark >= 0
    keys, count = np.unique(seen.landmark[used], return_counts=True)
    established = count >= _ESTABLISHED
    if not established.any():
        return np.empty(0, np.int64)
    views = _views(solution, seen, points_of(solution, keys))
    rates = np.minimum(count[established] / np.maximum(views[established], count[established]), 1.0)
    rate = float(np.quantile(rates, _LOWEST_RATE))
    chance = binom.cdf(count, np.maximum(views, count), rate)
    none: Indices = keys[~established & (chance < _IMPROBABLE)]
    return none


def _views(solution: Solution, seen: Seen, points: Array) -> Indices:
    """``(L,)`` from how many poses that saw anything each landmark was in view."""
    kind = solution.kinds[0]
    order = np.argsort(solution.keys(kind))
    looking = np.unique(seen.pose)
    poses = solution.values(kind).array[order[np.searchsorted(solution.keys(kind)[order], looking)]]
    distance, bearing = np.hypot(*seen.z.T), np.arctan2(seen.z[:, 1], seen.z[:, 0])
    nearest, furthest = np.quantile(distance, [_EDGE, 1.0 - _EDGE])
    right, left = np.quantile(bearing, [_EDGE, 1.0 - _EDGE])
    out = np.zeros(len(points), np.int64)
    tree = cKDTree(poses[:, :2])
    for row, around in enumerate(tree.query_ball_point(points, furthest)):
        q = se2.act(se2.inverse(poses[around]), points[row])
        angle = np.arctan2(q[:, 1], q[:, 0])
        out[row] = np.sum((np.hypot(*q.T) >= nearest) & (angle >= right) & (angle <= left))
    return out
