"""The evidence for one candidate: its match, what that is worth to the graph, and how well the two agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place import Closure, Verdict, VerificationOptions, look_back, verify
from clew.scan import without_normal_noise
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.loop_candidates import Candidate
from clew.slam.loop_uncertainty import deformation
from clew.slam.places import Places, Query
from clew.slam.pose_graph import LEAST_INFORMATION
from clew.slam.sensor import SensorModel

Array = NDArray[np.float64]

FLOOR = np.diag([0.05, 0.05, 0.02]) ** 2  # covariance that any prediction has at least
UNKNOWN = 1.0  # metres; a match that is no surer along a direction is partial, though it fits at one pose best
NOISY = 2.0  # the residual of a match may be so many deviations of a return


class LoopMatcher:
    """Matches queries against older places."""

    def __init__(self, keyframes: KeyframeStore, places: Places, config: SlamConfig, sensor: SensorModel) -> None:
        self._keyframes = keyframes
        self._places = places
        self._config = config
        self._sensor = sensor

    def match(self, query: Query, candidate: Candidate) -> Closure:
        """All that a match tells; it waits if nothing speaks against it, the graph included."""
        verification = self._verification()
        submap = self._places.submap(candidate.anchor)
        worth = self._sensor.return_information(self._config.closing.information_scale)
        prior = np.linalg.inv(candidate.prior + FLOOR) / worth
        closure = verify(
            submap, query.surfels, query.source, candidate.T_predicted, candidate.centre, candidate.half_window, prior,
            candidate.similarity, verification, self._sensor.alignment, may_slide=candidate.may_slide,
        )  # fmt: skip
        if closure.verdict is not Verdict.WAITING:
            return closure
        closure = look_back(closure, submap, self._places.submap_of(query.source, query.members), verification)
        of_returns, information = closure.information, self._information(closure, candidate)
        closure = replace(closure, information=information, is_certain=candidate.is_certain)
        if not closure.is_partial and np.linalg.eigvalsh(np.linalg.inv(information)[:2, :2])[1] > UNKNOWN**2:
            partial = replace(closure, is_partial=True, information=of_returns)
            closure = replace(partial, information=self._information(partial, candidate))
            if not candidate.may_slide and closure.verdict is Verdict.WAITING:
                return replace(closure, verdict=Verdict.AMBIGUOUS)
        return self._gate(closure, candidate)

    def _information(self, closure: Closure, candidate: Candidate) -> Array:
        """What a match is worth to the graph: that of its returns, and of the ways along which they were seen.

        Where a partial closure is along its line only the prediction tells; if the line is askew by the bend of what
        was matched, it is off across that line by so much as well.
        """
        worth = self._sensor.return_information(self._config.closing.information_scale)
        of_returns = without_normal_noise(closure.information, self._sensor.normal_variance)
        information = worth * of_returns + LEAST_INFORMATION
        bent = deformation(self._keyframes, closure, self._config.closing)
        if closure.is_partial:
            bent[:2, :2] += bent[2, 2] * np.trace(candidate.covariance[:2, :2]) * np.eye(2)
        return np.asarray(np.linalg.inv(np.linalg.inv(information) + bent), dtype=np.float64)

    def _gate(self, closure: Closure, candidate: Candidate) -> Closure:
        """Agreement with the graph: the innovation against its covariance."""
        error = se2.between(candidate.T_predicted, closure.T_target_source)
        distance = float(error @ np.linalg.solve(candidate.covariance + FLOOR, error))
        disagrees = closure.verdict is Verdict.WAITING and distance > self._config.closing.gate
        return replace(closure, distance=distance, verdict=Verdict.DISAGREES if disagrees else closure.verdict)

    def _verification(self) -> VerificationOptions:
        """The limits, the one on residuals no tighter than the noise of returns allows."""
        options = self._config.verification
        return replace(options, rms=max(options.rms, NOISY * self._sensor.return_deviation))
