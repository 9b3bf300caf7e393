"""Associations looked at again once a solve has moved poses and landmarks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.factors import PointObservation
from clew.geometry import Point2, se2, so2
from clew.place import NEW, Gates, join_landmarks, landmark_density, nearest_neighbour
from clew.slam.landmarks.record import Seen
from clew.slam.landmarks.track import TAIL
from clew.solve import Solution

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

_FURTHEST = 4.0  # standard deviations of two landmarks that may be one
_DOUBT = 9.0  # factor of the covariances: drift may be worse than residuals tell, for it is not all white
_MOVED = 0.5  # standard deviations that a landmark has moved by to be compared with others again
_SURER = 0.7  # of its standard deviation that a landmark has come down to to be compared again
_NEIGHBOURS = 6
_SURE = 3  # sightings of a landmark that is no longer provisional
_MOST = 400  # landmarks that are compared with each other at a time


def contradicted(seen: PointObservation, squares: tuple[Array, Array], gates: Gates) -> Indices:
    """Rows of sightings that the rest of the graph contradicts; `squares` are their `expected_squares`.

    A residual ``r`` with noise ``R`` has the covariance ``V = R - J C J^T`` at the solution, so ``r^T V^-1 r`` is chi
    square if the sighting belongs there (Baarda 1968, data snooping): the test of the sighting against everything else.
    """
    error, expected = squares
    noise = np.linalg.inv(seen.information)
    left = noise - (expected - error[:, :, None] * error[:, None, :])
    # a sighting that alone determines something cannot be contradicted
    share = np.trace(seen.information @ left, axis1=1, axis2=2) / 2.0
    tested = np.flatnonzero((share > 1e-3) & (np.linalg.det(left) > 1e-8 * np.linalg.det(noise)))
    r = error[tested]
    statistic = np.einsum("ni,ni->n", r, np.linalg.solve(left[tested], r[:, :, None])[:, :, 0])
    wrong: Indices = tested[statistic > gates.limit_new]
    return wrong


@dataclass(eq=False)
class Compared:
    """Landmarks as they stood when they were last compared with others: what has not changed need not be again."""

    keys: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    points: Array = field(default_factory=lambda: np.empty((0, 2)))
    deviation: Array = field(default_factory=lambda: np.empty(0))

    def changed(self, keys: Indices, points: Array, deviation: Array) -> Flags:
        """Which of some landmarks are new, have moved, or are surer by now; keys ascend."""
        if not len(self.keys):
            return np.ones(len(keys), bool)
        row = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        moved = np.linalg.norm(points - self.points[row], axis=1) > _MOVED * deviation
        changed: Flags = (self.keys[row] != keys) | moved | (deviation < _SURER * self.deviation[row])
        return changed

    def take(self, keys: Indices, points: Array, deviation: Array, left: Flags) -> None:
        """All have been compared but those that are left for the next time."""
        self.keys, self.points, self.deviation = keys[~left], points[~left], deviation[~left]


def join(solution: Solution, seen: Seen, compared: Compared) -> dict[int, int]:
    """Landmarks that prove to be others: key of each that goes, and of the one that it is.

    Args:
        solution: of the graph.
        seen: all sightings with the landmarks that they are taken for.
        compared: only landmarks that have changed since then are compared with others; brought up to date.
    """
    landmark = seen.landmark
    keys, counts = np.unique(landmark[landmark >= 0], return_counts=True)
    if len(keys) < 2:
        return {}
    points, spread = points_of(solution, keys), solution.covariances(Point2)
    order = np.argsort(solution.keys(Point2))
    deviation = np.sqrt(np.trace(spread[order][np.searchsorted(solution.keys(Point2)[order], keys)], axis1=1, axis2=2))
    density = density_of(points, counts)
    new = compared.changed(keys, points, deviation)
    apart = _seen_together(seen.pose, landmark, keys)
    chosen = _near_another(points, np.sqrt(_DOUBT) * deviation, new, apart)
    left = np.zeros(len(keys), bool)
    if len(chosen) < 2:
        compared.take(keys, points, deviation, left)
        return {}
    if len(chosen) == _MOST:
        left |= new
        left[chosen] = False
    some, apart = keys[chosen], apart[np.ix_(chosen, chosen)]
    covariance, count = solution.joint_covariance(some), counts[chosen]
    pairs = join_landmarks(points[chosen], covariance, apart, density)
    if not pairs:
        apart |= (count == 1)[:, None] | (count == 1)  # whether a single sighting is an outlier is seen at the end
        pairs = join_landmarks(points[chosen], _DOUBT * covariance, apart, density)
    if not pairs:
        compared.take(keys, points, deviation, left)
    into: dict[int, int] = {}
    for a, b in pairs:
        kept, gone = (a, b) if count[a] >= count[b] else (b, a)
        into[int(some[gone])] = int(some[kept])
    return into


def _near_another(points: Array, deviation: Array, new: Flags, apart: Flags) -> Indices:
    """Landmarks of pairs with a new one that may be one in view of their uncertainties; the nearest, if too many."""
    tree = cKDTree(points)
    pairs = tree.query_pairs(2.0 * _FURTHEST * float(deviation.max()), output_type="ndarray")
    pairs = pairs[new[pairs].any(axis=1) & ~apart[pairs[:, 0], pairs[:, 1]]]
    length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    ratio = length / np.maximum(deviation[pairs].sum(axis=1), 1e-9)
    pairs, ratio = pairs[ratio <= _FURTHEST], ratio[ratio <= _FURTHEST]
    pairs = pairs[np.argsort(ratio, kind="stable")]
    _, first = np.unique(pairs, return_index=True)
    listed = pairs.reshape(-1)[np.sort(first)][:_MOST]
    return np.sort(listed)


def _seen_together(pose: Indices, landmark: Indices, keys: Indices) -> Flags:
    """``(L, L)`` whether two landmarks were seen from one pose."""
    used = np.isin(landmark, keys)
    _, row = np.unique(pose[used], return_inverse=True)
    column = np.searchsorted(keys, landmark[used])
    order = np.argsort(row, kind="stable")
    row, column = row[order], column[order]
    apart = np.eye(len(keys), dtype=bool)
    for gap in range(1, int(np.bincount(row).max(initial=1))):
        same = row[gap:] == row[:-gap]
        apart[column[gap:][same], column[:-gap][same]] = True
        apart[column[:-gap][same], column[gap:][same]] = True
    return apart


@dataclass(frozen=True, eq=False)
class LooseSightings:
    """Sightings of one pose that have no landmark yet: where they are, with noise, and the pose's key."""

    pose: int
    z: Array
    noise: Array
    taken: Indices  # landmarks that others from this pose have


