"""When the beams of a scan are measured, where the log does not say."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from clew.scan.laser import LaserScan

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BeamTimes:
    """Moments of the beams of a laser, about the middle of the scan.

    A mirror that turns looks in one direction after the other. A laser whose beams lie closer together than its pulses
    follow each other takes two turns for one scan: the SICK LMS, at half a degree, measures the first, third, fifth ...
    beam in one turn of 13.3 ms, and those between in the next.

    Attributes:
        sweep: seconds from the first beam to the last; negative where the last is measured first.
        interlace: seconds by which the second, fourth, ... beam are measured later than those between which they lie.
        sweep_deviation, interlace_deviation: standard deviations, seconds.
    """

    sweep: float = 0.0
    interlace: float = 0.0
    sweep_deviation: float = float("inf")
    interlace_deviation: float = float("inf")

    def __bool__(self) -> bool:
        """Whether any two beams are of different moments."""
        return self.sweep != 0.0 or self.interlace != 0.0

    def moments(self, beams: int) -> Array:
        """``(beams,)`` seconds after the middle of the scan."""
        return _moments(self.sweep, self.interlace, beams)

    def of(self, scan: LaserScan) -> LaserScan:
        """The scan with these moments of its beams in place of any other; its timestamp is taken for its middle."""
        if not self and scan.moments is None:
            return scan
        return replace(scan, moments=self.moments(len(scan.ranges)) if self else None)


@lru_cache(maxsize=64)
def _moments(sweep: float, interlace: float, beams: int) -> Array:
    """One array for all scans of a laser: they are kept by the thousand."""
    moments = sweep * sweep_of(beams) + interlace * interlace_of(beams)
    moments.flags.writeable = False
    return moments


def sweep_of(beams: int) -> Array:
    """``(beams,)`` from -1/2 at the first beam to 1/2 at the last; 0 at the only one."""
    last = max(beams - 1, 0)
    return np.asarray((np.arange(beams) - 0.5 * last) / max(last, 1), dtype=np.float64)


def interlace_of(beams: int) -> Array:
    """``(beams,)`` -1/2 and 1/2 in turns."""
    return np.asarray(np.arange(beams) % 2 - 0.5, dtype=np.float64)
