"""The front end: where is the robot against the last few keyframes?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.scan import (
    IndexedClouds,
    LaserScan,
    LikelihoodPyramid,
    ScanPoints,
    SourceClouds,
    align,
    build_pyramid,
    correlate,
    extract_points,
    index_cloud,
    merge_surfels,
)
from clew.slam.config import SlamConfig
from clew.slam.keyframes import Keyframe, KeyframeStore

Array = NDArray[np.float64]

PYRAMID_LEVELS = 5
THINNING = 0.1  # metres; the correlative search needs the shape of a scan, not each return
LEAST_POINTS = 10
TINY = 1e-9
SLIP_FREEDOM = 3.0  # degrees of freedom of the distribution of odometry's errors


@dataclass(frozen=True)
class TrackedScan:
    """Where the robot was at a scan.

    Attributes:
        keyframe: index of the keyframe that the pose is relative to.
        T_keyframe_robot: ``(3,)``.
        is_keyframe: whether the scan became that keyframe.
    """

    keyframe: int
    T_keyframe_robot: Array
    is_keyframe: bool


@dataclass(frozen=True)
class _LocalMap:
    index: IndexedClouds
    pyramid: LikelihoodPyramid


class Tracker:
    """Matches scans against a map of recent keyframes and decides when a scan becomes a keyframe.

    The pose is tracked relative to the last keyframe, with its covariance: odometry adds uncertainty, returns take it
    away in the directions that they measure. Along a bare corridor only odometry is left, and the covariance says so.
    """

    def __init__(self, keyframes: KeyframeStore, config: SlamConfig) -> None:
        self._keyframes = keyframes
        self._config = config
        self._map: _LocalMap | None = None
        self._T_keyframe_robot = np.zeros(3)  # at the last matched scan
        self._covariance = np.zeros((3, 3))
        self._timestamp = 0.0
        self._T_odom_robot: Array | None = None
        self._velocity = np.zeros(3)  # body velocity between the last two matched scans

    def track(self, scan: LaserScan, T_odom_robot: Array | None) -> TrackedScan:
        """Pose of the robot at a scan; `T_odom_robot` is None where there is no odometry."""
        if self._map is None:
            return self._first(scan, T_odom_robot)
        increment, noise = self._motion(scan.timestamp, T_odom_robot)
        predicted = se2.compose(self._T_keyframe_robot, increment)
        options = self._config.tracking
        moved = np.hypot(increment[0], increment[1]) >= options.still_distance
        if T_odom_robot is not None and not moved and abs(increment[2]) < options.still_angle:
            return TrackedScan(len(self._keyframes) - 1, predicted, False)
        transport = se2.adjoint(se2.inverse(increment))
        prior = transport @ self._covariance @ transport.T + noise
        points = extract_points(scan, self._config.cleaning)
        pose, covariance = self._match(points, increment, predicted, prior)
        self._remember(scan.timestamp, T_odom_robot, pose)
        self._T_keyframe_robot, self._covariance = pose, covariance
        if self._starts_keyframe(scan.timestamp):
            return TrackedScan(self._add_keyframe(scan, points), np.zeros(3), True)
        return TrackedScan(len(self._keyframes) - 1, pose, False)

    def _first(self, scan: LaserScan, T_odom_robot: Array | None) -> TrackedScan:
        self._remember(scan.timestamp, T_odom_robot, np.zeros(3))
        self._velocity = np.zeros(3)
        points = extract_points(scan, self._config.cleaning)
        return TrackedScan(self._add_keyframe(scan, points), np.zeros(3), True)

    def _motion(self, timestamp: float, T_odom_robot: Array | None) -> tuple[Array, Array]:
        """Motion since the last matched scan, with its covariance."""
        options = self._config.tracking
        seconds = max(timestamp - self._timestamp, 1e-3)
        if T_odom_robot is not None and self._T_odom_robot is not None:
            increment = se2.between(self._T_odom_robot, T_odom_robot)
            if np.hypot(increment[0], increment[1]) <= options.fastest * max(seconds, options.carry_on):
                return increment, self._config.odometry.covariance(increment)
        translation, rotation = (sigma * seconds for sigma in options.velocity_sigmas)
        ahead = se2.exp(self._velocity * min(seconds, options.carry_on))
        return ahead, np.diag([translation**2, translation**2, rotation**2])

    def _remember(self, timestamp: float, T_odom_robot: Array | None, pose: Array) -> None:
        seconds = timestamp - self._timestamp
        if seconds > TINY:
            self._velocity = se2.log(se2.between(self._T_keyframe_robot, pose)) / seconds
        self._timestamp, self._T_odom_robot = timestamp, T_odom_robot

    def _match(self, points: ScanPoints, increment: Array, predicted: Array, prior: Array) -> tuple[Array, Array]:
        """Pose and covariance from the prediction and the returns; the prediction where they do not tell."""
        assert self._map is not None
        if len(points) < LEAST_POINTS:
            return predicted, prior
        options = self._config.tracking
        sigmas = np.sqrt(np.diag(prior))
        half = np.maximum(options.window_sigmas * sigmas, options.window_floor) + self._stuck(increment)
        half = np.minimum(half, options.window_ceiling)
        coarse = correlate(
            self._map.pyramid, merge_surfels(points, THINNING).points, predicted, half,
            prior_sigmas=sigmas, prior_weight=options.prior_weight,
        )  # fmt: skip
        start = predicted if coarse is None else coarse.T_target_source
        prior_information = np.asarray(self._slip(predicted, start, prior) * np.linalg.inv(prior), dtype=np.float64)
        fine = align(
            self._map.index, SourceClouds.single(points), np.zeros((1, 2), dtype=np.int32), start[None],
            T_prior=predicted[None], prior_information=prior_information[None] / options.return_weight,
            options=self._config.alignment,
        )  # fmt: skip
        if fine.overlap[0] < options.overlap:
            return predicted, prior
        information = options.information_scale * fine.information[0] + prior_information
        return fine.T_target_source[0], np.linalg.inv(information)

    @staticmethod
    def _stuck(increment: Array) -> Array:
        """What the window grows by, so that a robot whose wheels turned while it stood is found where it stood.

        The other way round, odometry that comes late shows no motion first and then all of it at once.
        """
        distance = np.hypot(increment[0], increment[1])
        return np.array([distance, distance, 0.5 * abs(increment[2])])

    @staticmethod
    def _slip(predicted: Array, matched: Array, prior: Array) -> float:
        """Weight of a prediction that the search contradicts: wheels slip, so odometry's errors have heavy tails.

        It is that of a Student's t distribution (Lange, Little, Taylor 1989).
        """
        error = se2.between(predicted, matched)
        squared = float(error @ np.linalg.solve(prior, error))
        return (SLIP_FREEDOM + 3) / (SLIP_FREEDOM + max(squared, 3.0))

    def _starts_keyframe(self, timestamp: float) -> bool:
        options = self._config.tracking
        x, y, theta = self._T_keyframe_robot
        waited = timestamp - self._keyframes[len(self._keyframes) - 1].timestamp
        return bool(
            np.hypot(x, y) >= options.keyframe_distance
            or abs(theta) >= options.keyframe_angle
            or waited >= options.keyframe_seconds
        )

    def _add_keyframe(self, scan: LaserScan, points: ScanPoints) -> int:
        step, local, path = self._T_keyframe_robot, np.zeros(3), 0.0
        information: Array = np.zeros((3, 3))
        if len(self._keyframes):
            previous = self._keyframes[len(self._keyframes) - 1]
            local = se2.compose(previous.T_local_robot, step)
            path = previous.path + float(np.hypot(step[0], step[1]))
            information = np.asarray(np.linalg.inv(self._covariance), dtype=np.float64)
        index = self._keyframes.add(
            Keyframe(scan.timestamp, points, scan.T_robot_sensor, local, path, step, information)
        )
        self._T_keyframe_robot, self._covariance = np.zeros(3), np.zeros((3, 3))
        self._map = self._build_map(index)
        return index

    def _build_map(self, index: int) -> _LocalMap:
        options = self._config.tracking
        members = self._keyframes.between(index + 1 - options.map_keyframes, index + 1)
        surfels = self._keyframes.surfels(index, members, options.voxel)
        pyramid = build_pyramid(
            surfels.points, resolution=options.resolution, sigma=options.sigma, levels=PYRAMID_LEVELS
        )
        return _LocalMap(index_cloud(surfels), pyramid)
