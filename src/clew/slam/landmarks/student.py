"""What sightings tell whose errors follow Student's t distribution.

Such an error is a Gaussian one whose variance is drawn anew each time; the robust weight is the expected inverse of
that. Information by those weights is what there would be if the variances were known. They are not: what an error
tells of its place is in the mean less by ``(n + 1) / (n + 3)`` (Lange, Little, Taylor 1989, "Robust statistical
modeling using the t distribution"), with `TAIL` = n degrees of freedom by 1.4. For Gaussian errors the same number is
right within a few per cent: that distribution is fitted to them with a scale of 0.83 deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from clew.factors import CalibratedBearing, CalibratedRange
from clew.slam.landmarks.graph import RobotFactors
from clew.slam.landmarks.linearised import Linearised
from clew.slam.landmarks.track import TAIL
from clew.solve import Solution, recounted

Array = NDArray[np.float64]
_Pair = tuple[CalibratedRange, CalibratedBearing]
_Sighting = TypeVar("_Sighting", CalibratedRange, CalibratedBearing)

#: Share of what the robust weights say.
TOLD = (TAIL + 1.0) / (TAIL + 3.0)

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(9)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


def as_told(solution: Solution, factors: Sequence[RobotFactors]) -> tuple[Solution, list[RobotFactors]]:
    """The solution with the Gaussian around it in which sightings count as much as they tell, and factors that do.

    A residual at the solution is smaller than the error was, the more so the more the solution was fitted to it; so its
    weight is the mean over what is open of the error, first as the robust weights leave it, then as these do.
    """
    for _ in range(2):
        told = [
            replace(own, sightings=_pair(solution, own.sightings), mates=own.mates and _pair(solution, own.mates))
            for own in factors
        ]
        solution = recounted(solution, [one for own in told for one in (*own.sightings, *(own.mates or ()))])
    return solution, told


def mean_over_open(at: Linearised, error_to: Callable[[Array], Array]) -> Array:
    """Mean ``(M,)`` of a function of a sighting's error over what the solution leaves open of it."""
    spread = np.sqrt(np.maximum(at.covariance()[:, 0, 0], 0.0))
    mean: Array = error_to(at.error + spread[:, None] * _NODES) @ _WEIGHTS
    return mean


def _pair(solution: Solution, pair: _Pair) -> _Pair:
    return _told(solution, pair[0]), _told(solution, pair[1])


def _told(solution: Solution, factor: _Sighting) -> _Sighting:
    kernel, information = factor.kernel, factor.information
    assert kernel is not None
    weight = mean_over_open(Linearised(solution, factor), lambda e: kernel.weight(e**2 * information[:, :, 0]))
    twin = copy(factor)
    twin.information, twin.kernel = TOLD * weight[:, None, None] * information, None
    return twin
