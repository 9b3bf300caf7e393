"""The same landmarks in two maps, found by the distances between them, with no initial guess.

Every two landmarks of one map and two of the other that are equally far apart propose a relative pose; it is as
good as the number of landmarks that it brings together. What chance would have brought together is bounded by the
expected number of false alarms, as in a-contrario RANSAC (Moisan & Stival, IJCV 2004).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.stats import binom

from clew.fleet.rigid_fit import RigidFit, fit_rigid, mahalanobis, pair_covariances
from clew.geometry import se2, so2, wrap

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: Numbers that limit the work: partners of a landmark in proposals, proposals scored, proposals refined.
NEIGHBOURS, MOST_SCORED, MOST_REFINED = 24, 12_000, 20
OTHER_HEADING = 0.35  # radians; a pose from two near landmarks is that far off at times and still the same
NEAREST = 1.0  # squared Mahalanobis; landmarks that agree better than their deviation tell no more for it
CHUNK = 200_000  # distances held in memory at a time


@dataclass(frozen=True, eq=False)
class PointMap:
    """Points with their uncertainty in the frame of one robot.

    Attributes:
        points: ``(n, 2)`` metres.
        covariances: ``(n, 2, 2)``.
    """

    points: Array
    covariances: Array

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, eq=False)
class Agreement:
    """The relative pose that brings most landmarks together.

    Attributes:
        fit: pose and covariance from `pairs`.
        pairs: ``(n, 2)`` indices in a and b.
        runner_up: number of landmarks that the best *other* pose brings together.
        log10_false_alarms: of the expected number of poses that would bring as many together by chance.
    """

    fit: RigidFit
    pairs: Index
    runner_up: int
    log10_false_alarms: float


def find_agreement(a: PointMap, b: PointMap, compatible: Mask, *, gate: float, seed: int = 0) -> Agreement | None:
    """The best relative pose of two maps, and how it compares with the next best and with chance.

    Args:
        a, b: the maps.
        compatible: ``(len(a), len(b))``, which may be the same landmark.
        gate: squared Mahalanobis distance up to which two landmarks are together.
        seed: of the choice among proposals where there are more than can be scored.

    Returns:
        None if no two landmarks fit two others.
    """
    spread_a, spread_b = _spread(a), _spread(b)
    proposals, total = _propose(a, b, spread_a, spread_b, compatible, np.sqrt(gate), seed)
    if total == 0:
        return None
    reach = gate * (spread_b[:, None] ** 2 + spread_a[None, :] ** 2)
    within = np.where(compatible.T, reach, -1.0)
    counts = np.concatenate([
        _count(a, b, chunk, within)
        for chunk in np.array_split(proposals, 1 + len(proposals) * len(a) * len(b) // CHUNK)
    ])  # fmt: skip
    refined = _refine_best(a, b, proposals, counts, compatible, gate)
    if not refined:
        return None
    fit, pairs = max(refined, key=lambda found: (len(found[1]), -float(found[0].distances.sum())))
    common = b.points[pairs[:, 1]]
    span = 3 * np.sqrt(reach.max())
    # What chance, or another overlap, brings together: proposals that do not lead to the best pose.
    shift = se2.act(proposals, common.mean(axis=0)) - se2.act(fit.T_a_b, common.mean(axis=0))
    other = (np.hypot(*shift.T) > span) | (np.abs(wrap(proposals[:, 2] - fit.T_a_b[2])) > OTHER_HEADING)
    rivals = refined + _refine_best(a, b, proposals[other], counts[other], compatible, gate)
    moved = [np.hypot(*(se2.act(f.T_a_b, common) - se2.act(fit.T_a_b, common)).T).max() for f, _ in rivals]
    runner_up = max([2, *(len(p) for (_, p), far in zip(rivals, moved, strict=True) if far > span)])
    by_chance = float(np.mean(counts[other] - 2)) if other.any() else 0.0
    most = min(len(a), len(b)) - 2
    chance = np.clip(max(_coverage(a, np.median(reach)), by_chance / max(most, 1)), 0.0, 0.99)
    return Agreement(fit, pairs, runner_up, _false_alarms(fit, total, most, float(chance), gate))


def _false_alarms(fit: RigidFit, total: int, most: int, chance: float, gate: float) -> float:
    """Logarithm (base 10) of the expected number of poses that fit as well by chance.

    For each number of pairs, the largest of their distances says how near chance would have to bring that many: the
    probability is that of the gate, less in the proportion of the areas. The best of all numbers counts, and each has
    been tried (Moisan & Stival, section 3.2). Two pairs fit always.
    """
    ordered = np.maximum(np.sort(fit.distances)[2:], NEAREST)
    if not len(ordered) or most < 1:
        return float(np.log10(total))
    count = np.arange(1, len(ordered) + 1)
    tail = binom.logsf(count - 1, most, np.clip(chance * ordered / gate, 1e-12, 0.99)) / np.log(10)
    return float(np.log10(total * most) + tail.min())


def _refine_best(a: PointMap, b: PointMap, proposals: Array, counts: Index, compatible: Mask,
                 gate: float) -> list[tuple[RigidFit, Index]]:
    """The most promising proposals, refined."""
    promising = np.argsort(-counts, kind="stable")[:MOST_REFINED]
    refined = (_refine(a, b, proposals[row], compatible, gate) for row in promising)
    return [found for found in refined if found is not None]


def match_nearest(a: PointMap, b: PointMap, T_a_b: Array, compatible: Mask, gate: float) -> Index:
    """Pairs ``(n, 2)`` of landmarks that are each other's nearest under a pose, within the gate."""
    if not len(a) or not len(b):
        return np.empty((0, 2), np.int64)
    distances = _distances(a, b, T_a_b, compatible, gate)
    nearest_a, nearest_b = distances.argmin(axis=0), distances.argmin(axis=1)
    mutual = np.flatnonzero(nearest_b[nearest_a] == np.arange(len(b)))
    mutual = mutual[np.isfinite(distances[nearest_a[mutual], mutual])]
    return np.stack([nearest_a[mutual], mutual], axis=1)


