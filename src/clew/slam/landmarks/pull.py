"""What draws a calibration beside the cost at the solution.

Likelihood integrates over where robot and landmarks may have been; the solution only has the likeliest places. By
Laplace's method the difference is half the logarithm of the determinant of the places' information: calibrations that
let measurements say more about places are not therefore likelier. The more a measurement is stretched, the more it
says; so the derivative of the difference is its leverage times that of the logarithm of its stretch. Where there are
as many places as moments, this is no small matter: without it pictures come out compressed and maps small.

In a larger map ranges, steps of the odometry and bearings all say less about places in proportion; so the size of the
map draws at nothing but what has no prior of its own, the landmarks. That, too, is taken out: a prior that is flat in
metres would be one for large maps, the more landmarks the more; it is flat in units of the map's size. Ranges stand for
the bearings in this: the nearer something is, the more its bearing says.

The results are derivatives ``(7, 2)`` of half the cost by the points of `Calibration`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.factors import CalibratedBearing, CalibratedRange
from clew.slam.landmarks.linearised import Linearised

Array = NDArray[np.float64]

#: Positions in the factors: of places, which measurements see stretched, and of the calibration.
_PLACES, _OF_SIGHTINGS, _OF_MOTION = (0, 1), (2, 3, 6), (2, 3)


def pull_of_sightings(at_ranges: Linearised, at_bearings: Linearised, shares: Array | float = 0.0) -> Array:
    """By sightings, whose ranges and bearings the calibration stretches.

    `shares` ``(K,)`` are the parts of sightings in all those of their landmark, by which its own pull is shared out.
    """
    ranges, bearings = at_ranges.factor, at_bearings.factor
    assert isinstance(ranges, CalibratedRange)
    assert isinstance(bearings, CalibratedBearing)
    out, measured = np.zeros((7, 2)), ranges.measurement
    share = sum(at.leverages(_PLACES, _OF_SIGHTINGS, lengths=True)[:, 0] for at in (at_ranges, at_bearings))
    first, second, _, mark = at_ranges.values[2:6]
    share = (share - 2.0 * shares) / ranges.stretch(first, second, mark, measurement=measured)[:, 0]
    out[2] = share.sum(), -share @ measured[:, 3]
    out[3] = share @ measured[:, 1:3]
    b = bearings.direction(*at_bearings.values, measurement=bearings.measurement)
    slope, (curve, cube) = at_bearings.values[2][0, 1], at_bearings.values[3][0]
    share = at_bearings.leverages(_PLACES, _OF_SIGHTINGS)[:, 0] / (1.0 + slope + 2.0 * curve * b + 3.0 * cube * b**2)
    out[4, 1] = share.sum()
    out[5] = 2.0 * share @ b, 3.0 * share @ b**2
    return out


def pull_of_motion(at: Linearised) -> Array:
    """By motions, whose translations are measured in a unit; the density of their noise has it, too."""
    out = np.zeros((7, 2))
    open_ones = 2.0 * len(at.error) - at.leverages(_PLACES, _OF_MOTION, lengths=True)[:, :2].sum()
    out[0, 0] = open_ones / (1.0 + at.values[2][0, 0])
    return out
