"""Associations looked at again once a solve has moved poses and landmarks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.geometry import Point2, se2, so2
from clew.place import Gates
from clew.solve import Solution

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_NEIGHBOURS = 4
_FURTHEST = 30.0  # squared Mahalanobis distance of two landmarks that are one
_ESTABLISHED = 3  # sightings
_PREFERRED = 2.5  # how much further than the gate a sighting may be from an established landmark


def merge_landmarks(
    solution: Solution, pose: Indices, noise: Array, landmark: Indices, gates: Gates, unit: float
) -> Indices:
    """Associations ``(K,)`` after landmarks that prove to be one have become one.

    Two are one if they are within the gate of each other in their joint covariance, or nearer than chance would have
    it, or so near that no sighting (covariances ``(K, 2, 2)`` in `noise`) could tell them apart, and were never seen
    both from one pose. The one with more sightings gives the key. All covariances are to be multiplied by `unit`.
    """
    keys = np.unique(landmark[landmark >= 0])
    if len(keys) < 2:
        return np.array(landmark, np.int64)
    points = _points(solution, keys)
    spread = np.sqrt(unit * np.trace(solution.covariances(Point2), axis1=1, axis2=2).max())
    blur = unit * float(np.median(np.trace(noise, axis1=1, axis2=2))) / 2.0  # variance of a sighting in any direction
    reach = max(spread * np.sqrt(2.0 * _FURTHEST), np.sqrt(blur * gates.known))
    nearby = cKDTree(points).query_pairs(float(reach), output_type="ndarray")
    density = len(points) / max(float(np.prod(np.ptp(points, axis=0))), 1e-6)
    lengths = np.linalg.norm(points[nearby[:, 0]] - points[nearby[:, 1]], axis=1)
    counts = {int(key): int(n) for key, n in zip(*np.unique(landmark, return_counts=True), strict=True)}
    seen_from = {int(key): set(pose[landmark == key].tolist()) for key in keys}
    into: dict[int, int] = {}
    for a, b in nearby[np.argsort(lengths, kind="stable")].tolist():
        first, second = int(keys[a]), int(keys[b])
        if first in into or second in into or seen_from[first] & seen_from[second]:
            continue
        joint = solution.joint_covariance([first, second])
        between = joint[:2, :2] + joint[2:, 2:] - joint[:2, 2:] - joint[2:, :2]
        difference = points[a] - points[b]
        # Likelier one landmark than two that by chance stand so close, given how many there are in the area: where both
        # are known well, that bears more than the chance that a gate leaves.
        spread_of_both = unit * between + 1e-12 * np.eye(2)
        crowding = -np.log(4.0 * np.pi**2 * np.linalg.det(spread_of_both) * density**2)
        limit = min(max(gates.known, crowding), _FURTHEST)
        alike = difference @ difference <= gates.known * blur
        if not alike and difference @ np.linalg.solve(spread_of_both, difference) > limit:
            continue
        kept, gone = (first, second) if counts[first] >= counts[second] else (second, first)
        into[gone] = kept
        seen_from[kept] |= seen_from[gone]
    out: Indices = np.array(landmark, np.int64)
    for gone, kept in into.items():
        while kept in into:
            kept = into[kept]
        out[landmark == gone] = kept
    return out


def reassign(
    solution: Solution, pose: Indices, z: Array, noise: Array, landmark: Indices, gates: Gates
) -> tuple[Indices, Indices]:
    """Associations ``(K,)`` with each sighting at the nearest landmark to where the solved pose puts it.

    Also the rows of sightings without a landmark that turn out to be of new ones.

    Pose and landmarks count as known: at a solved pose their uncertainty relative to each other is small against the
    noise of one sighting. Two sightings from one pose never become one landmark.
    """
    keys, counts = np.unique(landmark[landmark >= 0], return_counts=True)
    if not len(keys):
        return np.array(landmark, np.int64), np.flatnonzero(landmark < 0)
    points = _points(solution, keys)
    poses = solution.values(solution.kinds[0]).array
    pose_keys = solution.keys()
    order = np.argsort(pose_keys)
    at = poses[order[np.searchsorted(pose_keys, pose, sorter=order)]]
    world = se2.act(at, z)
    turn = so2.matrix(at[:, 2:])
    spread = turn @ noise @ np.swapaxes(turn, 1, 2)
    _, near = cKDTree(points).query(world, k=min(_NEIGHBOURS, len(keys)))
    near = near.reshape(len(z), -1)
    difference = world[:, None] - points[near]
    distance = np.einsum("kna,kab,knb->kn", difference, np.linalg.inv(spread), difference)
    # A landmark that was seen once or twice explains these sightings perfectly; one that is well known is preferred.
    provisional = counts[near] < _ESTABLISHED
    distance = np.where(provisional, distance + gates.known, distance)
    distance = np.where(~provisional & (distance <= _PREFERRED * gates.known), distance / _PREFERRED, distance)
    best = distance.argmin(axis=1)
    every = np.arange(len(z))
    lowest = distance[every, best]
    out = np.where(lowest <= gates.known, keys[near[every, best]], landmark)
    fresh = np.flatnonzero((landmark < 0) & (lowest > gates.new))
    return _exclusive(pose, out, landmark), fresh


def _exclusive(pose: Indices, after: Indices, before: Indices) -> Indices:
    """Undo changes that would give two sightings from one pose one landmark."""
    order = np.lexsort((after, pose))
    twice = (np.diff(pose[order]) == 0) & (np.diff(after[order]) == 0) & (after[order][1:] >= 0)
    clash = np.unique(pose[order][1:][twice])
    out: Indices = np.array(after, np.int64)
    back = np.isin(pose, clash)
    out[back] = before[back]
    return out


def _points(solution: Solution, keys: Indices) -> Array:
    all_keys = solution.keys(Point2)
    order = np.argsort(all_keys)
    points: Array = solution.values(Point2).array[order[np.searchsorted(all_keys, keys, sorter=order)]]
    return points