def match_unique(a: PointMap, b: PointMap, fit: RigidFit, compatible: Mask, gate: float) -> Index:
    """Pairs ``(n, 2)`` of landmarks that nothing else comes near, with what the pose itself is uncertain by."""
    jacobian = se2.act_jacobians(np.broadcast_to(fit.T_a_b, (len(b), 3)), b.points)[0]
    rotation = so2.matrix(fit.T_a_b[2:])
    moved = rotation.T @ jacobian @ fit.covariance @ np.swapaxes(jacobian, 1, 2) @ rotation  # in frame b
    near = np.isfinite(_distances(a, PointMap(b.points, b.covariances + moved), fit.T_a_b, compatible, gate))
    alone = near & (near.sum(axis=0) == 1)[None] & (near.sum(axis=1) == 1)[:, None]
    return np.argwhere(alone)


def _distances(a: PointMap, b: PointMap, T_a_b: Array, compatible: Mask, gate: float) -> Array:
    """Squared Mahalanobis distances ``(len(a), len(b))``, infinite for landmarks that are not together."""
    covariances = pair_covariances(T_a_b, a.covariances[:, None], b.covariances[None])
    distances = mahalanobis(a.points[:, None] - se2.act(T_a_b, b.points)[None], covariances)
    return np.where(compatible & (distances < gate), distances, np.inf)


def share_in_common_area(a: PointMap, b: PointMap, T_a_b: Array, pairs: Index) -> float:
    """Of the landmarks of both maps that stand among the common ones, the share that is common.

    Where both robots have been they should have seen the same. Common landmarks on a line have no area: 1.
    """
    corners = a.points[pairs[:, 0]]
    try:
        hull = ConvexHull(corners).equations
    except QhullError:
        return 1.0
    inside = [
        np.all(points @ hull[:, :2].T + hull[:, 2] <= 1e-6, axis=1).sum()
        for points in (a.points, se2.act(T_a_b, b.points))
    ]
    return float(2 * len(pairs) / max(sum(inside), 2 * len(pairs)))


def _spread(points: PointMap) -> Array:
    """``(n,)`` largest standard deviation of each point, metres."""
    return np.asarray(np.sqrt(np.linalg.eigvalsh(points.covariances)[:, -1]))


