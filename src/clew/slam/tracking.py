"""The front end: where is the robot against the last few keyframes?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.motion import GyroHeading
from clew.scan import LaserScan, ScanPoints, deskew, extract_points
from clew.slam.config import SlamConfig
from clew.slam.keyframes import Keyframe, KeyframeStore
from clew.slam.local_map import LocalMap, LocalMapBuilder
from clew.slam.matching import Match, ScanMatcher
from clew.slam.prediction import MotionPredictor, Prediction
from clew.slam.sensor import SensorModel

Array = NDArray[np.float64]

FAST_SECONDS = 0.06  # a scan so soon after the last matched one is matched only where the robot has moved
FAST_MORE = 2.5  # times as far as one that stands may have
CHANGE_SIGMAS = 5.0  # of the range noise; a return that differs by more, and by more than the robot may move unseen,
CHANGED_SHARE = 0.05  #   on so many of the beams, shows that the robot moves
SWEEP_ROUNDS = 3  # matches at most that find pose and motion during the sweep together,
SWEEP_SHARE = 0.6  # by so much of the difference at a time,
SWEEP_STEADY = 0.002  # until what is still to be moved in a sweep is less, metres, and a hundredth of a radian for 5 m
SWEEP_LEVER = 5.0  # metres
CENTRED = 0.1  # share of a scan's time that its timestamp may be off its middle
SWEEP_BLUR = 0.01  # metres; as `SWEEP_STEADY`, about the middle of a scan, where the pose hardly depends on the motion


@dataclass(frozen=True)
class TrackedScan:
    """Where the robot was at a scan.

    Attributes:
        keyframe: index of the keyframe that the pose is relative to.
        T_keyframe_robot: ``(3,)``.
        is_keyframe: whether the scan became that keyframe.
        scan: as it would have been measured all at once, at its timestamp,
        velocity: ``(3,)`` and the body velocity that was taken out of it.
        covariance: ``(3, 3)`` of the pose seen from the keyframe that it was tracked against, in its own tangent.
    """

    keyframe: int
    T_keyframe_robot: Array
    is_keyframe: bool
    scan: LaserScan
    velocity: Array
    covariance: Array


class Tracker:
    """Matches scans against a map of recent keyframes and decides when a scan becomes a keyframe.

    The pose is tracked relative to the last keyframe, with its covariance: odometry adds uncertainty, returns take it
    away in the directions that they measure. Along a bare corridor only odometry is left, and the covariance says so.
    """

    def __init__(self, keyframes: KeyframeStore, config: SlamConfig, sensor: SensorModel) -> None:
        self._keyframes = keyframes
        self._config = config
        self._sensor = sensor
        self._predictor = MotionPredictor(config, sensor)
        self._matcher = ScanMatcher(config, sensor)
        self._maps = LocalMapBuilder(keyframes, config)
        self._map: LocalMap | None = None
        self._T_keyframe_robot = np.zeros(3)  # at the last matched scan
        self._covariance = np.zeros((3, 3))  # of it, were the last keyframe where the map has it
        self._noise = np.zeros((3, 3))  # what of it is the noise of the last keyframe's returns
        self._drift = np.zeros((3, 3))  # of the last keyframe in the map, beyond the noise of its returns,
        self._kept = np.eye(3)  # and what is left of that in the pose
        self._scan: LaserScan | None = None  # the last matched one

    @property
    def trusts_odometry(self) -> bool:
        """Whether odometry predicts better than the last velocity."""
        return self._predictor.trusts_odometry

    def track(
        self, scan: LaserScan, T_odom_robot: Array | None, velocity: Array | None = None,
        heading: GyroHeading | None = None, turn_rate: float | None = None,
    ) -> TrackedScan:  # fmt: skip
        """Pose of the robot at a scan, and the scan without the robot's motion during its sweep.

        Args:
            scan: as it was recorded, with the moments of its beams where they are known.
            T_odom_robot: ``(3,)``, None where there is no odometry.
            velocity: ``(3,)`` body velocity during the sweep by odometry; without it the match tells.
            heading: by a gyro, None where there is none,
            turn_rate: and what it tells of the sweep, radians a second.
        """
        rate = self._predictor.turn_rate(turn_rate)
        if self._map is None:
            during = _at_rate(np.zeros(3) if velocity is None else velocity, rate)
            return self._first(deskew(scan, during), T_odom_robot, heading, during)
        prediction = self._predictor.predict(scan.timestamp, T_odom_robot, heading)
        increment = prediction.increment
        during = self._predictor.velocity_to(scan.timestamp, increment) if velocity is None else velocity
        during = _at_rate(during, rate)
        still = deskew(scan, during)
        if prediction.by_odometry and self._stands(increment, scan.timestamp) and not self._looks_elsewhere(still):
            predicted = se2.compose(self._T_keyframe_robot, increment)
            carried = self._carried_on(prediction)
            return TrackedScan(len(self._keyframes) - 1, predicted, False, still, during, carried)
        points = extract_points(still, self._config.cleaning)
        match = self._match(points, prediction)
        if prediction.by_odometry and not match.matched:  # odometry may be what misleads
            again = self._match(points, self._predictor.by_velocity(scan.timestamp))
            match = again if again.matched else match
        if velocity is None and scan.is_sweep:
            still, points, match, during = self._match_sweep(scan, still, points, match, prediction, during, rate)
        moved = se2.between(self._T_keyframe_robot, match.pose)
        self._predictor.moved(scan.timestamp, T_odom_robot, moved, match.information, heading)
        self._T_keyframe_robot, self._covariance, self._scan = match.pose, match.covariance, still
        self._kept = match.kept @ self._kept
        covariance = self._step_covariance()
        if self._starts_keyframe(scan.timestamp):
            self._predictor.keyframe(T_odom_robot, match.T_returns, match.information, heading)
            index = self._add_keyframe(still, points, match.of_returns)
            return TrackedScan(index, np.zeros(3), True, still, during, covariance)
        return TrackedScan(len(self._keyframes) - 1, match.pose, False, still, during, covariance)

    def _match_sweep(
        self, scan: LaserScan, still: LaserScan, points: ScanPoints, match: Match, prediction: Prediction,
        velocity: Array, rate: float | None,
    ) -> tuple[LaserScan, ScanPoints, Match, Array]:  # fmt: skip
        """Pose and motion during the sweep that agree with each other.

        A velocity that is too large takes too much motion out of the scan, so that its match lies too far back, by up
        to the whole sweep, and the next velocity is too small by as much and more: the error would grow from scan to
        scan. The velocity that leads to this very pose does not have that (an implicit step in place of an explicit
        one). A gyro tells the turn beforehand. Where the timestamp is the middle of the scan, the pose hardly depends
        on the velocity.
        """
        first, last = scan.span
        sweep, share, least = last - first, SWEEP_SHARE, SWEEP_STEADY
        centred = abs(first + last) < CENTRED * sweep
        if centred:
            sweep, share, least = 0.5 * sweep, 1.0, SWEEP_BLUR
        for _ in range(SWEEP_ROUNDS):
            if not match.matched:
                break
            found = self._predictor.velocity_to(scan.timestamp, se2.between(self._T_keyframe_robot, match.pose))
            change = share * (_at_rate(found, rate) - velocity)
            velocity = velocity + change
            still = deskew(scan, velocity)
            if sweep * (np.hypot(change[0], change[1]) + SWEEP_LEVER * abs(change[2])) < least:
                break
            points = extract_points(still, self._config.cleaning)
            match = self._match(points, prediction, match.pose if centred else None)
        return still, points, match, velocity

    def _first(
        self, scan: LaserScan, T_odom_robot: Array | None, heading: GyroHeading | None, velocity: Array
    ) -> TrackedScan:
        self._predictor.start(scan.timestamp, T_odom_robot, heading)
        points = extract_points(scan, self._config.cleaning)
        self._scan = scan
        index = self._add_keyframe(scan, points, np.zeros((3, 3)))
        return TrackedScan(index, np.zeros(3), True, scan, velocity, np.zeros((3, 3)))

    def _stands(self, increment: Array, timestamp: float) -> bool:
        """Whether the robot has hardly moved since the last matched scan, as odometry has it.

        Of scans that follow each other fast, odometry carries on over more: a match would tell no more than it.
        """
        options, before = self._config.tracking, self._scan
        assert before is not None
        more = FAST_MORE if timestamp - before.timestamp < FAST_SECONDS else 1.0
        moved = np.hypot(increment[0], increment[1])
        return bool(moved < more * options.still_distance and abs(increment[2]) < more * options.still_angle)

    def _looks_elsewhere(self, scan: LaserScan) -> bool:
        """Whether a scan differs from the last matched one as it does when the robot moves and odometry sleeps."""
        before = self._scan
        assert before is not None
        if len(before.ranges) != len(scan.ranges):
            return False
        both = np.isfinite(before.ranges) & np.isfinite(scan.ranges)
        change = np.abs(scan.ranges[both] - before.ranges[both])
        limit = CHANGE_SIGMAS * self._sensor.range_noise + self._config.tracking.still_distance
        return bool(np.count_nonzero(change > limit) > CHANGED_SHARE * max(len(change), 1))

    def _match(self, points: ScanPoints, prediction: Prediction, near: Array | None = None) -> Match:
        assert self._map is not None
        return self._matcher.match(self._map, points, self._T_keyframe_robot, self._covariance, prediction, near)

    def _step_covariance(self) -> Array:
        """``(3, 3)`` of the pose seen from the last keyframe, in its own tangent.

        The last keyframe is not quite where the map has it. Its own returns put it there with noise of their own, which
        the pose does not share once returns of its own tell it: seen from the keyframe it is off by both.
        Where returns tell nothing for a while, as along a bare corridor, keyframes drift in the map besides. The first
        match that tells corrects all of that at once: of both errors, what is not left in the pose is an error of the
        step between the two.
        """
        corrected = self._kept - se2.adjoint(se2.inverse(self._T_keyframe_robot))
        of_keyframe = self._drift + self._noise
        return np.asarray(
            self._covariance - self._kept @ self._noise @ self._kept.T + corrected @ of_keyframe @ corrected.T,
            dtype=np.float64,
        )

    def _carried_on(self, prediction: Prediction) -> Array:
        """``(3, 3)`` of the pose that odometry alone tells since the last matched scan."""
        transport = se2.adjoint(se2.inverse(prediction.increment))
        carried = transport @ self._step_covariance() @ transport.T + prediction.covariance
        return np.asarray(carried, dtype=np.float64)

    def _starts_keyframe(self, timestamp: float) -> bool:
        options = self._config.tracking
        x, y, theta = self._T_keyframe_robot
        waited = timestamp - self._keyframes[len(self._keyframes) - 1].timestamp
        return bool(
            np.hypot(x, y) >= options.keyframe_distance
            or abs(theta) >= options.keyframe_angle
            or waited >= options.keyframe_seconds
        )

    def _add_keyframe(self, scan: LaserScan, points: ScanPoints, of_returns: Array) -> int:
        step, local, path = self._T_keyframe_robot, np.zeros(3), 0.0
        information: Array = np.zeros((3, 3))
        if len(self._keyframes):
            previous = self._keyframes[len(self._keyframes) - 1]
            local = se2.compose(previous.T_local_robot, step)
            path = previous.path + float(np.hypot(step[0], step[1]))
            information = np.asarray(np.linalg.inv(self._step_covariance()), dtype=np.float64)
        index = self._keyframes.add(
            Keyframe(scan.timestamp, points, scan.T_robot_sensor, local, path, step, information)
        )
        left = self._kept @ self._drift @ self._kept.T + self._covariance - of_returns
        self._drift = (1.0 - 1.0 / self._config.tracking.map_keyframes) * left  # older keyframes leave the map
        self._T_keyframe_robot, self._covariance, self._kept = np.zeros(3), of_returns, np.eye(3)
        self._noise = of_returns
        self._map = self._maps.build(index, scan)
        return index


def _at_rate(velocity: Array, rate: float | None) -> Array:
    """A body velocity ``(3,)`` whose turn is the one that a gyro tells, if one does."""
    return velocity if rate is None else np.array([velocity[0], velocity[1], rate])
