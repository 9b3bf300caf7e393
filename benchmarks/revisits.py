"""Where a robot sees known places again, by the true poses of its keyframes, and which closures are right there.

A *revisit* is a keyframe within 2 m of one passed 15 m of way ago or more, of whose returns at least 60 % lie within
0.3 m of returns taken about that older one. Revisits that follow each other are cut into stretches of 5 m (shorter than
1.5 m do not count); *recall* is the share of stretches in which a right closure begins.

A closure is *right* if its relative pose is within 0.15 m and 2 degrees of the truth, or if it misses by more only in
directions of which it says itself that it does not know them: its error lies within the 99.9 % ellipsoid of its own
covariance, the one that the graph uses ("partial").
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from clew.geometry import se2
from clew.place import Closure

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]

RIGHT_DISTANCE, RIGHT_ANGLE = 0.15, np.radians(2.0)
ELLIPSOID = 16.27  # 99.9 % of a chi-square variable with three degrees of freedom
NEAR, AGO = 2.0, 15.0  # metres
ABOUT = 8  # keyframes before and after
TOUCH, OVERLAP = 0.3, 0.6  # metres, share
STRETCH, SHORTEST = 5.0, 1.5  # metres
BESIDE = 1.0  # metres of path from a stretch to the closure that counts for it


def judge(closures: list[Closure], truth: Array) -> tuple[Mask, Mask, list[str]]:
    """Which closures are right, which of these only where they claim to know, and words on the others.

    Args:
        closures: between keyframes.
        truth: ``(K, 3)`` true poses of the keyframes.
    """
    if not closures:
        return np.zeros(0, np.bool_), np.zeros(0, np.bool_), []
    source, target = (np.array([getattr(c, end) for c in closures]) for end in ("source", "target"))
    error = se2.between(se2.between(truth[target], truth[source]), np.stack([c.T_target_source for c in closures]))
    squared = np.einsum("mi,mij,mj->m", error, np.stack([c.information for c in closures]), error)
    near = (np.hypot(error[:, 0], error[:, 1]) <= RIGHT_DISTANCE) & (np.abs(error[:, 2]) <= RIGHT_ANGLE)
    right = near | (squared <= ELLIPSOID)
    wrong = [f"{source[i]}->{target[i]} off {error[i, 0]:+.2f} {error[i, 1]:+.2f} m {np.degrees(error[i, 2]):+.1f} deg "
             f"(chi2 {squared[i]:.0f}, moved {closures[i].innovation[0]:.2f} m)" for i in np.flatnonzero(~right)]
    return right, right & ~near, wrong


def revisits(cloud_of: Callable[[int], Array], truth: Array, path: Array) -> tuple[Indices, Indices]:
    """Keyframes that see an older place again, and the keyframe nearest to them there.

    Args:
        cloud_of: returns ``(n, 2)`` of a keyframe, in its frame.
        truth: ``(K, 3)`` true poses.
        path: ``(K,)`` metres driven until each.
    """
    clouds: dict[int, Array] = {}
    trees: dict[int, cKDTree] = {}

    def cloud(k: int) -> Array:
        if k not in clouds:
            clouds[k] = cloud_of(k)
        return clouds[k]

    def tree(k: int) -> cKDTree:
        if k not in trees:
            about = range(max(0, k - ABOUT), min(len(truth), k + ABOUT + 1))
            trees[k] = cKDTree(np.concatenate([se2.act(truth[m], cloud(m)) for m in about]))
        return trees[k]

    again, before = [], []
    for k in range(len(truth)):
        older = int(np.searchsorted(path, path[k] - AGO, side="right"))
        distance = np.hypot(*(truth[:older, :2] - truth[k, :2]).T)
        if not len(distance) or distance.min() > NEAR or not len(cloud(k)):
            continue
        nearest = int(np.argmin(distance))
        gap, _ = tree(nearest).query(se2.act(truth[k], cloud(k)), distance_upper_bound=TOUCH)
        if np.isfinite(gap).mean() >= OVERLAP:
            again.append(k)
            before.append(nearest)
    return np.array(again, dtype=np.int64), np.array(before, dtype=np.int64)


def recall(path: Array, again: Indices, begins: Array) -> tuple[int, list[tuple[float, float]]]:
    """How many stretches of revisits there are, and those in which no closure begins at paths ``(C,)``."""
    stretches = list(_stretches(path, again))
    return len(stretches), [(a, b) for a, b in stretches
                            if not ((begins >= a - BESIDE) & (begins <= b + BESIDE)).any()]


def _stretches(path: Array, again: Indices) -> Iterator[tuple[float, float]]:
    """Begin and end, in metres of path, of stretches on which a robot sees known places."""
    for part in np.split(again, np.flatnonzero(np.diff(again) > 3) + 1):
        if not len(part):
            continue
        begin, end = float(path[part[0]]), float(path[part[-1]])
        if end - begin < SHORTEST:
            continue
        count = max(round((end - begin) / STRETCH), 1)
        yield from itertools.pairwise(np.linspace(begin, end, count + 1).tolist())
