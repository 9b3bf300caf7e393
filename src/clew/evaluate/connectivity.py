"""Where a graph hangs by a thread: edges that nothing else confirms, and the weakest cut of a path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.graph import FactorGraph

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

_SEED = 20


@dataclass(frozen=True, eq=False)
class PathCuts:
    """What ties the poses before each step of a path to those after it.

    Attributes:
        edges: ``(N - 1,)`` edges, and landmarks seen on both sides, that reach over the step from pose ``k`` to
            pose ``k + 1``.
        information: ``(N - 1,)`` their summed information about one coordinate of the position, 1 / m^2 (the mean of
            the axes; lever arms are left out, so that it compares the steps of a path and measures nothing else).
    """

    edges: Index
    information: Array


def bridges(count: int, pairs: Index) -> Flags:
    """Edges without which the graph would fall apart: no other way confirms what they measured.

    An edge of a spanning tree is a bridge unless another edge crosses the cut that it makes. Each other edge puts a
    random number on one end and takes it from the other; below the cut all that do not cross it cancel, so that the
    sum there is zero (mod 2^64) just where none crosses, but for chance of 2^-64.

    Args:
        count: number of nodes.
        pairs: ``(E, 2)`` nodes that each edge ties; loops and parallel edges may occur.

    Returns:
        ``(E,)``.
    """
    flags = np.zeros(len(pairs), dtype=np.bool_)
    low, high = pairs.min(axis=1, initial=count), pairs.max(axis=1, initial=-1)
    _, first, parallel = np.unique(low * max(count, 1) + high, return_index=True, return_counts=True)
    single = low[first] != high[first]
    first, parallel = first[single], parallel[single]
    if not len(first):
        return flags
    ends = np.stack([low[first], high[first]])
    parent_edge = np.full(count, -1, np.int64)
    parent = np.full(count, -1, np.int64)
    order, before, edge, _, _ = _native.solve.spanning_forest(count, ends[0], ends[1], np.empty(0, np.int64))
    parent[order], parent_edge[order] = before, edge
    child = np.flatnonzero(parent >= 0)

    others = np.ones(len(first), dtype=np.bool_)
    others[parent_edge[child]] = False
    numbers = np.random.default_rng(_SEED).integers(1, 2**63, int(others.sum()), dtype=np.int64).view(np.uint64)
    sums = np.zeros(count, dtype=np.uint64)
    np.add.at(sums, ends[0, others], numbers)
    np.subtract.at(sums, ends[1, others], numbers)
    below, above = sums.tolist(), parent.tolist()
    for node in reversed(order.tolist()):  # each node after all nodes below it
        if above[node] >= 0:
            below[above[node]] = (below[above[node]] + below[node]) % 2**64
    alone = child[np.array(below, dtype=np.uint64)[child] == 0]
    edges = parent_edge[alone]
    flags[first[edges[parallel[edges] == 1]]] = True
    return flags


def path_cuts(graph: FactorGraph, keys: Index) -> PathCuts:
    """How firmly each step of a path is held: by itself, and by what reaches over it.

    A landmark that is seen on both sides of a step counts as one edge over it, with the information of the sightings
    before and after in series.

    Args:
        graph: with factors between pairs of poses, or of poses and landmarks.
        keys: ``(N,)`` keys of the poses of a path, in the order of driving.
    """
    steps = max(len(keys) - 1, 0)
    edges, information = np.zeros(steps + 1, np.int64), np.zeros(steps + 1)
    if not steps:
        return PathCuts(edges[:0], information[:0])
    order = np.argsort(keys)
    ordered = keys[order]
    sightings = []
    for block in graph.blocks():
        if len(block.kinds) != 2:
            continue
        place = np.minimum(np.searchsorted(ordered, block.keys), steps)
        known = ordered[place] == block.keys
        space = min(block.kinds[0].space, block.residual_dim)
        share = np.trace(block.information[:, :space, :space], axis1=1, axis2=2) / space
        both = known.all(axis=1)
        start, end = np.sort(order[place[both]], axis=1).T
        _reach(edges, information, start, end, share[both])
        if block.kinds[0] is not block.kinds[1] and known[:, 0].any():
            seen = known[:, 0]
            sightings.append((block.keys[seen, 1], order[place[seen, 0]], share[seen]))
    if sightings:
        landmark, pose, share = (np.concatenate(column) for column in zip(*sightings, strict=True))
        by_landmark = np.lexsort((pose, landmark))
        landmark, pose, share = landmark[by_landmark], pose[by_landmark], share[by_landmark]
        last = np.append(landmark[1:] != landmark[:-1], True)
        group = np.cumsum(last) - last
        total = np.bincount(group, share)
        before = np.cumsum(share)
        before -= np.concatenate([[0.0], before[last]])[group]
        series = before * (total[group] - before) / np.maximum(total[group], 1e-300)
        on = np.flatnonzero(~last)
        _reach(edges, information, pose[on], pose[on + 1], series[on])
    return PathCuts(np.cumsum(edges)[:steps], np.maximum(np.cumsum(information)[:steps], 0.0))


def _reach(edges: Index, information: Array, start: Index, end: Index, share: Array) -> None:
    """Add edges over the steps from `start` to `end` to the differences of the sums along a path."""
    for ends, sign in ((start, 1), (end, -1)):
        np.add.at(edges, ends, sign)
        np.add.at(information, ends, sign * share)


def stretches(flags: Flags) -> Index:
    """First and last index ``(S, 2)`` of each run of True in a row of flags."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return np.stack([np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1], axis=1)
