"""What is known of the sensors, learnt from the log as it comes."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.motion import OdometryCalibration
from clew.scan import Alignment, AlignmentOptions, LaserScan, collinearity_residuals, robust_deviation
from clew.slam.config import SlamConfig

Array = NDArray[np.float64]

FIRST_SCANS = 20  # looked at one by one,
EVERY = 10  # later one in so many
NOISE_SCANS = 60  # whose residuals make the estimate of the noise
FIRST_SLOPE, LEAST_SLOPE = 0.7, 0.2  # shares of the information; before any match, and at least
LEAST_PUSH = 1e-9
TINY = 1e-100
MATCHES = 100  # residuals of matches that are remembered
LEAST_NOISE = 0.002  # metres; below, the world is rougher than any laser measures
#: A Gaussian's root mean square, weighted by a Cauchy kernel of scale two deviations, is this share of its deviation.
CAUCHY_SHARE = 0.9
BENT = 0.03  # radians; surfaces are not quite straight, and normals near corners less so
ASKEW = np.radians(2.0)  # a laser that seems mounted this much askew is worth a word
BESIDE = 0.03  # metres, and this far beside where it is said to be


class SensorModel:
    """Laser and odometry as the log shows them; asked by the front end, reported at the end.

    Attributes:
        odometry: noise and systematic errors of the odometry.
    """

    def __init__(self, config: SlamConfig) -> None:
        self.odometry = OdometryCalibration(config.odometry)
        self._residuals: deque[Array] = deque(maxlen=NOISE_SCANS)
        self._alignment = config.alignment
        self._cleaning = config.cleaning
        self._noise = config.alignment.sigma / 2  # until the first scan tells
        self._matches: deque[Array] = deque(maxlen=MATCHES)  # residual, correlation and variance
        self._matched, self._correlation, self._variance = 0.0, 1.0, 0.0  # their medians, once there are enough
        self._slopes: deque[float] = deque(maxlen=MATCHES)
        self._slope = FIRST_SLOPE
        self._unsloped = 0  # matches since
        self._worth = 0.5
        self._scans = 0
        self._gaps: deque[float] = deque(maxlen=1000)
        self._last: float | None = None
        self._beams: Counter[tuple[int, float]] = Counter()
        self._returns = np.zeros(2)  # beams with a return, and all
        self._longest: list[float] = []
        self._sweep = 0.0
        self.unused_odometry = 0  # matches predicted without it, since it told less than the last velocity

    @property
    def range_noise(self) -> float:
        """Deviation of a range, metres."""
        return self._noise

    @property
    def return_deviation(self) -> float:
        """Deviation of a return about the map: noise of the range, roughness of surfaces, errors of the map, metres."""
        return max(self._matched / CAUCHY_SHARE, self._noise, LEAST_NOISE)

    @property
    def alignment(self) -> AlignmentOptions:
        """How returns are weighted: as configured, or by the deviation found where that is larger."""
        return replace(self._alignment, sigma=max(self._alignment.sigma, self.return_deviation))

    def return_information(self, independent: float) -> float:
        """What the information of an alignment with `alignment` is multiplied by, to be that of its returns.

        Args:
            independent: share of returns that tell something new.
        """
        return independent * (self.alignment.sigma / self.return_deviation) ** 2

    @property
    def match_worth(self) -> float:
        """What the information of an alignment is worth in the mean of recent matches."""
        return self._worth

    def information_of(self, alignment: Alignment) -> Array:
        """Information ``(3, 3)`` of the returns of a match.

        Their residuals, with what neighbours have in common, push the pose about; it resists by the slope of the error.
        The covariance is the slope's inverse on both sides of that of the push (the sandwich of Huber 1967).

        Args:
            alignment: of the match alone.
        """
        variance = max(self._variance or self._noise**2, LEAST_NOISE**2)
        spread = alignment.spread[0]
        unit = np.sqrt(np.diag(spread) + TINY)
        values, vectors = np.linalg.eigh(alignment.push[0] / np.outer(unit, unit))
        own = np.outer(unit, unit) * ((vectors * np.maximum(values, 0.0)) @ vectors.T)  # of few returns, not quite one
        push = 0.5 * (own + variance * spread) + np.diag(TINY + LEAST_PUSH * np.square(unit))
        slope = self._slope * alignment.information[0]
        information = np.asarray(slope @ np.linalg.solve(push, slope), dtype=np.float64)
        share = np.trace(information[:2, :2]) / max(np.trace(alignment.information[0, :2, :2]), TINY)
        self._worth += (share - self._worth) / FIRST_SCANS
        return information

    @property
    def normal_variance(self) -> float:
        """Variance of the direction of a surface normal, radians^2.

        That of a line through returns one `spacing` from each other over the neighbourhood of a return, and of the
        surface itself.
        """
        radius, spacing = self._cleaning.radius, self._cleaning.spacing
        by_returns = 12.0 * self.return_deviation**2 * spacing / (2.0 * radius) ** 3
        return float(by_returns + BENT**2)

    def see(self, scan: LaserScan) -> None:
        """Take notice of a scan."""
        if self._last is not None:
            self._gaps.append(scan.timestamp - self._last)
        self._last = scan.timestamp
        self._scans += 1
        if self._scans > FIRST_SCANS and self._scans % EVERY:
            return
        self._beams[(len(scan.ranges), round(abs(scan.angle_increment), 8))] += 1
        met = (scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max)
        self._returns += np.array([np.count_nonzero(met), len(met)], dtype=np.float64)
        self._longest.append(float(scan.ranges[met].max()) if met.any() else 0.0)
        self._sweep = max(self._sweep, scan.time_increment * len(scan.ranges))
        self._residuals.append(collinearity_residuals(scan))
        # Often at first; later it hardly changes.
        if self._scans <= FIRST_SCANS or self._scans % (10 * EVERY) == 0:
            noise = robust_deviation(np.concatenate(list(self._residuals)))
            if np.isfinite(noise):
                self._noise = noise

    def matched(self, rms: float, correlation: float, variance: float) -> None:
        """Take notice of the residuals of a match, see `clew.scan.Alignment`."""
        self._matches.append(np.array([rms, correlation, variance]))
        if len(self._matches) >= FIRST_SCANS:
            self._matched, self._correlation, self._variance = np.median(np.array(self._matches), axis=0).tolist()

    @property
    def wants_slope(self) -> bool:
        """Whether the slope of the next match should be looked at: often at first, later it hardly changes."""
        self._unsloped += 1
        return len(self._slopes) < FIRST_SCANS or self._unsloped >= EVERY

    def sloped(self, share: float) -> None:
        """Take notice of the share of its information that a match resists by."""
        self._unsloped = 0
        self._slopes.append(share)
        self._slope = float(np.clip(np.median(self._slopes), LEAST_SLOPE, 1.0))

    def report(self) -> dict[str, object]:
        """Plain numbers: metres, degrees, Hertz."""
        (beams, increment), _ = self._beams.most_common(1)[0]
        laser: dict[str, object] = {
            "beams": beams,
            "other_numbers_of_beams": sorted({n for n, _ in self._beams} - {beams}),
            "angular_resolution_deg": round(float(np.degrees(increment)), 4),
            "field_of_view_deg": round(float(np.degrees(increment * (beams - 1))), 2),
            "scans_per_second": round(1.0 / max(float(np.mean(self._gaps)), 1e-6), 2) if self._gaps else None,
            "sweep_seconds": round(self._sweep, 4),
            "range_noise_m": round(self.range_noise, 4),
            "return_deviation_m": round(self.return_deviation, 4),
            "longest_return_m": round(float(np.quantile(self._longest, 0.98)), 2),
            "share_of_returns": round(float(self._returns[0] / max(self._returns[1], 1.0)), 3),
        }
        quality = self.odometry.quality
        out: dict[str, object] = {"laser": laser}
        if quality.steps:
            out["odometry"] = {**quality.to_dict(), "matches_without_it": self.unused_odometry}
        if warnings := self._doubts():
            out["doubts"] = warnings
        return out

    def _doubts(self) -> list[str]:
        """What looks wrong about the laser's place on the robot, in words."""
        quality = self.odometry.quality
        askew, beside = float(quality.bias[1, 0]), quality.bias[:2, 1]
        doubts = []
        if abs(askew) > ASKEW + 3 * quality.bias_deviation[1, 0]:
            doubts.append(f"the laser seems mounted {np.degrees(-askew):+.1f} degrees askew of what the log says")
        if float(np.hypot(*beside)) > BESIDE + 3 * float(quality.bias_deviation[:2, 1].max()):
            doubts.append(
                f"the laser seems mounted {100 * float(np.hypot(*beside)):.0f} cm off from where the log says"
            )
        return doubts
