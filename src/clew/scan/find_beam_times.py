"""When the beams of a scan are measured, found from scans of a robot that turns.

A beam that is measured `t` seconds after the middle of its scan sees its return where the robot's motion has taken it
meanwhile. Beams in turns late and early make a straight wall jagged, as far as the robot turns: each scan by itself
tells how late. That they are measured one after the other bends what is seen; two scans of one place that were taken
while the robot turned differently disagree about it, whatever their poses. Both are linear in the seconds sought
(least squares, robust, linearised anew where the motion has been taken out so far), and say how sure they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.scan.align import AlignmentOptions, align
from clew.scan.beam_times import BeamTimes, interlace_of, sweep_of
from clew.scan.deskew import deskew
from clew.scan.index import index_cloud, join
from clew.scan.laser import LaserScan
from clew.scan.points import CleaningOptions, ScanPoints, extract_returns

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEVER = 3.0  # metres; what a turn of a radian moves
LEAST_SPEED = 0.3  # metres a second, turns as `LEVER` tells: scans of a slower robot say little
SCANS = 120  # that are looked at by themselves at most
PAIRS = 240  # of scans that are compared at most,
PAIRS_A_SCAN = 4  # and so many of each,
NEAR, TURNED = 2.0, 1.2  # metres and radians between the two at most
MOST_PLACED = 1500  # scans among which pairs are looked for: there may be as many as the square of it
MILDER = 3  # times at most that pairs half as different are tried, where the others are too bent to lie on each other
LEAST_SCANS, LEAST_PAIRS, LEAST_RETURNS = 10, 20, 100
ROUNDS = 8  # of linearisation at most,
SETTLED, SETTLED_SIGMAS = 2e-4, 0.5  # until the estimate moves less than this, seconds, or than so many deviations
FURTHER = 3.0  # times a step at most that is taken where the steps before fell short
RADIUS = 0.1  # metres; within which a return finds its partner
FACING = 0.7  # least cosine between their normals
OVERLAP = 0.5  # share of returns with a partner
LEAST_RESIDUAL = 1e-3  # metres; ranges are not told more finely
LEVERAGE = 3.0  # times what the motion moves the median return, from which on a return counts less
BLOCKS = 10  # of scans or pairs next to each other in time: what they err by together is in the deviations
SIGMAS = 4.0  # an estimate counts when it is so many deviations
LEAST_SECONDS = 1e-3  # and this from zero; less does no harm and may be the roughness of the world
LONGEST = 1.05  # periods of the scans; a scan that took longer is a mistake
BETTER = 0.995  # times the misfit without an estimate is left with it, at most: steps along a slope may lead uphill
TINY = 1e-12
ALIGNMENT = AlignmentOptions(radius_start=0.2, radius_end=RADIUS)


@dataclass(frozen=True)
class _Slope:
    """Sums of least squares in one unknown, one row a group of residuals.

    Attributes:
        curvature, gradient: ``(K,)`` of half the squared residuals.
        misfit: mean residual, metres, large ones cut.
    """

    curvature: Array
    gradient: Array
    misfit: float

    @property
    def step(self) -> float:
        return float(-self.gradient.sum() / max(self.curvature.sum(), TINY))

    def deviation(self) -> float:
        """Of the unknown at the minimum, by how much blocks of neighbouring rows contradict each other."""
        left = self.gradient + self.step * self.curvature
        blocks = np.add.reduceat(left, np.unique(np.linspace(0, len(left), BLOCKS, endpoint=False).astype(np.int64)))
        return float(np.sqrt(np.sum(blocks**2)) / max(self.curvature.sum(), TINY))


class _Search:
    """Steps towards where the gradient vanishes.

    Jagged and bent surfaces have normals that are off, and partners that hide some of it, so that each step falls short
    by about the same share: the secant of the last two goes on to where they lead.
    """

    def __init__(self) -> None:
        self._last: float | None = None  # step as linearised,
        self._taken = 0.0  # and as it was taken
        self.settled = False

    def step(self, sums: _Slope) -> float:
        linear = taken = sums.step
        if self._last is not None and self._last * (self._last - linear) > 0.0:
            taken = linear * min(max(self._taken / (self._last - linear), 1.0), FURTHER)
        self._last, self._taken = linear, taken
        self.settled = abs(taken) < max(SETTLED, SETTLED_SIGMAS * sums.deviation())
        return taken


def find_beam_times(
    scans: Sequence[LaserScan], T_world_robot: Array, velocities: Array, steady: NDArray[np.bool_], period: float,
    cleaning: CleaningOptions | None = None, share: float = 1.0, start: BeamTimes | None = None,
) -> BeamTimes:
    """Moments of the beams, as far as scans tell them for sure; zero what they do not tell.

    The relative pose of each pair of scans is found anew and does not count: the result says nothing in favour of the
    poses that it began with.

    Args:
        scans: ``N`` scans as they were recorded, whose beams are of unknown moments.
        T_world_robot: ``(N, 3)`` about where.
        velocities: ``(N, 3)`` body velocity at each, metres and radians a second.
        steady: ``(N,)`` whether it is known well.
        period: seconds from one scan to the next; none takes longer.
        cleaning: how returns are made of scans.
        share: of the scans and pairs that are looked at most; less is less sure and faster.
        start: what is believed so far; the result is found the sooner.
    """
    cleaning = cleaning or CleaningOptions()
    start = start or BeamTimes()
    speed = np.hypot(np.hypot(velocities[:, 0], velocities[:, 1]), LEVER * velocities[:, 2])
    usable = np.flatnonzero(steady & (speed >= LEAST_SPEED))
    fastest = usable[np.argsort(-speed[usable], kind="stable")][: int(share * SCANS)]
    found = BeamTimes(sweep=start.sweep)
    if len(fastest) >= LEAST_SCANS:
        rows = np.sort(fastest)
        found = _interlace([scans[i] for i in rows], velocities[rows], start, cleaning)
        if not _counts(found.interlace, found.interlace_deviation, period):
            found = replace(found, interlace=0.0)
    near, differs = _near_pairs(T_world_robot, velocities, usable)
    most_different, nothing = np.inf, replace(found, sweep=0.0)
    for _ in range(1 + MILDER):
        chosen = _telling(near, differs, int(share * PAIRS), most_different)
        if len(chosen) < LEAST_PAIRS:
            return nothing
        rows, local = np.unique(near[chosen], return_inverse=True)
        of_pairs = [scans[i] for i in rows]
        swept = _sweep(of_pairs, T_world_robot[rows], velocities[rows], local.reshape(-1, 2), found, cleaning)
        if np.isfinite(swept.sweep_deviation):
            return swept if _counts(swept.sweep, swept.sweep_deviation, period) else replace(swept, sweep=0.0)
        most_different = 0.5 * float(np.median(differs[chosen]))
    return nothing


def _counts(seconds: float, deviation: float, period: float) -> bool:
    return SIGMAS * deviation + LEAST_SECONDS <= abs(seconds) <= LONGEST * period


def _flow(cloud: ScanPoints, velocity: Array) -> Array:
    """``(n, 2)`` metres that returns move, seen from where the robot is at the timestamp, for each second later."""
    x, y = cloud.points.T
    return np.stack([velocity[0] - velocity[2] * y, velocity[1] + velocity[2] * x], axis=1)


def _weights(residuals: Array) -> Array:
    """Cauchy weights ``(n,)``, scaled by the residuals themselves: jagged walls are no outliers."""
    scale = 2.0 * 1.4826 * float(np.median(np.abs(residuals))) if len(residuals) else 1.0
    return np.asarray(1.0 / (1.0 + np.square(residuals / max(scale, TINY))))


def _interlace(
    scans: Sequence[LaserScan], velocities: Array, found: BeamTimes, cleaning: CleaningOptions
) -> BeamTimes:
    """By how far returns lie beside the line between their neighbours."""
    nothing = replace(found, interlace=0.0, interlace_deviation=float("inf"))
    search, best, misfit = _Search(), nothing, float("inf")
    for _ in range(ROUNDS):
        sums = _jagged(scans, velocities, found, cleaning)
        if sums is None:
            return nothing
        if sums.misfit >= misfit:  # the slope misleads
            break
        best, misfit = replace(found, interlace_deviation=sums.deviation()), sums.misfit
        if search.settled:
            break
        found = replace(found, interlace=found.interlace + search.step(sums))
    else:
        return nothing
    without = _jagged(scans, velocities, nothing, cleaning)
    return best if without is not None and misfit <= BETTER * without.misfit else replace(best, interlace=0.0)


def _jagged(
    scans: Sequence[LaserScan], velocities: Array, found: BeamTimes, cleaning: CleaningOptions
) -> _Slope | None:
    """Sums of each scan of how far its returns lie beside the line between their neighbours; None of too few."""
    parts = []
    for scan, velocity in zip(scans, velocities, strict=True):
        cloud, beams = extract_returns(deskew(found.of(scan), velocity), cleaning)
        late = interlace_of(len(scan.ranges))[beams]
        moved = _flow(cloud, velocity) * late[:, None]
        row = (np.diff(beams[:-1]) == 1) & (np.diff(beams[1:]) == 1) & (cloud.along[1:-1] == 0.0)
        normal = cloud.normals[1:-1]
        parts.append(tuple(
            np.sum(normal * (a[1:-1] - 0.5 * (a[:-2] + a[2:])), axis=1)[row] for a in (cloud.points, moved)
        ))  # fmt: skip
    owner = np.repeat(np.arange(len(parts)), [len(residual) for residual, _ in parts])
    residual, slope = (np.concatenate(column) for column in zip(*parts, strict=True))
    if len(residual) < LEAST_RETURNS:
        return None
    # Least absolute values; far, grazing walls, which motion moves most and whose normals are worst, do not rule.
    weight = 1.0 / np.maximum(np.abs(residual), LEAST_RESIDUAL)
    weight /= 1.0 + np.square(slope / max(LEVERAGE * float(np.median(np.abs(slope))), TINY))
    curvature, gradient = (np.bincount(owner, weight * slope * other, len(parts)) for other in (slope, residual))
    misfit = float(np.mean(np.minimum(np.abs(residual), RADIUS)))
    return _Slope(curvature.astype(np.float64), gradient.astype(np.float64), misfit)


def _near_pairs(poses: Array, velocities: Array, usable: Index) -> tuple[Index, Array]:
    """Pairs ``(P, 2)`` of scans of one place, and how differently the robot moved during the two, metres a second."""
    from scipy.spatial import cKDTree  # slow to import

    usable = usable[:: max(-(-len(usable) // MOST_PLACED), 1)]
    near = cKDTree(poses[usable, :2]).query_pairs(NEAR, output_type="ndarray") if len(usable) else np.zeros((0, 2))
    pairs = np.sort(usable[near.astype(np.int64)].reshape(-1, 2), axis=1)
    turn = se2.between(poses[pairs[:, 0]], poses[pairs[:, 1]])[:, 2]
    pairs, turn = pairs[np.abs(turn) <= TURNED], turn[np.abs(turn) <= TURNED]
    first, second = velocities[pairs[:, 0]], velocities[pairs[:, 1]]
    c, s = np.cos(turn), np.sin(turn)
    along = c * second[:, 0] - s * second[:, 1] - first[:, 0]
    across = s * second[:, 0] + c * second[:, 1] - first[:, 1]
    return pairs, np.hypot(np.hypot(along, across), LEVER * (second[:, 2] - first[:, 2]))


def _telling(pairs: Index, differs: Array, most: int, most_different: float) -> Index:
    """Rows of the pairs that differ most, though not more than so much, in the order of time."""
    order = np.argsort(-differs, kind="stable")
    order = order[(differs[order] >= LEAST_SPEED) & (differs[order] <= most_different)][: 20 * most]
    used: dict[int, int] = {}
    chosen = []
    for row in order.tolist():
        a, b = int(pairs[row, 0]), int(pairs[row, 1])
        if max(used.get(a, 0), used.get(b, 0)) < PAIRS_A_SCAN:
            used[a], used[b] = used.get(a, 0) + 1, used.get(b, 0) + 1
            chosen.append(row)
            if len(chosen) == most:
                break
    return np.sort(np.array(chosen, dtype=np.int64))


def _sweep(
    scans: Sequence[LaserScan], poses: Array, velocities: Array, pairs: Index, found: BeamTimes,
    cleaning: CleaningOptions,
) -> BeamTimes:
    """By how far returns of pairs of scans lie apart at the relative pose that suits them best.

    Of infinite deviation where too few pairs lie on each other, or the steps do not settle.
    """
    T, search = se2.between(poses[pairs[:, 0]], poses[pairs[:, 1]]), _Search()
    nothing = replace(found, sweep=0.0, sweep_deviation=float("inf"))
    sums, T = _bent(scans, velocities, pairs, T, nothing, cleaning)
    without = sums
    for k in range(ROUNDS):
        if k or found.sweep != 0.0:
            sums, T = _bent(scans, velocities, pairs, T, found, cleaning)
        if len(sums.curvature) < LEAST_PAIRS:
            return nothing
        sweep = found.sweep + search.step(sums)
        found = replace(found, sweep=sweep, sweep_deviation=sums.deviation())
        if search.settled:
            break
    else:
        return nothing
    return found if sums.misfit <= BETTER * without.misfit else replace(found, sweep=0.0)


def _bent(
    scans: Sequence[LaserScan], velocities: Array, pairs: Index, T_first_second: Array, found: BeamTimes,
    cleaning: CleaningOptions,
) -> tuple[_Slope, Array]:
    """Sums of each pair of scans of how far their returns lie apart, and all relative poses ``(P, 3)``."""
    clouds, flows = [], []
    for scan, velocity in zip(scans, velocities, strict=True):
        cloud, beams = extract_returns(deskew(found.of(scan), velocity), cleaning)
        clouds.append(cloud)
        flows.append(_flow(cloud, velocity) * sweep_of(len(scan.ranges))[beams][:, None])
    return _pair_sums(clouds, np.concatenate(flows), pairs, T_first_second)


def _pair_sums(clouds: list[ScanPoints], flow: Array, pairs: Index, T_start: Array) -> tuple[_Slope, Array]:
    """Sums of each pair that overlaps, its relative pose eliminated; and all relative poses ``(P, 3)``."""
    from scipy.spatial import cKDTree

    batch = join([index_cloud(cloud) for cloud in clouds])
    cloud, offsets = batch.cloud, batch.offsets
    if len(cloud) < LEAST_RETURNS:
        return _Slope(np.zeros(0), np.zeros(0), RADIUS), T_start
    fine = align(batch, batch.as_sources(), pairs.astype(np.int32), T_start, options=ALIGNMENT)
    T = fine.T_target_source
    # All returns of the second scan of each pair, and the nearest of the first within the radius.
    first, second = pairs.T
    counts = np.diff(offsets)
    pair = np.repeat(np.arange(len(pairs)), counts[second])
    begins = np.cumsum(counts[second]) - counts[second]
    source = np.arange(len(pair)) - begins[pair] + offsets[second][pair]
    c, s = np.cos(T[pair, 2]), np.sin(T[pair, 2])
    x, y = cloud.points[source].T
    placed = np.stack([c * x - s * y + T[pair, 0], s * x + c * y + T[pair, 1]], axis=1)
    apart = 2.0 * RADIUS  # clouds lie on planes above each other, so that one tree serves all
    tree = cKDTree(np.column_stack([cloud.points, apart * np.repeat(np.arange(len(clouds)), counts)]))
    distance, target = tree.query(np.column_stack([placed, apart * first[pair]]), distance_upper_bound=RADIUS)
    target = np.where(np.isfinite(distance), target, 0)
    normal = cloud.normals[target]
    # The target's normal seen from the second scan.
    turned = np.stack([c * normal[:, 0] + s * normal[:, 1], c * normal[:, 1] - s * normal[:, 0]], axis=1)
    good = np.isfinite(distance) & (np.sum(turned * cloud.normals[source], axis=1) >= FACING)
    good &= (cloud.along[source] == 0.0) & (cloud.along[target] == 0.0) & (fine.overlap[pair] >= OVERLAP)
    pair, source, target, x, y = pair[good], source[good], target[good], x[good], y[good]
    normal, turned = normal[good], turned[good]
    residual = np.sum(normal * (placed[good] - cloud.points[target]), axis=1)
    slope = np.sum(turned * flow[source], axis=1) - np.sum(normal * flow[target], axis=1)
    rows = np.column_stack([turned, x * turned[:, 1] - y * turned[:, 0], slope, residual])
    weight = cloud.weights[source] * _weights(residual)
    begins = np.flatnonzero(np.diff(pair, prepend=-1))
    if not len(begins):
        return _Slope(np.zeros(0), np.zeros(0), RADIUS), T
    products = (weight[:, None, None] * rows[:, :, None] * rows[:, None, :]).reshape(-1, 25)
    sums = np.add.reduceat(products, begins, axis=0).reshape(-1, 5, 5)
    # The pose is whatever suits each pair best (Schur complement); a corridor leaves a direction of it open.
    pose = sums[:, :3, :3] + 1e-6 * np.trace(sums[:, :3, :3], axis1=1, axis2=2)[:, None, None] * np.eye(3)
    left = sums[:, 3:, 3:] - sums[:, 3:, :3] @ np.linalg.solve(pose + TINY * np.eye(3), sums[:, :3, 3:])
    return _Slope(left[:, 0, 0], left[:, 0, 1], float(np.mean(np.abs(residual)))), T
