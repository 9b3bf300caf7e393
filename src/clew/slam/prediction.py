"""Where the robot should be at a scan, before the scan is looked at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.slam.config import SlamConfig
from clew.slam.sensor import SensorModel

Array = NDArray[np.float64]

LEAST_SECONDS = 0.08  # that a velocity is measured over
MEMORY = 20  # matches that the mean errors of the two predictions go back
LEVER = 2.0  # metres; what an error of a radian counts
WORSE = 2.0  # odometry that is so many times worse than the last velocity,
SLACK = 0.02  # metres; and worse by this,
TELLING = 0.5  # and whose mean error is no less than this share of the motion itself, is left aside
SENSELESS = 0.4  # metres; of odometry with such a mean error nothing is expected
SHOWN = 0.05  # metres and radians; predictions are compared where returns tell better than this


@dataclass(frozen=True)
class Prediction:
    """Motion since the last matched scan.

    Attributes:
        increment: ``(3,)`` expected,
        covariance: ``(3, 3)`` and how well.
        by_odometry: whether odometry tells it, or the last velocity.
        alternatives: ``(A, 3)`` what may have happened instead: the robot stood while its wheels turned; or odometry
            that came late shows no motion first and then all of it at once.
    """

    increment: Array
    covariance: Array
    by_odometry: bool
    alternatives: Array


class MotionPredictor:
    """Predicts by odometry, calibrated as the log goes on, or by the last velocity where that has proved better.

    Odometry that stands still, jumps or is noise is found out by its errors: both predictions are compared with every
    match, and with no motion at all. Only what returns tell counts: along a bare street each prediction confirms
    itself. There only odometry knows the way, however noisy, and the last velocity would be carried on for ever.
    """

    def __init__(self, config: SlamConfig, sensor: SensorModel) -> None:
        self._config = config
        self._sensor = sensor
        self._timestamp = 0.0
        self._T_odom_robot: Array | None = None  # at the last matched scan,
        self._T_odom_keyframe: Array | None = None  # at the last keyframe
        self._velocity = np.zeros(3)  # body velocity between the last matched scans
        self._seconds, self._moved = 0.0, np.zeros(3)  # since it was measured
        self._errors = np.zeros(3)  # mean error of odometry, of the last velocity and of no motion, metres
        self._compared = 0.0
        self._candidates: tuple[Array | None, Array] = (None, np.zeros(3))

    @property
    def velocity(self) -> Array:
        """``(3,)`` body velocity between the last two matched scans."""
        return self._velocity

    @property
    def trusts_odometry(self) -> bool:
        """Whether odometry has predicted matches better than the last velocity, or not much worse."""
        return bool(self._errors[0] <= WORSE * self._errors[1] + SLACK)

    @property
    def follows_odometry(self) -> bool:
        """Whether odometry predicts: it is trusted, or at least tells much of the motion."""
        return self.trusts_odometry or bool(self._errors[0] <= TELLING * self._errors[2])

    def start(self, timestamp: float, T_odom_robot: Array | None) -> None:
        """The first scan."""
        self._timestamp, self._T_odom_robot, self._T_odom_keyframe = timestamp, T_odom_robot, T_odom_robot

    def predict(self, timestamp: float, T_odom_robot: Array | None) -> Prediction:
        """Motion until a scan; `T_odom_robot` is None where there is no odometry."""
        options = self._config.tracking
        seconds = max(timestamp - self._timestamp, 1e-3)
        increment: Array | None = None
        quality = self._sensor.odometry.quality
        if T_odom_robot is not None and self._T_odom_robot is not None:
            increment = quality.correct(se2.between(self._T_odom_robot, T_odom_robot))
            if np.hypot(increment[0], increment[1]) > options.fastest * max(seconds, options.carry_on):
                increment = None
        self._candidates = (increment, self.by_velocity(timestamp).increment)
        if increment is not None and self.follows_odometry:
            return Prediction(increment, quality.covariance(increment), True, np.zeros((1, 3)))
        alternatives = np.zeros((1, 3))
        if increment is not None:
            if self._errors[0] < SENSELESS:
                alternatives = np.stack([np.zeros(3), increment])
            self._sensor.unused_odometry += 1
        return replace(self.by_velocity(timestamp), alternatives=alternatives)

    def by_velocity(self, timestamp: float) -> Prediction:
        """Motion until a scan without odometry: the last velocity goes on for a moment."""
        options = self._config.tracking
        seconds = max(timestamp - self._timestamp, 1e-3)
        ahead = se2.exp(self._velocity * min(seconds, options.carry_on))
        translation, rotation = (sigma * seconds for sigma in options.velocity_sigmas)
        covariance = np.diag([translation**2, translation**2, rotation**2])
        return Prediction(ahead, covariance, False, np.zeros((1, 3)))

    def moved(self, timestamp: float, T_odom_robot: Array | None, moved: Array, information: Array) -> None:
        """Take notice of how the robot moved ``(3,)`` since the last scan, and what returns tell of it ``(3, 3)``."""
        seconds = timestamp - self._timestamp
        by_odometry, by_velocity = self._candidates
        least = float(np.linalg.eigvalsh(information)[0])
        if least > 0.0 and by_odometry is not None:
            weight = least / (least + 1.0 / SHOWN**2)
            self._compared += weight
            error = se2.between(np.stack([by_odometry, by_velocity, np.zeros(3)]), moved)
            size = np.minimum(np.hypot(error[:, 0], error[:, 1]) + LEVER * np.abs(error[:, 2]), 1.0)
            self._errors += weight * (size - self._errors) / min(max(self._compared, 1.0), MEMORY)
        # Scans may come in bursts: over a moment too short, noise is all there is to a velocity.
        self._velocity = self.velocity_to(timestamp, moved)
        self._seconds, self._moved = self._seconds + seconds, se2.compose(self._moved, moved)
        if self._seconds >= LEAST_SECONDS:
            self._seconds, self._moved = 0.0, np.zeros(3)
        self._timestamp, self._T_odom_robot = timestamp, T_odom_robot

    def velocity_to(self, timestamp: float, moved: Array) -> Array:
        """``(3,)`` body velocity, should the robot have moved ``(3,)`` since the last matched scan."""
        seconds = self._seconds + timestamp - self._timestamp
        if seconds < LEAST_SECONDS:
            return self._velocity
        return np.asarray(se2.log(se2.compose(self._moved, moved)) / seconds, dtype=np.float64)

    def keyframe(self, T_odom_robot: Array | None, step: Array, information: Array) -> None:
        """Learn from the step ``(3,)`` between two keyframes, measured with some information ``(3, 3)`` by returns."""
        if T_odom_robot is not None and self._T_odom_keyframe is not None:
            increment = se2.between(self._T_odom_keyframe, T_odom_robot)
            assumed = np.diag(self._config.odometry.covariance(increment))
            variance = 2.0 * np.diag(np.linalg.inv(information + np.diag(1e-3 / assumed)))  # of both ends
            known = np.where(variance < assumed, 1.0 - variance / assumed, 0.0)
            if np.hypot(increment[0], increment[1]) < self._config.tracking.fastest:
                self._sensor.odometry.add(increment, step, known, variance)
        self._T_odom_keyframe = T_odom_robot
