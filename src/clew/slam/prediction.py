"""Where the robot should be at a scan, before the scan is looked at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2, wrap
from clew.motion import GyroHeading
from clew.motion.calibration import FREEDOM
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
TURN_SLACK = 0.01  # radians; a gyro that is `WORSE` than what else tells the turn, and by this, is left aside
CONTRADICTION = 9.0  # squared deviations between gyro and odometry from which either may be what happened
KNOWN_TURN = 0.03  # radians; a turn that is measured no better than this tells nothing about the gyro


@dataclass(frozen=True)
class Prediction:
    """Motion since the last matched scan.

    Attributes:
        increment: ``(3,)`` expected,
        covariance: ``(3, 3)`` and how well.
        by_odometry: whether odometry tells it, or the last velocity; a gyro may tell the turn of either.
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

    A gyro takes over the turn, as far as its noise and that of odometry say so, and unless its turns have proved worse
    than those that would be predicted without it.
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
        self._heading: GyroHeading | None = None  # at the last matched scan,
        self._keyframe_heading: GyroHeading | None = None  # at the last keyframe
        self._turns: Array | None = None  # ``(2,)`` to be expected by the gyro, and without it,
        self._turn_errors = np.zeros(2)  # their mean errors, radians,
        self._turns_compared = 0.0  # and the matches that these go back

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

    @property
    def trusts_gyro(self) -> bool:
        """Whether the gyro has told turns better than would be known without it, or not much worse."""
        better = self._turn_errors[0] <= WORSE * self._turn_errors[1] + TURN_SLACK
        return bool(better and self._sensor.gyro.turns_along)

    def turn_rate(self, told: float | None) -> float | None:
        """Radians a second without the errors of the gyro that told it, if that is proven and trusted."""
        if told is None or not self._sensor.gyro.proven or not self.trusts_gyro:
            return None
        return self._sensor.gyro.quality.rate(told)

    def start(self, timestamp: float, T_odom_robot: Array | None, heading: GyroHeading | None = None) -> None:
        """The first scan."""
        self._timestamp, self._T_odom_robot, self._T_odom_keyframe = timestamp, T_odom_robot, T_odom_robot
        self._heading = self._keyframe_heading = heading

    def predict(
        self, timestamp: float, T_odom_robot: Array | None, heading: GyroHeading | None = None
    ) -> Prediction:
        """Motion until a scan; `T_odom_robot` and `heading` are None without odometry, and without a gyro."""
        options = self._config.tracking
        seconds = max(timestamp - self._timestamp, 1e-3)
        increment: Array | None = None
        quality = self._sensor.odometry.quality
        if T_odom_robot is not None and self._T_odom_robot is not None:
            increment = quality.correct(se2.between(self._T_odom_robot, T_odom_robot))
            if np.hypot(increment[0], increment[1]) > options.fastest * max(seconds, options.carry_on):
                increment = None
        told = None if heading is None else heading.since(self._heading)
        by_velocity = self.by_velocity(timestamp, told)
        if told is not None:
            without = increment if increment is not None and self.follows_odometry else self._ahead(timestamp)
            self._turns = np.array([self._sensor.gyro.quality.correct(told), without[2]])
        else:
            self._turns = None
        by_odometry = None
        if increment is not None:
            alone = Prediction(increment, quality.covariance(increment), True, np.zeros((1, 3)))
            by_odometry = self._turned(alone, told)
            increment = by_odometry.increment
        self._candidates = (increment, by_velocity.increment)
        if by_odometry is not None and self.follows_odometry:
            return by_odometry
        alternatives = np.zeros((1, 3))
        if increment is not None:
            if self._errors[0] < SENSELESS:
                alternatives = np.stack([np.zeros(3), increment])
            self._sensor.unused_odometry += 1
        return replace(by_velocity, alternatives=alternatives)

    def by_velocity(self, timestamp: float, told: Array | None = None) -> Prediction:
        """Motion until a scan without odometry: the last velocity goes on for a moment.

        Args:
            timestamp: of the scan.
            told: ``(3,)`` what a gyro tells since the last matched scan, if there is one.
        """
        seconds = max(timestamp - self._timestamp, 1e-3)
        translation, rotation = (sigma * seconds for sigma in self._config.tracking.velocity_sigmas)
        covariance = np.diag([translation**2, translation**2, rotation**2])
        return self._turned(Prediction(self._ahead(timestamp), covariance, False, np.zeros((1, 3))), told)

    def _ahead(self, timestamp: float) -> Array:
        """``(3,)`` motion until a scan at the last velocity."""
        seconds = max(timestamp - self._timestamp, 1e-3)
        return np.asarray(se2.exp(self._velocity * min(seconds, self._config.tracking.carry_on)), dtype=np.float64)

    def _turned(self, prediction: Prediction, told: Array | None) -> Prediction:
        """A prediction whose turn is told by the gyro, too, each weighted by its variance.

        Errors of odometry have heavy tails (wheels slip), those of a gyro have not: what contradicts the gyro is worth
        less, as in Student's t distribution (Lange, Little, Taylor 1989). Before the gyro has been seen to turn with
        the robot, odometry does without it, and beside the last velocity it is worth as much less itself.
        """
        if told is None or not self.trusts_gyro or (prediction.by_odometry and not self._sensor.gyro.proven):
            return prediction
        gyro = self._sensor.gyro.quality
        variance, of_gyro = float(prediction.covariance[2, 2]), gyro.variance(told)
        difference = float(wrap(gyro.correct(told) - prediction.increment[2]))
        squared = difference**2 / (variance + of_gyro)
        tail = (FREEDOM + squared) / (FREEDOM + 1.0) if squared > 1.0 else 1.0
        variance *= tail
        of_gyro *= 1.0 if self._sensor.gyro.proven else tail
        share = variance / (variance + of_gyro)
        twist = np.asarray(se2.log(prediction.increment), dtype=np.float64)
        twist[2] += share * difference
        covariance = prediction.covariance.copy()
        covariance[2, 2] = share * of_gyro
        alternatives = prediction.alternatives
        if squared > CONTRADICTION:
            alternatives = np.concatenate([alternatives, prediction.increment[None]])
        return Prediction(np.asarray(se2.exp(twist)), covariance, prediction.by_odometry, alternatives)

    def moved(
        self, timestamp: float, T_odom_robot: Array | None, moved: Array, information: Array,
        heading: GyroHeading | None = None,
    ) -> None:  # fmt: skip
        """Take notice of how the robot moved ``(3,)`` since the last scan, and what returns tell of it ``(3, 3)``."""
        self._compare_turns(float(moved[2]), information)
        self._heading = heading
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

    def _compare_turns(self, turn: float, information: Array) -> None:
        if self._turns is None:
            return
        if not self.trusts_gyro:
            self._sensor.unused_gyro += 1
        variance = float(np.linalg.inv(information + 1e-6 * np.eye(3))[2, 2])
        weight = SHOWN**2 / (SHOWN**2 + variance)
        self._turns_compared += weight
        size = np.minimum(np.abs(wrap(self._turns - turn)), 0.5)
        self._turn_errors += weight * (size - self._turn_errors) / min(max(self._turns_compared, 1.0), MEMORY)

    def velocity_to(self, timestamp: float, moved: Array) -> Array:
        """``(3,)`` body velocity, should the robot have moved ``(3,)`` since the last matched scan."""
        seconds = self._seconds + timestamp - self._timestamp
        if seconds < LEAST_SECONDS:
            return self._velocity
        return np.asarray(se2.log(se2.compose(self._moved, moved)) / seconds, dtype=np.float64)

    def keyframe(
        self, T_odom_robot: Array | None, step: Array, information: Array, heading: GyroHeading | None = None
    ) -> None:
        """Learn from the step ``(3,)`` between two keyframes, measured with some information ``(3, 3)`` by returns."""
        told = None if heading is None else heading.since(self._keyframe_heading)
        if told is not None and information.any():
            variance_turn = 2.0 * float(np.linalg.inv(information + np.eye(3))[2, 2])  # of both ends
            known_turn = max(1.0 - variance_turn / KNOWN_TURN**2, 0.0)
            self._sensor.gyro.add(told, float(step[2]), known_turn, variance_turn)
        self._keyframe_heading = heading
        if T_odom_robot is not None and self._T_odom_keyframe is not None:
            increment = se2.between(self._T_odom_keyframe, T_odom_robot)
            assumed = np.diag(self._config.odometry.covariance(increment))
            variance = 2.0 * np.diag(np.linalg.inv(information + np.diag(1e-3 / assumed)))  # of both ends
            known = np.where(variance < assumed, 1.0 - variance / assumed, 0.0)
            if np.hypot(increment[0], increment[1]) < self._config.tracking.fastest:
                self._sensor.odometry.add(increment, step, known, variance)
        self._T_odom_keyframe = T_odom_robot
