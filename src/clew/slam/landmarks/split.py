"""Landmarks that prove to be two: taken for one while the map was not yet sure enough to tell.

Sightings of one visit belong together; whether those of some visits are of another landmark than the rest is asked of
each landmark at the end. Were they, what they see would be off by some ``delta``. With residuals ``r``, their noise
``R`` and covariance ``V = R - J C J^T`` at the solution (Baarda 1968), ``s = H^T R^-1 r`` over these visits has the
covariance ``M = H^T R^-1 V R^-1 H``: ``delta = M^-1 s`` has the covariance ``M^-1``, and chi2 of the whole graph falls
by ``s^T M^-1 s`` where they are given a landmark of their own. That is weighed as in joining, by the same odds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.factors import PointObservation
from clew.geometry import SE2
from clew.place import JoinOptions, evidence_of_one
from clew.slam.landmarks.review import density_of, points_of
from clew.solve import Solution

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_PAUSE = 10  # poses without a sighting of a landmark that end a visit
_FEWEST = 2  # sightings of a landmark of its own; one that is off may be an outlier
_STARTS = 3  # visits from which on the others are sought
_SINGULAR = 1e-6  # of the information in all sightings: less in those of some visits tells nothing about an offset


def two_in_one(
    solution: Solution, sightings: PointObservation, options: JoinOptions | None = None
) -> list[Indices]:
    """Rows of the sightings of each landmark that are clearly of another one.

    Args:
        solution: of the graph.
        sightings: all of its sightings, with the information that they had in the solve.
        options: odds by which two must be likelier than one.
    """
    options = options or JoinOptions()
    landmark = sightings.keys[:, 1]
    keys, counts = np.unique(landmark, return_counts=True)
    density = density_of(points_of(solution, keys), counts)
    poses = np.sort(solution.keys(SE2))
    order = np.argsort(landmark, kind="stable")
    groups = np.split(order, np.cumsum(counts)[:-1])
    found = []
    for rows in groups:
        rows = rows[np.argsort(sightings.keys[rows, 0], kind="stable")]
        place = np.searchsorted(poses, sightings.keys[rows, 0])
        visit = np.cumsum(np.append(0, np.diff(place) > _PAUSE))
        if visit[-1] == 0 or len(rows) < 2 * _FEWEST:
            continue
        score, spread = _scores(solution, sightings, rows, visit)
        some, covariance, fall = _most_apart(score, spread)
        apart = np.isin(visit, some)
        if min(apart.sum(), (~apart).sum()) < _FEWEST:
            continue
        if evidence_of_one(np.array(fall), covariance, density) < -np.log(options.odds):
            found.append(rows[apart] if apart.sum() <= (~apart).sum() else rows[~apart])
    return found


def _scores(solution: Solution, sightings: PointObservation, rows: Indices, visit: Indices) -> tuple[Array, Array]:
    """``s`` ``(V, 2)`` of each visit, and their joint covariance ``(V, 2, V, 2)``."""
    key = int(sightings.keys[rows[0], 1])
    seen_from, place = np.unique(sightings.keys[rows, 0], return_inverse=True)
    order = np.argsort(solution.keys(SE2))
    at = order[np.searchsorted(solution.keys(SE2)[order], seen_from)]
    pose = solution.values(SE2).array[at][place]
    point = np.broadcast_to(solution.value(key).array, (len(rows), 2))
    residual = sightings.residual(pose, point, measurement=sightings.measurement[rows])
    jacobians = sightings.jacobians(pose, point, measurement=sightings.measurement[rows])
    assert jacobians is not None
    by_pose, by_point = jacobians
    count = int(visit[-1]) + 1
    weighed = sightings.information[rows] @ by_point
    score, own = np.zeros((count, 2)), np.zeros((count, 2, 2))
    np.add.at(score, visit, np.einsum("nik,ni->nk", weighed, residual))
    np.add.at(own, visit, np.swapaxes(weighed, 1, 2) @ by_point)
    by_all = np.zeros((count, 2, 3 * len(seen_from) + 2))
    mine = 3 * place[:, None] + np.arange(3)
    np.add.at(by_all, (visit[:, None, None], np.arange(2)[:, None], mine[:, None, :]),
              np.swapaxes(weighed, 1, 2) @ by_pose)  # fmt: skip
    by_all[:, :, -2:] = own
    flat = by_all.reshape(2 * count, -1)
    joint = solution.joint_covariance([*seen_from.tolist(), key])
    spread = -(flat @ joint @ flat.T).reshape(count, 2, count, 2)
    spread[np.arange(count), :, np.arange(count)] += own
    return score, spread


def _most_apart(score: Array, spread: Array) -> tuple[Indices, Array, float]:
    """Visits that chi2 falls most without, by taking them in or out one after the other, from a few starts.

    Also the covariance ``(2, 2)`` of their offset, and by what chi2 falls.
    """
    every = np.eye(len(score), dtype=bool)
    alone, _ = _falls(score, spread, every)
    best, chosen = 0.0, every[0]
    for start in np.argsort(-alone, kind="stable")[:_STARTS].tolist():
        some, fall = every[start], float(alone[start])
        while True:
            toggled = some ^ every
            falls, _ = _falls(score, spread, toggled)
            k = int(np.argmax(falls))
            if falls[k] <= fall * (1.0 + 1e-9):
                break
            some, fall = toggled[k], float(falls[k])
        if fall > best:
            best, chosen = fall, some
    _, information = _falls(score, spread, chosen[None])
    return np.flatnonzero(chosen), np.linalg.pinv(information[0]), best


def _falls(score: Array, spread: Array, sets: NDArray[np.bool_]) -> tuple[Array, Array]:
    """By what chi2 falls ``(S,)`` without sets of visits ``(S, V)``, -1 where it cannot be told; and ``M``."""
    some = sets.astype(np.float64)
    s = some @ score
    m = np.einsum("sv,viwj,sw->sij", some, spread, some, optimize=True)
    total = np.trace(np.einsum("vivj->ij", spread))
    telling = np.linalg.eigvalsh(m)[:, 0] > _SINGULAR * total
    falls = np.full(len(some), -1.0)
    falls[telling] = np.einsum("vi,vi->v", s[telling], np.linalg.solve(m[telling], s[telling, :, None])[:, :, 0])
    return falls, m
