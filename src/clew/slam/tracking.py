"""The front end: where is the robot against the last few keyframes?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place import surfels_of
from clew.scan import (
    IndexedClouds,
    LaserScan,
    LikelihoodPyramid,
    ScanPoints,
    SourceClouds,
    align,
    build_pyramid,
    correlate,
    deskew,
    extract_points,
    fill_surfaces,
    index_cloud,
    merge_surfels,
    with_new_partners,
    without_normal_noise,
)
from clew.slam.config import SlamConfig
from clew.slam.keyframes import Keyframe, KeyframeStore
from clew.slam.prediction import MotionPredictor, Prediction
from clew.slam.sensor import SensorModel

Array = NDArray[np.float64]

PYRAMID_LEVELS = 5
THINNING = 0.1  # metres; the correlative search needs the shape of a scan, not each return
LEAST_POINTS = 10
ELSEWHERE = 1.5  # the search has left the prediction when it ended so many times `prior_floor` away
LITTLE_SLIP = 0.7  # a prediction of more weight is left as it is
FAST_SECONDS = 0.06  # a scan so soon after the last matched one is matched only where the robot has moved
FAST_MORE = 2.5  # times as far as one that stands may have
CHANGE_SIGMAS = 5.0  # of the range noise; a return that differs by more, and by more than the robot may move unseen,
CHANGED_SHARE = 0.05  #   on so many of the beams, shows that the robot moves
SLIP_FREEDOM = 3.0  # degrees of freedom of the distribution of odometry's errors
SWEEP_ROUNDS = 3  # matches at most that find pose and motion during the sweep together,
SWEEP_SHARE = 0.6  # by so much of the difference at a time,
SWEEP_STEADY = 0.002  # until what is still to be moved in a sweep is less, metres, and a hundredth of a radian for 5 m
SWEEP_LEVER = 5.0  # metres


@dataclass(frozen=True)
class TrackedScan:
    """Where the robot was at a scan.

    Attributes:
        keyframe: index of the keyframe that the pose is relative to.
        T_keyframe_robot: ``(3,)``.
        is_keyframe: whether the scan became that keyframe.
        scan: as it would have been measured all at once, at its timestamp.
        covariance: ``(3, 3)`` of the pose seen from the keyframe that it was tracked against, in its own tangent.
    """

    keyframe: int
    T_keyframe_robot: Array
    is_keyframe: bool
    scan: LaserScan
    covariance: Array


@dataclass(frozen=True)
class _LocalMap:
    index: IndexedClouds
    pyramid: LikelihoodPyramid


@dataclass(frozen=True)
class _Match:
    """Pose seen from the last keyframe.

    Attributes:
        pose: ``(3,)`` by returns and prediction,
        covariance: ``(3, 3)`` of it.
        T_returns: ``(3,)`` by the returns alone; astray where they do not tell.
        information: ``(3, 3)`` of the returns alone.
        of_returns: ``(3, 3)`` the part of `covariance` that comes from the noise of this scan's returns: what is next
            measured from here bears it too.
        kept: ``(3, 3)`` what the returns leave of an error of the last pose in the map, seen from this one.
    """

    pose: Array
    covariance: Array
    T_returns: Array
    information: Array
    of_returns: Array
    kept: Array

    @property
    def matched(self) -> bool:
        """Whether returns have a say in the pose."""
        return bool(self.information.any())


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
        self._map: _LocalMap | None = None
        self._surfaces: dict[int, ScanPoints] = {}  # those of the keyframes in the map, filled
        self._T_keyframe_robot = np.zeros(3)  # at the last matched scan
        self._covariance = np.zeros((3, 3))  # of it, were the last keyframe where the map has it
        self._drift = np.zeros((3, 3))  # of the last keyframe in the map, beyond the noise of its returns,
        self._kept = np.eye(3)  # and what is left of that in the pose
        self._scan: LaserScan | None = None  # the last matched one

    @property
    def trusts_odometry(self) -> bool:
        """Whether odometry predicts better than the last velocity."""
        return self._predictor.trusts_odometry

    def track(self, scan: LaserScan, T_odom_robot: Array | None, velocity: Array | None = None) -> TrackedScan:
        """Pose of the robot at a scan, and the scan without the robot's motion during its sweep.

        Args:
            scan: as it was recorded.
            T_odom_robot: ``(3,)``, None where there is no odometry.
            velocity: ``(3,)`` body velocity during the sweep by odometry; without it the match tells.
        """
        still = deskew(scan, self._predictor.velocity if velocity is None else velocity)
        if self._map is None:
            return self._first(still, T_odom_robot)
        prediction = self._predictor.predict(scan.timestamp, T_odom_robot)
        increment = prediction.increment
        if prediction.by_odometry and self._stands(increment, scan.timestamp) and not self._looks_elsewhere(still):
            predicted = se2.compose(self._T_keyframe_robot, increment)
            return TrackedScan(len(self._keyframes) - 1, predicted, False, still, self._step_covariance())
        points = extract_points(still, self._config.cleaning)
        match = self._match(points, prediction)
        if prediction.by_odometry and not match.matched:  # odometry may be what misleads
            again = self._match(points, self._predictor.by_velocity(scan.timestamp))
            match = again if again.matched else match
        if velocity is None and scan.time_increment > 0.0:
            still, points, match = self._match_sweep(scan, still, points, match, prediction)
        moved = se2.between(self._T_keyframe_robot, match.pose)
        self._predictor.moved(scan.timestamp, T_odom_robot, moved, match.information)
        self._T_keyframe_robot, self._covariance, self._scan = match.pose, match.covariance, still
        self._kept = match.kept @ self._kept
        covariance = self._step_covariance()
        if self._starts_keyframe(scan.timestamp):
            self._predictor.keyframe(T_odom_robot, match.T_returns, match.information)
            index = self._add_keyframe(still, points, match.of_returns)
            return TrackedScan(index, np.zeros(3), True, still, covariance)
        return TrackedScan(len(self._keyframes) - 1, match.pose, False, still, covariance)

    def _match_sweep(
        self, scan: LaserScan, still: LaserScan, points: ScanPoints, match: _Match, prediction: Prediction
    ) -> tuple[LaserScan, ScanPoints, _Match]:
        """Pose and motion during the sweep that agree with each other.

        A velocity that is too large takes too much motion out of the scan, so that its match lies too far back, by up
        to the whole sweep, and the next velocity is too small by as much and more: the error would grow from scan to
        scan. The velocity that leads to this very pose does not have that (an implicit step in place of an explicit
        one).
        """
        sweep = scan.time_increment * len(scan.ranges)
        velocity = self._predictor.velocity
        for _ in range(SWEEP_ROUNDS):
            if not match.matched:
                break
            found = self._predictor.velocity_to(scan.timestamp, se2.between(self._T_keyframe_robot, match.pose))
            change = SWEEP_SHARE * (found - velocity)
            velocity = velocity + change
            still = deskew(scan, velocity)
            if sweep * (np.hypot(change[0], change[1]) + SWEEP_LEVER * abs(change[2])) < SWEEP_STEADY:
                break
            points = extract_points(still, self._config.cleaning)
            match = self._match(points, prediction)
        return still, points, match

    def _first(self, scan: LaserScan, T_odom_robot: Array | None) -> TrackedScan:
        self._predictor.start(scan.timestamp, T_odom_robot)
        points = extract_points(scan, self._config.cleaning)
        self._scan = scan
        index = self._add_keyframe(scan, points, np.zeros((3, 3)))
        return TrackedScan(index, np.zeros(3), True, scan, np.zeros((3, 3)))

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

    def _match(self, points: ScanPoints, prediction: Prediction) -> _Match:
        """Pose and covariance from the prediction and the returns; the prediction where they do not tell."""
        assert self._map is not None
        transport = se2.adjoint(se2.inverse(prediction.increment))
        prior = transport @ self._covariance @ transport.T + prediction.covariance
        predicted = se2.compose(self._T_keyframe_robot, prediction.increment)
        unmatched = _Match(predicted, prior, predicted, np.zeros((3, 3)), np.zeros((3, 3)), transport)
        if len(points) < LEAST_POINTS:
            return unmatched
        options = self._config.tracking
        sigmas = np.sqrt(np.diag(prior))
        half = np.maximum(options.window_sigmas * sigmas, options.window_floor) + self._surprise(prediction)
        half = np.minimum(half, options.window_ceiling)
        coarse = correlate(
            self._map.pyramid, merge_surfels(points, THINNING).points, predicted, half,
            prior_sigmas=np.maximum(sigmas, options.prior_floor), prior_weight=options.prior_weight,
        )  # fmt: skip
        start = predicted if coarse is None else coarse.T_target_source
        precision = np.asarray(np.linalg.inv(prior), dtype=np.float64)
        prior_information = precision
        if np.linalg.norm(se2.between(predicted, start) / options.prior_floor) > ELSEWHERE:
            # Far from the prediction: were it held to it, the alignment would find other partners on its way back.
            prior_information = np.linalg.inv(prior + np.diag(np.square(options.prior_floor)))
        for attempt in range(2):
            aligned = self._align(points, start, predicted, prior_information)
            if aligned is None:
                return unmatched
            pose, T_returns, information = aligned
            trust = self._slip(predicted, T_returns, prior, information)
            if attempt or (trust > LITTLE_SLIP and prior_information is precision):
                break
            start, prior_information = pose, trust * precision
        covariance = np.linalg.inv(information + prior_information)
        gain = covariance @ information
        of_returns = np.asarray(gain @ covariance @ gain.T, dtype=np.float64)
        kept = np.asarray((np.eye(3) - gain) @ transport, dtype=np.float64)
        return _Match(pose, np.asarray(covariance, dtype=np.float64), T_returns, information, of_returns, kept)

    @staticmethod
    def _surprise(prediction: Prediction) -> Array:
        """What the window grows by, so that the alternatives to the prediction lie in it."""
        away = se2.between(prediction.increment, prediction.alternatives)
        distance = float(np.hypot(away[:, 0], away[:, 1]).max())
        return np.array([distance, distance, 0.5 * float(np.abs(away[:, 2]).max())])

    def _align(
        self, points: ScanPoints, start: Array, predicted: Array, prior_information: Array
    ) -> tuple[Array, Array, Array] | None:
        """Pose by returns and prediction, pose by the returns alone, and their information; None without overlap."""
        assert self._map is not None
        worth = self._sensor.return_information(self._config.tracking.information_scale)
        source = SourceClouds.single(points)
        fine = align(
            self._map.index, source, np.zeros((1, 2), dtype=np.int32), start[None],
            T_prior=predicted[None], prior_information=prior_information[None] / worth,
            options=self._sensor.alignment,
        )  # fmt: skip
        pose = fine.T_target_source[0]
        if fine.overlap[0] < self._config.tracking.overlap:
            return None
        self._sensor.matched(float(fine.rms[0]))
        held = with_new_partners(self._map.index, source, pose, fine.information[0], self._sensor.alignment)
        information = without_normal_noise(worth * held, self._sensor.normal_variance)
        return pose, se2.compose(pose, fine.step[0]), information

    @staticmethod
    def _slip(predicted: Array, T_returns: Array, prior: Array, information: Array) -> float:
        """Weight of a prediction that the returns contradict: wheels slip, so odometry's errors have heavy tails.

        It is that of a Student's t distribution (Lange, Little, Taylor 1989). Where the returns tell nothing, as along
        a corridor, they contradict nothing.
        """
        error = se2.between(predicted, T_returns)
        # (prior + information^-1)^-1 without inverting what may be singular.
        weight = np.linalg.solve(np.eye(3) + information @ prior, information)
        squared = float(error @ weight @ error)
        return (SLIP_FREEDOM + 3) / (SLIP_FREEDOM + max(squared, 3.0))

    def _step_covariance(self) -> Array:
        """``(3, 3)`` of the pose seen from the last keyframe, in its own tangent.

        Where returns tell nothing for a while, as along a bare corridor, keyframes drift in the map. The first match
        that tells corrects all of that at once: of the drift of the last keyframe, what is not left in the pose is an
        error of the step between the two.
        """
        corrected = self._kept - se2.adjoint(se2.inverse(self._T_keyframe_robot))
        return np.asarray(self._covariance + corrected @ self._drift @ corrected.T, dtype=np.float64)

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
        self._map = self._build_map(index)
        return index

    def _build_map(self, index: int) -> _LocalMap:
        options, cleaning = self._config.tracking, self._config.cleaning
        members = self._keyframes.between(index + 1 - options.map_keyframes, index + 1)
        self._surfaces = {
            k: self._surfaces[k] if k in self._surfaces else fill_surfaces(self._keyframes[k].points, cleaning)
            for k in members.tolist()
        }
        poses = self._keyframes.relative(index, members)
        surfels = surfels_of(list(self._surfaces.values()), poses, options.voxel)
        pyramid = build_pyramid(
            surfels.points, resolution=options.resolution, sigma=options.sigma, levels=PYRAMID_LEVELS
        )
        return _LocalMap(index_cloud(surfels), pyramid)
