"""How uncertain the way of the robot leaves closures, each alone and against each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place import Closure
from clew.slam.config import ClosingOptions
from clew.slam.keyframes import KeyframeStore

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def deformation(keyframes: KeyframeStore, closure: Closure, options: ClosingOptions) -> Array:
    """Covariance ``(3, 3)`` that a closure owes to query and submap being bent, in the tangent of its pose.

    Along a bare corridor only odometry tells how far apart the keyframes of a submap are, so that surfaces at one
    end of it are uncertain by that against those at the other; where little is seen, so are their directions. Half of
    the query's and of the submap's way counts; of the translation what is equal in all directions does not, since the
    match itself knows it. Odometry is trusted no more than in the prediction (`ClosingOptions.caution`).
    """
    half = options.submap_keyframes // 2
    back = float(closure.T_target_source[2])
    total = way_covariance(keyframes, closure.source, closure.source - half, closure.source, 0.0)
    total += way_covariance(keyframes, closure.target, closure.target, closure.target + half, -back)
    total[:2, :2] -= np.linalg.eigvalsh(total[:2, :2])[0] * np.eye(2)
    return options.caution * total


def way_covariance(keyframes: KeyframeStore, seen_from: int, first: int, last: int, turn: float) -> Array:
    """Covariance ``(3, 3)`` of the steps from one keyframe to another, summed up, in the axes of a third.

    Positions and headings apart: over a short way the one hardly depends on the other.

    Args:
        keyframes: of the run.
        seen_from: keyframe whose axes these are,
        first, last: beginning and end of the way.
        turn: radians by which the axes are turned besides.
    """
    way = np.arange(max(first, 0) + 1, last + 1)
    heading = keyframes.relative(seen_from, way)[:, 2] + turn
    turned = se2.matrix(np.stack([0.0 * heading, 0.0 * heading, heading], axis=1))[:, :2, :2]
    steps = keyframes.step_covariances(way)
    total = np.zeros((3, 3))
    total[:2, :2] = (turned @ steps[:, :2, :2] @ turned.transpose(0, 2, 1)).sum(axis=0)
    total[2, 2] = steps[:, 2, 2].sum()
    return total
