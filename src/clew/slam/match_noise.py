"""What matches of scans are worth, learnt from the matches themselves.

A match minimises a sum over returns. Near its end the sum's gradient is pushed about by the residuals, with covariance
``B``, and grows with slope ``A`` as the pose is moved; so the pose errs with covariance ``A^-1 B A^-1`` (the sandwich
of Huber 1967; with residuals that neighbours have in common in ``B``, Newey and West 1987). Neither is the information
that independent returns of known noise about an exact map would have: real walls are rough, so that neighbours err
together; a map as thick as its noise has a partner near each return wherever it is moved. Both are measured in the log.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from clew.scan import Alignment

Array = NDArray[np.float64]

FIRST = 20  # matches whose slopes are measured each,
EVERY = 10  # later one in so many
REMEMBERED = 100  # matches
FIRST_SLOPE, LEAST_SLOPE = 0.7, 0.2  # shares of the information that a match resists by: before any, and at least
FIRST_WORTH = 0.5
LEAST_PUSH = 1e-9  # share of that of independent returns a metre off: of a few that happen to lie on their surfaces
TINY = 1e-100


class MatchNoise:
    """Residuals of the last matches, and how they resist being moved.

    Attributes:
        rms: median residual along the normals, metres; zero until there are enough matches.
        correlation: median sum of the residuals' autocorrelation along a scan: so many returns tell as much as one.
        slope: median share of its information that a match resists by.
        worth: what the information of an alignment is multiplied by in the mean, to be that of its returns.
    """

    def __init__(self) -> None:
        self.rms, self.correlation, self.worth = 0.0, 1.0, FIRST_WORTH
        self._variance = 0.0
        self._matches: deque[Array] = deque(maxlen=REMEMBERED)
        self._slopes: deque[float] = deque(maxlen=REMEMBERED)
        self.slope = FIRST_SLOPE
        self._since = 0  # matches since the last slope

    def add(self, match: Alignment) -> None:
        """Take notice of a match (the only one in its alignment)."""
        self._matches.append(np.array([match.rms[0], match.correlation[0], match.variance[0]]))
        self._since += 1
        if len(self._matches) >= FIRST:
            self.rms, self.correlation, self._variance = np.median(np.array(self._matches), axis=0).tolist()

    def wants_slope(self) -> bool:
        """Whether the slope of the last match should be measured: always at first, later it hardly changes."""
        return len(self._slopes) < FIRST or self._since >= EVERY

    def add_slope(self, share: float) -> None:
        """Take notice of the share of its information that a match resists by (`clew.scan.slope_share`)."""
        self._since = 0
        self._slopes.append(share)
        self.slope = float(np.clip(np.median(self._slopes), LEAST_SLOPE, 1.0))

    def information(self, match: Alignment, range_noise: float, least_noise: float) -> Array:
        """Information ``(3, 3)`` of the returns of a match, in the tangent of its pose.

        The push is half that of its own residuals, so that a scan in which much has moved tells less, and half that of
        residuals as they usually are, since those of one scan are few.

        Args:
            match: the only one in its alignment.
            range_noise: deviation of a range, which residuals are taken to have until there are enough, metres.
            least_noise: that they have at least, metres.
        """
        variance = max(self._variance or range_noise**2, least_noise**2)
        spread = match.spread[0]
        unit = np.sqrt(np.diag(spread) + TINY)
        values, vectors = np.linalg.eigh(match.push[0] / np.outer(unit, unit))
        own = np.outer(unit, unit) * ((vectors * np.maximum(values, 0.0)) @ vectors.T)  # of few returns it may be none
        push = 0.5 * (own + variance * spread) + np.diag(TINY + LEAST_PUSH * np.square(unit))
        slope = self.slope * match.information[0]
        information = slope @ np.linalg.solve(push, slope)
        share = float(np.trace(information[:2, :2]) / max(np.trace(match.information[0, :2, :2]), TINY))
        self.worth += (share - self.worth) / FIRST
        return np.asarray(0.5 * (information + information.T), dtype=np.float64)
