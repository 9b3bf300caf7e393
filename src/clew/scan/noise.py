"""The noise of a laser's ranges, from its scans alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.scan.laser import LaserScan

Array = NDArray[np.float64]

STEEP = 0.6  # a neighbour further than this share of the way along the beam is no part of a wall seen frontally
CUT = 2.5  # residuals beyond so many deviations are edges
#: Mean square of a standard Gaussian within the cut.
WITHIN = 0.91125
ROUNDS = 20


def collinearity_residuals(scan: LaserScan) -> Array:
    """How far each return lies from the line through its two neighbours, along its beam, in metres.

    Scaled so that independent noise of the ranges has the deviation of the residuals. Returns at edges, on small or
    curved things give large values: judge by a robust measure (`robust_deviation`).
    """
    r = np.where((scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max), scan.ranges, np.nan)
    if len(r) < 3:
        return np.zeros(0)
    before, here, after = r[:-2], r[1:-1], r[2:]
    angles = scan.angles
    a, b = angles[1:-1] - angles[:-2], angles[2:] - angles[1:-1]
    # The line through two points meets the beam between them at 1/r = (sin(b)/r0 + sin(a)/r2) / sin(a + b).
    sine = np.sin(a + b)
    with np.errstate(invalid="ignore", divide="ignore"):
        u, v = np.sin(b) / sine, np.sin(a) / sine
        expected = 1.0 / (u / before + v / after)
        spread = np.sqrt(1.0 + (u * expected**2 / before**2) ** 2 + (v * expected**2 / after**2) ** 2)
        residual = (here - expected) / spread
        flat = np.abs(after - before) <= 2 * STEEP * np.abs(sine) * here
    return np.asarray(residual[flat & np.isfinite(residual)])


def robust_deviation(residuals: Array) -> float:
    """Standard deviation of the Gaussian core of residuals ``(n,)``; ``nan`` of none.

    The mean square within 2.5 deviations, corrected for the cut, until it stands still: unlike the median, it serves
    ranges rounded to steps as large as their noise.
    """
    if not len(residuals):
        return float("nan")
    squares = np.square(residuals)
    sigma = 1.4826 * float(np.quantile(np.abs(residuals), 0.5)) or float(np.sqrt(squares.mean()))
    for _ in range(ROUNDS):
        inside = squares[squares <= (CUT * sigma) ** 2]
        if not len(inside):
            break
        sigma = float(np.sqrt(inside.mean() / WITHIN)) or sigma
    return sigma
