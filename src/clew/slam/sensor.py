"""What is known of the sensors, learnt from the log as it comes."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.motion import GyroCalibration, OdometryCalibration
from clew.scan import (
    Alignment,
    AlignmentOptions,
    BeamTimes,
    LaserScan,
    collinearity_residuals,
    robust_deviation,
)
from clew.slam.config import SlamConfig
from clew.slam.match_noise import MatchNoise

Array = NDArray[np.float64]

FIRST_SCANS = 20  # looked at one by one,
EVERY = 10  # later one in so many
NOISE_SCANS = 60  # whose residuals make the estimate of the noise
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
        gyro: noise, bias and scale of the gyro.
        tells_beam_times: whether the log tells when the beams of a scan are measured,
        beam_times: and as found from scans where it does not.
        matches: what matches are worth.
    """

    def __init__(self, config: SlamConfig) -> None:
        self.odometry = OdometryCalibration(config.odometry)
        self.gyro = GyroCalibration(config.gyro)
        self.tells_beam_times = False
        self.beam_times = BeamTimes()
        self.matches = MatchNoise()
        self._residuals: deque[Array] = deque(maxlen=NOISE_SCANS)
        self._alignment = config.alignment
        self._cleaning = config.cleaning
        self._noise = config.alignment.sigma / 2  # until the first scan tells
        self._scans = 0
        self._gaps: deque[float] = deque(maxlen=1000)
        self._last: float | None = None
        self._beams: Counter[tuple[int, float]] = Counter()
        self._returns = np.zeros(2)  # beams with a return, and all
        self._longest: list[float] = []
        self._sweep = 0.0
        self.unused_odometry = 0  # matches predicted without it, since it told less than the last velocity
        self.unused_gyro = 0  # and without the gyro, since it told turns worse than what else does

    @property
    def range_noise(self) -> float:
        """Deviation of a range, metres."""
        return self._noise

    @property
    def return_deviation(self) -> float:
        """Deviation of a return about the map: noise of the range, roughness of surfaces, errors of the map, metres."""
        return max(self.matches.rms / CAUCHY_SHARE, self._noise, LEAST_NOISE)

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

    def match_information(self, match: Alignment) -> Array:
        """Information ``(3, 3)`` of the returns of a match, the only one in its alignment."""
        return self.matches.information(match, self._noise, LEAST_NOISE)

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
        self.tells_beam_times |= scan.is_sweep
        if self._scans > FIRST_SCANS and self._scans % EVERY:
            return
        self._beams[(len(scan.ranges), round(abs(scan.angle_increment), 8))] += 1
        met = (scan.ranges >= scan.range_min) & (scan.ranges <= scan.range_max)
        self._returns += np.array([np.count_nonzero(met), len(met)], dtype=np.float64)
        self._longest.append(float(scan.ranges[met].max()) if met.any() else 0.0)
        self._sweep = max(self._sweep, scan.span[1])
        self._residuals.append(collinearity_residuals(scan))
        # Often at first; later it hardly changes.
        if self._scans <= FIRST_SCANS or self._scans % (10 * EVERY) == 0:
            noise = robust_deviation(np.concatenate(list(self._residuals)))
            if np.isfinite(noise):
                self._noise = noise

    def timed(self, scan: LaserScan) -> LaserScan:
        """A scan with the moments of its beams, as far as they are told or have been found."""
        return scan if scan.is_sweep else self.beam_times.of(scan)

    def report(self) -> dict[str, object]:
        """Plain numbers: metres, degrees, Hertz."""
        (beams, increment), _ = self._beams.most_common(1)[0]
        laser: dict[str, object] = {
            "beams": beams,
            "other_numbers_of_beams": sorted({n for n, _ in self._beams} - {beams}),
            "angular_resolution_deg": round(float(np.degrees(increment)), 4),
            "field_of_view_deg": round(float(np.degrees(increment * (beams - 1))), 2),
            "scans_per_second": round(1.0 / max(float(np.mean(self._gaps)), 1e-6), 2) if self._gaps else None,
            **self._timing(),
            "range_noise_m": round(self.range_noise, 4),
            "return_deviation_m": round(self.return_deviation, 4),
            "residual_correlation": round(self.matches.correlation, 2),
            "longest_return_m": round(float(np.quantile(self._longest, 0.98)), 2),
            "share_of_returns": round(float(self._returns[0] / max(self._returns[1], 1.0)), 3),
        }
        quality = self.odometry.quality
        out: dict[str, object] = {"laser": laser}
        if quality.steps:
            out["odometry"] = {**quality.to_dict(), "matches_without_it": self.unused_odometry}
        if self.gyro.quality.steps:
            out["gyro"] = {**self.gyro.quality.to_dict(), "turns_along": self.gyro.turns_along,
                           "matches_without_it": self.unused_gyro}  # fmt: skip
        if warnings := self._doubts():
            out["doubts"] = warnings
        return out

    def _timing(self) -> dict[str, object]:
        """How long a scan takes, and who says so."""
        found = self.beam_times
        if self.tells_beam_times or not found:
            source = "log" if self.tells_beam_times else None
            return {"sweep_seconds": round(self._sweep, 5), "sweep_known_from": source}
        numbers = {
            "sweep_seconds": found.sweep, "sweep_deviation_seconds": found.sweep_deviation,
            "interlace_seconds": found.interlace, "interlace_deviation_seconds": found.interlace_deviation,
        }  # fmt: skip
        rounded = {name: round(value, 5) if np.isfinite(value) else None for name, value in numbers.items()}
        return {**rounded, "sweep_known_from": "scans"}

    def _doubts(self) -> list[str]:
        """What looks wrong about the sensors and their places on the robot, in words."""
        quality = self.odometry.quality
        askew, beside = float(quality.bias[1, 0]), quality.bias[:2, 1]
        doubts = []
        if abs(askew) > ASKEW + 3 * quality.bias_deviation[1, 0]:
            doubts.append(f"the laser seems mounted {np.degrees(-askew):+.1f} degrees askew of what the log says")
        if float(np.hypot(*beside)) > BESIDE + 3 * float(quality.bias_deviation[:2, 1].max()):
            doubts.append(
                f"the laser seems mounted {100 * float(np.hypot(*beside)):.0f} cm off from where the log says"
            )
        slope = 1.0 if self.gyro.slope is None else self.gyro.slope
        if -1.5 < slope < -0.5:
            doubts.append("the gyro turns the other way: the IMU seems mounted upside down, and no transform says so")
        elif 40.0 < abs(slope) < 80.0:
            doubts.append("the gyro seems to tell degrees a second; rates should be radians a second")
        elif not self.gyro.turns_along:
            doubts.append("the gyro does not turn as the robot does: it is broken, or lies about another axis")
        return doubts
