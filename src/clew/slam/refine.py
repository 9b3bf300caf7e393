"""Joint refinement: all keyframes against all that they overlap with, until nothing moves.

The planar form of bundle adjustment for laser scans. Each pair of overlapping keyframes is aligned point to line; since
the residuals of a pair depend on its relative pose alone, the pair enters the graph as that pose with the information
of its returns. Solving the graph and aligning again from the new poses is repeated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.factors import Between
from clew.geometry import SE2, se2
from clew.graph import FactorGraph, Role
from clew.noise import Cauchy
from clew.scan import IndexedClouds, align, index_cloud, join, without_normal_noise
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
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
PAIRS_AT_ONCE = 2000  # whose returns are laid out together: memory of the alignment does not grow with the map


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
    keyframes: KeyframeStore,
    graph: FactorGraph,
    config: SlamConfig,
    sensor: SensorModel,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> FactorGraph:
    """The graph with scan-to-scan edges added, at its optimum.

    The edges that it has stay: odometry and closures know what single scans do not, along a bare corridor above all.

    Args:
        keyframes: all keyframes that have not been dropped.
        graph: odometry and closures; keys are the numbers of the keyframes, values are where to begin. Left as it is.
        config: `SlamConfig.refinement` and `threads` are used.
        sensor: how returns are weighted.
        progress: called with the rounds done, beginning with 0, and the most there can be.
        stop: asked after each round whether to leave it at that.
    """
    options = config.refinement
    if progress is not None:
        progress(0, options.rounds)
    numbers = keyframes.alive
    clouds = [index_cloud(cloud) for cloud in keyframes.clouds(numbers)]
    graph = graph.copy()
    poses = np.asarray(graph.values(numbers).array)
    added: NDArray[np.int64] | None = None
    for round_ in range(options.rounds):
        factor = _pair_factor(clouds, numbers, poses, round_, config, sensor)
        if added is not None:
            graph.remove(added)
        added = None if factor is None else np.atleast_1d(np.asarray(graph.add(factor)))
        optimize(graph, init="file", update=True)
        moved_to = np.asarray(graph.values(numbers).array)
        movement = float(np.max(np.hypot(*(moved_to - poses)[:, :2].T)))
        poses = moved_to
        if progress is not None:
            progress(round_ + 1, options.rounds)
        if (movement < options.movement and round_ + 1 >= len(RADII)) or (stop is not None and stop()):
            break
    return graph


def _pair_factor(
    clouds: list[IndexedClouds], numbers: Index, poses: Array, round_: int, config: SlamConfig, sensor: SensorModel
) -> Between | None:
    """Scan-to-scan edges of all overlapping pairs, aligned from the present poses."""
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
    pairs, keys = pairs[good], numbers[pairs[good]]
    worth = sensor.return_information(options.information_scale) * returns_once(pairs, len(numbers))
    of_returns = without_normal_noise(returns[good], sensor.normal_variance + BENT_ENDS**2)
    information = worth[:, None, None] * of_returns + LEAST_INFORMATION
    return Between(
        keys[:, 0], keys[:, 1], SE2.from_array(T[good]),
        information=information, role=Role.LOOP, kernel=Cauchy(KERNEL),
    )  # fmt: skip


def returns_once(pairs: NDArray[np.int32], count: int) -> Array:
    """Share ``(P,)`` of their returns that pairs ``(P, 2)`` of `count` keyframes may count as their own.

    The noise of a scan is in all the pairs that it takes part in, so that their information does not add up: each
    of ``n`` pairs has an ``n``-th of it, or what lies between the shares of its two scans.
    """
    times = np.bincount(pairs.reshape(-1), minlength=count)[pairs]
    return np.asarray(1.0 / np.sqrt(times[:, 0] * times[:, 1]), dtype=np.float64)


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
        options=replace(sensor.alignment, radius_start=start, radius_end=end), threads=config.threads,
    )  # fmt: skip
    return fine.T_target_source, fine.overlap, fine.information