def _propose(a: PointMap, b: PointMap, spread_a: Array, spread_b: Array, compatible: Mask, gate: float,
             seed: int) -> tuple[Array, int]:
    """Poses ``(H, 3)`` from equally long pairs of landmarks, and how many there were before choosing."""
    first_a, second_a, length_a = _pairs(a, both_ways=False)
    first_b, second_b, length_b = _pairs(b, both_ways=True)
    order = np.argsort(length_b)
    first_b, second_b, length_b = first_b[order], second_b[order], length_b[order]
    most = gate * np.sqrt(2 * spread_a.max(initial=0) ** 2 + 2 * spread_b.max(initial=0) ** 2)
    low, high = np.searchsorted(length_b, length_a - most), np.searchsorted(length_b, length_a + most)
    rows_a = np.repeat(np.arange(len(length_a)), high - low)
    starts = np.repeat(np.cumsum(high - low) - (high - low), high - low)
    rows_b = np.repeat(low, high - low) + np.arange(len(rows_a)) - starts
    i, j, k, m = first_a[rows_a], second_a[rows_a], first_b[rows_b], second_b[rows_b]
    variance = spread_a[i] ** 2 + spread_a[j] ** 2 + spread_b[k] ** 2 + spread_b[m] ** 2
    fits = np.abs(length_a[rows_a] - length_b[rows_b]) < gate * np.sqrt(variance)
    fits &= compatible[i, k] & compatible[j, m]
    # Two landmarks nearer than their uncertainty tell no direction.
    fits &= length_a[rows_a] > 2 * np.sqrt(variance)
    chosen = np.flatnonzero(fits)
    total = len(chosen)
    if total > MOST_SCORED:
        chosen = np.sort(np.random.default_rng(seed).choice(chosen, MOST_SCORED, replace=False))
    i, j, k, m = i[chosen], j[chosen], k[chosen], m[chosen]
    along_a, along_b = a.points[j] - a.points[i], b.points[m] - b.points[k]
    theta = np.arctan2(along_a[:, 1], along_a[:, 0]) - np.arctan2(along_b[:, 1], along_b[:, 0])
    turn = np.stack([np.zeros(total if total <= MOST_SCORED else MOST_SCORED)] * 2 + [theta], axis=1)
    middle_a, middle_b = (a.points[i] + a.points[j]) / 2, (b.points[k] + b.points[m]) / 2
    return se2.canonical(np.column_stack([middle_a - se2.act(turn, middle_b), theta])), total


def _pairs(points: PointMap, both_ways: bool) -> tuple[Index, Index, Array]:
    """First, second and distance of landmarks that are neighbours; each pair once or in both orders."""
    distance = np.hypot(*np.moveaxis(points.points[:, None] - points.points[None], 2, 0))
    near = np.argsort(distance, axis=1, kind="stable")[:, : NEIGHBOURS + 1]
    linked = np.zeros(distance.shape, dtype=bool)
    np.put_along_axis(linked, near, True, axis=1)
    linked |= linked.T
    np.fill_diagonal(linked, False)
    first, second = np.nonzero(linked if both_ways else np.triu(linked))
    return first, second, distance[first, second]


def _count(a: PointMap, b: PointMap, poses: Array, reach: Array) -> Index:
    """How many landmarks of b each pose ``(H, 3)`` brings within `reach` (squared, ``(b, a)``) of one of a."""
    moved, fixed = se2.act(poses[:, None], b.points[None]), a.points
    # Coordinate by coordinate: a product with an inner length of 2 is no work for a threaded BLAS.
    squared = (moved[..., 0, None] - fixed[:, 0]) ** 2
    squared += (moved[..., 1, None] - fixed[:, 1]) ** 2
    together = squared < reach
    return np.asarray(together.any(axis=2).sum(axis=1))


def _refine(a: PointMap, b: PointMap, pose: Array, compatible: Mask, gate: float) -> tuple[RigidFit, Index] | None:
    """Fit and match in turns until the matches stand; None if fewer than two are left."""
    previous: Index | None = None
    wide = 4 * gate  # the first pose stands on two landmarks only
    for _ in range(12):
        pairs = match_nearest(a, b, pose, compatible, wide)
        if len(pairs) < 2:
            return None
        rows, columns = pairs.T
        fit = fit_rigid(a.points[rows], b.points[columns], a.covariances[rows], b.covariances[columns])
        if not np.isfinite(fit.T_a_b).all():
            return None
        if wide == gate and previous is not None and np.array_equal(previous, pairs):
            return fit, pairs
        pose, previous, wide = fit.T_a_b, pairs, gate
    return fit, pairs


def _coverage(a: PointMap, reach: float) -> float:
    """Probability that a point thrown into the map of `a` falls within `reach` (squared) of a landmark."""
    extent = np.ptp(a.points, axis=0) + 2 * np.sqrt(reach)
    return float(min(1.0, len(a) * np.pi * reach / extent.prod()))
