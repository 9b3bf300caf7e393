"""Do independent closures agree with each other?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place.closure import Closure

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ConsistencyOptions:
    """How well two closures must agree (pairwise consistency, Mangelson et al., ICRA 2018).

    Attributes:
        translation, rotation: tolerance of the loop through both, metres and radians,
        per_metre: and what the path between them adds to it, metres a metre.
        rotation_per_metre: likewise, radians a metre.
        sigmas: deviations of the path that are added besides, where its covariance is known.
    """

    translation: float = 0.15
    rotation: float = 0.04
    per_metre: float = 0.02
    rotation_per_metre: float = 0.005
    sigmas: float = 2.0


def agree(
    a: Closure, b: Closure, T_source: Array, T_target: Array, path: float, options: ConsistencyOptions,
    covariance: Array | None = None,
) -> bool:
    """Whether the loop through two closures returns to where it began.

    Args:
        a, b: closures ``T_target_source``.
        T_source: ``(3,)`` pose of b's source seen from a's source.
        T_target: ``(3,)`` pose of b's target seen from a's target.
        path: metres driven between the two sources and between the two targets.
        options: see `ConsistencyOptions`.
        covariance: ``(3, 3)`` of that way, in the axes of b's source: along a bare corridor, where only odometry tells
            how far the robot has come, two right closures agree no better than that.
    """
    around = se2.between(
        se2.compose(a.T_target_source, T_source), se2.compose(T_target, b.T_target_source)
    )
    tolerance = np.array([options.translation + options.per_metre * path] * 2
                         + [options.rotation + options.rotation_per_metre * path])
    allowed = np.diag(tolerance**2)
    if covariance is not None:
        allowed += options.sigmas**2 * covariance
    shift, turn = around[:2], around[2]
    return bool(shift @ np.linalg.solve(allowed[:2, :2], shift) < 1.0 and turn**2 < allowed[2, 2])