def find_again(
    solution: Solution, loose: LooseSightings, keys: Indices, points: Array, gates: Gates, density: float
) -> Indices:
    """Landmark ``(M,)`` of each sighting in the solved graph, `NEW` or `UNCLEAR`.

    Args:
        solution: of the graph without them.
        loose: see there.
        keys: ``(L,)`` of all landmarks.
        points: ``(L, 2)``.
        gates: see `clew.place.Gates`.
        density: of landmarks, a square metre.
    """
    at = solution.value(loose.pose).array
    free = ~np.isin(keys, loose.taken)
    keys, points = keys[free], points[free]
    view = se2.act(se2.inverse(at), points)
    pose_spread = solution.covariance(loose.pose)
    reach = _FURTHEST * np.sqrt(np.trace(pose_spread[:2, :2]) + np.trace(loose.noise, axis1=1, axis2=2).max())
    reach += _FURTHEST * np.sqrt(pose_spread[2, 2]) * np.linalg.norm(loose.z, axis=1).max() + 1.0
    near = np.flatnonzero((np.linalg.norm(view[None] - loose.z[:, None], axis=2) <= reach).any(axis=0))
    if not len(near):
        return np.full(len(loose.z), NEW)
    near = near[np.argsort(np.linalg.norm(view[near], axis=1), kind="stable")][:60]
    covariance = solution.joint_covariance([loose.pose, *keys[near].tolist()])
    view = view[near]
    jacobian = np.zeros((len(near), 2, 3 + 2 * len(near)))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = -1.0
    jacobian[:, 0, 2], jacobian[:, 1, 2] = view[:, 1], -view[:, 0]
    turn = so2.matrix(-at[2:])
    for row in range(len(near)):
        jacobian[row, :, 3 + 2 * row : 5 + 2 * row] = turn
    spread = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    found = nearest_neighbour(loose.z, view, spread, loose.noise, gates, density)
    out = np.where(found >= 0, keys[near[np.maximum(found, 0)]], found)
    return np.asarray(out, np.int64)


def join_singles(solution: Solution, seen: Seen) -> dict[int, int]:
    """Landmarks that were seen once and are likelier an outlying sighting of another; as `join`.

    Sightings have heavy tails: Student's t distribution in two dimensions for the distance of the two, against the
    density of landmarks that are seen for the first time, a square metre.
    """
    landmark = seen.landmark
    keys, counts = np.unique(landmark[landmark >= 0], return_counts=True)
    if len(keys) < 2:
        return {}
    reach = float(np.linalg.norm(seen.z, axis=1).max())
    births = len(keys) / len(landmark) / (np.pi * reach**2)
    points = points_of(solution, keys)
    tree = cKDTree(points)
    into: dict[int, int] = {}
    gone: set[int] = set()
    for single in np.flatnonzero(counts == 1).tolist():
        near = np.atleast_1d(tree.query(points[single], k=min(_NEIGHBOURS, len(keys)))[1])
        near = np.array([i for i in near.tolist() if i != single and i not in gone], np.int64)
        together = landmark[np.isin(seen.pose, seen.pose[landmark == keys[single]])]
        near = near[~np.isin(keys[near], together)]
        if not len(near):
            continue
        joint = solution.joint_covariance(keys[[single, *near.tolist()]])
        blocks = joint.reshape(len(near) + 1, 2, len(near) + 1, 2)
        every = np.arange(1, len(near) + 1)
        cross = blocks[0][:, every].swapaxes(0, 1)
        spread = blocks[0, :, 0] + blocks[every, :, every] - cross - cross.swapaxes(1, 2)
        difference = points[near] - points[single]
        distance = np.einsum("na,nab,nb->n", difference, np.linalg.inv(spread), difference)
        density = -np.log(2.0 * np.pi) - 0.5 * np.log(np.linalg.det(spread))
        density -= 0.5 * (TAIL + 2.0) * np.log1p(distance / TAIL)
        if density.max() > np.log(births):
            into[int(keys[single])] = int(keys[near[density.argmax()]])
            gone.add(single)
    return into


def density_of(points: Array, counts: Indices) -> float:
    """Landmarks a square metre, from those ``(L, 2)`` that were seen often enough (counts ``(L,)``) to be sure of.

    Provisional ones do not count: where places are seen again before the map has closed there, they are many and lie on
    others, and a density taken from them would make every gate look crowded, and so all that follows new again.
    """
    return landmark_density(points[counts >= min(_SURE, int(counts.max(initial=0)))])


def points_of(solution: Solution, keys: Indices) -> Array:
    """Positions ``(L, 2)`` of landmarks."""
    all_keys = solution.keys(Point2)
    order = np.argsort(all_keys)
    points: Array = solution.values(Point2).array[order[np.searchsorted(all_keys, keys, sorter=order)]]
    return points

