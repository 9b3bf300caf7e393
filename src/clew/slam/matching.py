"""One scan against the local map: pose and covariance from the returns and a prediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.scan import (
    ScanPoints,
    SourceClouds,
    align,
    correlate,
    merge_surfels,
    with_new_partners,
    without_normal_noise,
)
from clew.slam.config import SlamConfig
from clew.slam.local_map import LocalMap
from clew.slam.prediction import Prediction
from clew.slam.sensor import SensorModel

Array = NDArray[np.float64]

THINNING = 0.1  # metres; the correlative search needs the shape of a scan, not each return
LEAST_POINTS = 10
ELSEWHERE = 1.5  # the search has left the prediction when it ended so many times `prior_floor` away
LITTLE_SLIP = 0.7  # a prediction of more weight is left as it is
SLIP_FREEDOM = 3.0  # degrees of freedom of the distribution of odometry's errors

@dataclass(frozen=True)
class Match:
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


class ScanMatcher:
    """Matches scans; odometry's errors are heavy-tailed (wheels slip, readings halt)."""

    def __init__(self, config: SlamConfig, sensor: SensorModel) -> None:
        self._config = config
        self._sensor = sensor

    def match(
        self, local_map: LocalMap, points: ScanPoints, T_keyframe_last: Array, covariance: Array,
        prediction: Prediction, near: Array | None = None,
    ) -> Match:
        """Pose and covariance from the prediction and the returns; the prediction where they do not tell.

        Args:
            local_map: in the frame of the last keyframe.
            points: of the scan.
            T_keyframe_last: ``(3,)`` pose at the last matched scan,
            covariance: ``(3, 3)`` and its covariance.
            prediction: of the motion since.
            near: ``(3,)`` pose that is known to be all but right; the search is left out.
        """
        transport = se2.adjoint(se2.inverse(prediction.increment))
        prior = transport @ covariance @ transport.T + prediction.covariance
        predicted = se2.compose(T_keyframe_last, prediction.increment)
        unmatched = Match(predicted, prior, predicted, np.zeros((3, 3)), np.zeros((3, 3)), transport)
        if len(points) < LEAST_POINTS:
            return unmatched
        options = self._config.tracking
        start = self._search(local_map, points, predicted, prior, prediction) if near is None else near
        precision = np.asarray(np.linalg.inv(prior), dtype=np.float64)
        prior_information = precision
        if np.linalg.norm(se2.between(predicted, start) / options.prior_floor) > ELSEWHERE:
            # Far from the prediction: were it held to it, the alignment would find other partners on its way back.
            prior_information = np.linalg.inv(prior + np.diag(np.square(options.prior_floor)))
        for attempt in range(2):
            aligned = self._align(local_map, points, start, predicted, prior_information)
            if aligned is None:
                return unmatched
            pose, T_returns, information = aligned
            trust = self._slip(predicted, T_returns, prior, information)
            if attempt or (trust > LITTLE_SLIP and prior_information is precision):
                break
            start, prior_information = pose, trust * precision
        found = np.asarray(np.linalg.inv(information + prior_information), dtype=np.float64)
        gain = found @ information
        of_returns = np.asarray(gain @ found @ gain.T, dtype=np.float64)
        kept = np.asarray((np.eye(3) - gain) @ transport, dtype=np.float64)
        return Match(pose, found, T_returns, information, of_returns, kept)

    def _search(
        self, local_map: LocalMap, points: ScanPoints, predicted: Array, prior: Array, prediction: Prediction
    ) -> Array:
        """Where most returns lie on the map, about where the prediction has them."""
        options = self._config.tracking
        sigmas = np.sqrt(np.diag(prior))
        half = np.maximum(options.window_sigmas * sigmas, options.window_floor) + self._surprise(prediction)
        half = np.minimum(half, options.window_ceiling)
        coarse = correlate(
            local_map.pyramid, merge_surfels(points, THINNING).points, predicted, half,
            prior_sigmas=np.maximum(sigmas, options.prior_floor), prior_weight=options.prior_weight,
        )  # fmt: skip
        return predicted if coarse is None else coarse.T_target_source

    @staticmethod
    def _surprise(prediction: Prediction) -> Array:
        """What the window grows by, so that the alternatives to the prediction lie in it."""
        away = se2.between(prediction.increment, prediction.alternatives)
        distance = float(np.hypot(away[:, 0], away[:, 1]).max())
        return np.array([distance, distance, 0.5 * float(np.abs(away[:, 2]).max())])

    def _align(
        self, local_map: LocalMap, points: ScanPoints, start: Array, predicted: Array, prior_information: Array
    ) -> tuple[Array, Array, Array] | None:
        """Pose by returns and prediction, pose by the returns alone, and their information; None without overlap."""
        worth = self._sensor.return_information(self._config.tracking.information_scale)
        source, pair = SourceClouds.single(points), np.zeros((1, 2), dtype=np.int32)
        fine = align(
            local_map.index, source, pair, start[None],
            T_prior=predicted[None], prior_information=prior_information[None] / worth,
            options=self._sensor.alignment,
        )  # fmt: skip
        pose = fine.T_target_source[0]
        if fine.overlap[0] < self._config.tracking.overlap:
            return None
        self._sensor.matched(float(fine.rms[0]))
        held = with_new_partners(
            local_map.index, source, pair, fine.T_target_source, fine.information, self._sensor.alignment
        )
        clean = without_normal_noise(worth * held, self._sensor.normal_variance, source.moments())
        return pose, np.asarray(se2.retract(pose, fine.step[0])), clean[0]

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
