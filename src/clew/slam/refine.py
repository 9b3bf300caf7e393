"""Joint refinement: all keyframes against all that they overlap with, until nothing moves.

The planar form of bundle adjustment for laser scans. Each pair of overlapping keyframes is aligned point to line; since
the residuals of a pair depend on its relative pose alone, the pair enters the graph as that pose with the information
of its returns. Solving the graph and aligning again from the new poses is repeated. How much the pairs contradict each
other tells what they are worth (`clew.slam.pair_noise`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.factors import Between
from clew.geometry import SE2, se2
from clew.graph import FactorGraph, Role
from clew.noise import Cauchy
from clew.scan import IndexedClouds, ScanPoints, align, index_cloud, join, without_normal_noise
from clew.slam.config import SlamConfig
from clew.slam.pair_noise import pair_variance, returns_once, with_variance
from clew.slam.pose_graph import LEAST_INFORMATION
from clew.slam.sensor import SensorModel
from clew.solve import optimize

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RADII = ((0.3, 0.15), (0.2, 0.1), (0.1, 0.08))  # metres; the search for partners narrows from round to round
WEAK_PRIOR = np.diag([1 / 0.05**2, 1 / 0.05**2, 1 / 0.02**2])  # keeps a pair in place where its returns say nothing
RECENT = 10  # keyframes on the same stretch of path
KERNEL = 3.0
#: Radians; normals at jambs and corners are off by so much, and alike in all scans that see them. Along a corridor they
#: are what a pair of single scans has to go by, and what it makes of them does not average out over many pairs.
BENT_ENDS = 0.25
LEVER = 5.0  # metres; a turn of a radian counts as so much
PAIRS_AT_ONCE = 2000  # whose returns are laid out together: memory of the alignment does not grow with the map


@dataclass(frozen=True)
class _Pairs:
    """Pairs of keyframes aligned with each other.

    Attributes:
        rows: ``(P, 2)`` of the keyframes.
        T: ``(P, 3)`` pose of the second seen from the first.
        information: ``(P, 3, 3)`` of the returns of each pair by itself.
    """

    rows: NDArray[np.int32]
    T: Array
    information: Array

    def factor(self, numbers: Index, variance: float, share: Array) -> Between:
        """Edges of the graph, keys being numbers of keyframes; `share` ``(P,)`` of them counts as their own."""
        keys = numbers[self.rows]
        information = share[:, None, None] * with_variance(self.information, variance) + LEAST_INFORMATION
        return Between(
            keys[:, 0], keys[:, 1], SE2.from_array(self.T),
            information=information, role=Role.LOOP, kernel=Cauchy(KERNEL),
        )  # fmt: skip

    def errors(self, poses: Array) -> Array:
        """Residuals ``(P, 3)`` at poses ``(K, 3)``."""
        return se2.between(self.T, se2.between(poses[self.rows[:, 0]], poses[self.rows[:, 1]]))


def overlapping_pairs(poses: Array, radius: float, neighbours: int, numbers: Index | None = None) -> NDArray[np.int32]:
    """Pairs ``(P, 2)`` of keyframes near each other, the older first: those next in time, and the nearest others.

    A third of the neighbours may come from the same stretch of path, so that the rest ties different visits together.

    Args:
        poses: ``(K, 3)``, in the order of time.
        radius: how near, metres.
        neighbours: at most so many a keyframe.
        numbers: ``(K,)`` in the order in which they were taken, with gaps where others have been left out since.
    """
    count = len(poses)
    tree = cKDTree(poses[:, :2])
    pairs = tree.query_pairs(radius, output_type="ndarray")
    if not len(pairs):
        return np.zeros((0, 2), dtype=np.int32)
    distance = np.hypot(*(poses[pairs[:, 0], :2] - poses[pairs[:, 1], :2]).T)
    taken = np.arange(count) if numbers is None else numbers
    recent = np.abs(taken[pairs[:, 1]] - taken[pairs[:, 0]]) <= RECENT
    kept = np.zeros(len(pairs), dtype=np.bool_)
    for chosen, limit in ((recent, neighbours // 3), (~recent, neighbours - neighbours // 3)):
        rows = np.flatnonzero(chosen)
        for side in (0, 1):
            owner = pairs[rows, side]
            order = np.lexsort((distance[rows], owner))
            first = np.searchsorted(owner[order], np.arange(count))
            rank = np.arange(len(order)) - first[owner[order]]
            kept[rows[order[rank < (limit + 1) // 2]]] = True
    return np.asarray(pairs[kept], dtype=np.int32)


def refine(
    clouds: Sequence[ScanPoints],
    numbers: Index,
    graph: FactorGraph,
    config: SlamConfig,
    sensor: SensorModel,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> FactorGraph:
    """The graph with scan-to-scan edges added, at its optimum.

    The edges that it has stay: odometry and closures know what single scans do not, along a bare corridor above all.

    Args:
        clouds: returns of ``K`` keyframes, each in its robot's frame.
        numbers: ``(K,)`` their numbers, rising.
        graph: odometry and closures; keys are the numbers of the keyframes, values are where to begin. Left as it is.
        config: `SlamConfig.refinement` and `threads` are used.
        sensor: how returns are weighted.
        progress: called after each round with the rounds done and the most there can be.
        stop: asked after each round whether to leave it at that.
    """
    options = config.refinement
    indexed = [index_cloud(cloud) for cloud in clouds]
    moments = np.concatenate([cloud.as_sources().moments() for cloud in indexed])
    graph = graph.copy()
    poses = np.asarray(graph.values(numbers).array)
    steps, placed = _steps(graph)
    variance = 1.0
    for round_ in range(options.rounds):
        aligned = _align_pairs(indexed, moments, numbers, poses, round_, config, sensor)
        graph.remove(placed)
        weighed = steps
        if aligned is not None:
            rows = [np.searchsorted(numbers, step.keys) for step in steps]
            shares = np.split(
                returns_once(np.concatenate([*rows, aligned.rows]), len(numbers)), np.cumsum([len(r) for r in rows])
            )
            weighed = [_weighed(step, share) for step, share in zip(steps, shares[:-1], strict=True)]
            weighed.append(aligned.factor(numbers, variance, shares[-1]))
        placed = np.concatenate([np.atleast_1d(np.asarray(graph.add(factor))) for factor in weighed])
        optimize(graph, init="file", update=True)
        moved_to = np.asarray(graph.values(numbers).array)
        if aligned is not None:
            in_pairs = len(np.unique(aligned.rows))
            variance = pair_variance(aligned.errors(moved_to), aligned.information, in_pairs)
        movement = float(np.max(np.hypot(*(moved_to - poses)[:, :2].T)))
        poses = moved_to
        if progress is not None:
            progress(round_ + 1, options.rounds)
        if (movement < options.movement and round_ + 1 >= len(RADII)) or (stop is not None and stop()):
            break
    return graph


def _steps(graph: FactorGraph) -> tuple[list[Between], NDArray[np.int64]]:
    """The edges that the front end made, and what was left of them when keyframes were pruned, with their ids.

    They rest on returns as the pairs do, of scans that the pairs count too.
    """
    steps, ids = [], [np.zeros(0, dtype=np.int64)]
    for role in (Role.ODOMETRY, Role.MARGINAL):
        for block, numbers in zip(graph.blocks(role), graph.block_ids(role), strict=True):
            if isinstance(block, Between):
                steps.append(block)
                ids.append(np.asarray(numbers))
    return steps, np.concatenate(ids)


def _weighed(step: Between, share: Array) -> Between:
    """A step with so much ``(M,)`` of its returns as counts as its own; what it is worth it knows."""
    return Between(
        step.keys[:, 0], step.keys[:, 1], SE2.from_array(step.measurement),
        information=with_variance(step.information, 1.0 / share), role=step.role, kernel=step.kernel,
    )  # fmt: skip


def _align_pairs(
    clouds: list[IndexedClouds], moments: Array, numbers: Index, poses: Array, round_: int, config: SlamConfig,
    sensor: SensorModel,
) -> _Pairs | None:
    """All overlapping pairs, aligned from the present poses."""
    options = config.refinement
    pairs = overlapping_pairs(poses, options.radius, options.neighbours, numbers)
    if not len(pairs):
        return None
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    parts = [
        _align_part(clouds, pairs[begin : begin + PAIRS_AT_ONCE], poses, round_, config, sensor)
        for begin in range(0, len(pairs), PAIRS_AT_ONCE)
    ]
    T, overlap, returns = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    good = overlap >= options.overlap
    if not good.any():
        return None
    of_returns = without_normal_noise(returns[good], sensor.normal_variance + BENT_ENDS**2, moments[pairs[good, 1]])
    worth = sensor.return_information(options.information_scale)
    return _Pairs(pairs[good], T[good], worth * of_returns)


def _align_part(
    clouds: list[IndexedClouds], pairs: NDArray[np.int32], poses: Array, round_: int, config: SlamConfig,
    sensor: SensorModel,
) -> tuple[Array, Array, Array]:
    """Relative poses ``(P, 3)``, overlaps ``(P,)`` and informations of the returns ``(P, 3, 3)``."""
    start, end = RADII[min(round_, len(RADII) - 1)]
    rows, local = np.unique(pairs, return_inverse=True)
    batch = join([clouds[row] for row in rows])
    fine = align(
        batch, batch.as_sources(), np.asarray(local.reshape(-1, 2), dtype=np.int32),
        se2.between(poses[pairs[:, 0]], poses[pairs[:, 1]]),
        prior_information=np.broadcast_to(WEAK_PRIOR, (len(pairs), 3, 3)),
        options=replace(sensor.alignment, radius_start=start, radius_end=end, correlated=0.0), threads=config.threads,
    )  # fmt: skip
    # The pose of the returns alone, not the one that the prior holds back: it would confirm where the pair is now.
    size = np.hypot(np.hypot(fine.step[:, 0], fine.step[:, 1]), LEVER * fine.step[:, 2])
    step = fine.step * np.minimum(1.0, end / np.maximum(size, 1e-12))[:, None]
    return se2.retract(fine.T_target_source, step), fine.overlap, fine.information
