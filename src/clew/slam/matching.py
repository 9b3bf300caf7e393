"""One scan against the local map: pose and covariance from the returns and a prediction."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2, wrap
from clew.mapping import contradicted
from clew.scan import (
    ScanPoints,
    SourceClouds,
    align,
    correlate,
    merge_surfels,
    slope_share,
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
PINNED = 1e12  # information of a prior that holds a pose where it is
ELSEWHERE = 1.5  # the search has left the prediction when it ended so many times `prior_floor` away
LITTLE_SLIP = 0.7  # a prediction of more weight is left as it is
MOST_MOVED = 0.5  # share of returns that are contradicted, from which on it is the pose or the place that is another
FIRM = 4  # views of a place, or all there are, from which on what is there is known to stay
FIRM_LOST = 0.2  # share of such places at most, among those that do not fit odometry, where this is right nevertheless
SAME_HEADING = 0.02  # radians; walls tell the heading, whoever walks between them
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


@dataclass(frozen=True)
class _Registration:
    """Returns and prediction brought together.

    Attributes:
        pose: ``(3,)`` by both,
        T_returns: ``(3,)`` by the returns alone,
        information: ``(3, 3)`` of these,
        prior_information: ``(3, 3)`` of the prediction, as far as it is trusted,
        trust: which is by so much, in (0, 1].
    """

    pose: Array
    T_returns: Array
    information: Array
    prior_information: Array
    trust: float


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
        start = self._search(local_map, points, predicted, prior, prediction) if near is None else near
        seen, through = local_map.views.looks_at(points, start)
        moved = contradicted(seen, through)
        share = int(np.count_nonzero(moved)) / max(int(np.count_nonzero(seen + through)), 1)
        if share > MOST_MOVED:
            moved = np.zeros_like(moved)
        elif share > 0.0:
            points = points.select(~moved)
            if len(points) < LEAST_POINTS:
                return unmatched
        trusted = 1.0 - min(share, MOST_MOVED)
        found = self._register(local_map, points, start, predicted, prior, trusted)
        is_doubtful = found is not None and found.trust < LITTLE_SLIP and prediction.by_odometry
        if found is not None and is_doubtful and _turned_alike(found, predicted):
            firm = seen[~moved] >= min(FIRM, len(local_map.views))
            found = self._by_what_stays(local_map, points, firm, found, predicted, prior, trusted)
        if found is None:
            return unmatched
        covariance = np.asarray(np.linalg.inv(found.information + found.prior_information), dtype=np.float64)
        gain = covariance @ found.information
        of_returns = np.asarray(covariance @ found.information @ covariance, dtype=np.float64)
        kept = np.asarray((np.eye(3) - gain) @ transport, dtype=np.float64)
        return Match(found.pose, covariance, found.T_returns, found.information, of_returns, kept)

    def _by_what_stays(
        self, local_map: LocalMap, points: ScanPoints, firm: NDArray[np.bool_], found: _Registration, predicted: Array,
        prior: Array, trusted: float,
    ) -> _Registration:
        """The registration of what has been seen for long, if only what has not contradicts odometry.

        Who walks along a bare corridor beside the robot makes it seem to stand: few returns tell otherwise, for walls
        say nothing along it, though which way it runs. Where wheels slip, what has been seen for long contradicts them,
        too.

        Args:
            firm: ``(n,)`` which returns lie where several keyframes saw something.
            found: by all returns; they contradict odometry.
        """
        stays = points.select(firm)
        if len(stays) < LEAST_POINTS:
            return found
        again = self._register(local_map, stays, predicted, predicted, prior, trusted)
        if again is None or again.trust < LITTLE_SLIP or not _turned_alike(again, found.pose):
            return found
        lost, of_firm = (
            len(cloud) * (self._explained(local_map, cloud, found.pose) - self._explained(local_map, cloud, again.pose))
            for cloud in (points, stays)
        )
        return again if of_firm <= FIRM_LOST * max(lost, 0.0) else found

    def _explained(self, local_map: LocalMap, points: ScanPoints, pose: Array) -> float:
        """Share of returns that have a partner in the map at a pose."""
        at = align(
            local_map.index, SourceClouds.single(points), np.zeros((1, 2), dtype=np.int32), pose[None],
            prior_information=PINNED * np.eye(3)[None],
            options=replace(self._sensor.alignment, radius_start=self._sensor.alignment.radius_end, iterations=1),
        )  # fmt: skip
        return float(at.overlap[0])

    def _register(
        self, local_map: LocalMap, points: ScanPoints, start: Array, predicted: Array, prior: Array, trusted: float
    ) -> _Registration | None:
        """Returns and prediction, the latter weighed by how well the returns agree with it; None without overlap."""
        precision = np.asarray(np.linalg.inv(prior), dtype=np.float64)
        prior_information = precision
        if np.linalg.norm(se2.between(predicted, start) / self._config.tracking.prior_floor) > ELSEWHERE:
            # Far from the prediction: were it held to it, the alignment would find other partners on its way back.
            prior_information = np.linalg.inv(prior + np.diag(np.square(self._config.tracking.prior_floor)))
        trust = 1.0
        for attempt in range(2):
            aligned = self._align(local_map, points, start, predicted, prior_information, trusted)
            if aligned is None:
                return None
            pose, T_returns, information = aligned
            trust = self._slip(predicted, T_returns, prior, information)
            if attempt or (trust > LITTLE_SLIP and prior_information is precision):
                break
            start, prior_information = pose, trust * precision
        return _Registration(pose, T_returns, information, prior_information, trust)

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
        self, local_map: LocalMap, points: ScanPoints, start: Array, predicted: Array, prior_information: Array,
        trusted: float,
    ) -> tuple[Array, Array, Array] | None:
        """Pose by returns and prediction, pose by the returns alone, and their information; None without overlap.

        Where returns contradict what was seen before, more of them move than can be told: those that are left are
        worth the share that is `trusted`, so that the information falls with its square (Huber, "Robust Statistics",
        1981: the variance of an estimate by residuals of which a share is astray).
        """
        source, pair = SourceClouds.single(points), np.zeros((1, 2), dtype=np.int32)
        options, noise = self._sensor.alignment, self._sensor.matches
        fine = align(
            local_map.index, source, pair, start[None],
            T_prior=predicted[None], prior_information=prior_information[None] / (trusted * noise.worth),
            options=options,
        )  # fmt: skip
        if fine.overlap[0] < self._config.tracking.overlap:
            return None
        noise.add(fine)
        if noise.wants_slope():
            share = slope_share(local_map.index, source, pair, fine.T_target_source, fine.information, options)
            noise.add_slope(float(share[0]))
        held = with_new_partners(
            local_map.index, source, pair, fine.T_target_source, fine.information, options,
            worth=trusted * self._sensor.match_information(fine)[None], already=noise.slope,
        )  # fmt: skip
        information = without_normal_noise(held, self._sensor.normal_variance, source.moments())[0]
        # The alignment weighed the prediction against returns as they are in the mean, not against what each direction
        # of them is worth: along a bare corridor it followed noise of the normals.
        pose, step = fine.T_target_source[0], fine.step[0]
        gradient = information @ step + prior_information @ se2.between(pose, predicted)
        fused = se2.retract(pose, np.linalg.solve(information + prior_information, gradient))
        return np.asarray(fused), np.asarray(se2.retract(pose, step)), information

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


def _turned_alike(found: _Registration, pose: Array) -> bool:
    return bool(abs(wrap(found.pose[2] - pose[2])) <= SAME_HEADING)
