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
    """

    translation: float = 0.15
    rotation: float = 0.04
    per_metre: float = 0.02
    rotation_per_metre: float = 0.005


def agree(a: Closure, b: Closure, T_source: Array, T_target: Array, path: float, options: ConsistencyOptions) -> bool:
    """Whether the loop through two closures returns to where it began.

    Args:
        a, b: closures ``T_target_source``.
        T_source: ``(3,)`` pose of b's source seen from a's source.
        T_target: ``(3,)`` pose of b's target seen from a's target.
        path: metres driven between the two sources and between the two targets.
    """
    around = se2.between(
        se2.compose(a.T_target_source, T_source), se2.compose(T_target, b.T_target_source)
    )
    distance = options.translation + options.per_metre * path
    angle = options.rotation + options.rotation_per_metre * path
    return bool(np.hypot(around[0], around[1]) < distance and abs(around[2]) < angle)
