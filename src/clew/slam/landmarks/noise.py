"""Noise parameters from the data: expectation maximisation with the engine's marginals.

Dempster, Laird, Rubin 1977: the expected square of an error is its square at the solution plus its variance there, so
a parameter does not look smaller than it is because the solution was fitted to the data. Plain steps of it are slow
where the variance is most of that, as it is for odometry between sightings; dividing the squares by the redundancy,
what the variance leaves of the degrees of freedom (Förstner 1979), has the same fixed points and gets there in a few.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from clew.graph import Factor
from clew.motion import VelocityNoise
from clew.slam.landmarks.graph import RobotFactors
from clew.slam.landmarks.linearised import Linearised
from clew.slam.landmarks.model import ScaleDrift, SensorModel, SightingNoise
from clew.slam.landmarks.pull import pull_of_motion, pull_of_sightings
from clew.slam.landmarks.track import TAIL
from clew.solve import Solution

Array = NDArray[np.float64]

_LARGEST_CHANGE = 2.0  # of a deviation in one step
_CAUTION = 5.0  # degrees of freedom that say in each step that nothing changes; little redundancy tells little
_LEAST_REDUNDANCY, _LEAST_SIGHTING_REDUNDANCY = 1e-3, 0.2  # shares
_LEAST_MOTION, _LEAST_RANGE, _LEAST_BEARING, _LEAST_DEVIATION = 1e-5, 1e-4, 1e-5, 1e-4


def reestimate(solution: Solution, factors: RobotFactors, model: SensorModel) -> SensorModel:
    """A robot's model with noise parameters that make the errors at the solution likelier."""
    motion = Linearised(solution, factors.motion)
    squares, variance = motion.squares, motion.covariance()
    weight = factors.motion.information
    deviations = {}
    for source, entry in zip(factors.sources, fields(VelocityNoise), strict=True):
        # The likelihood is stationary where tr(W C W (S + V)) = tr(W C), summed over the motions (S: squares, V: their
        # variance): where found and due are equal.
        weighed = weight @ source @ weight
        found = np.einsum("sij,sji->", weighed, squares)
        most = np.einsum("sij,sji->", weight, source)
        due = max(most - np.einsum("sij,sji->", weighed, variance), _LEAST_REDUNDANCY * most)
        ratio = float(np.sqrt((found + _CAUTION) / (due + _CAUTION)))
        change = min(max(ratio, 1.0 / _LARGEST_CHANGE), _LARGEST_CHANGE)
        deviations[entry.name] = max(getattr(model.motion, entry.name) * change, _LEAST_MOTION)
    speed, turn = _deviations(solution, factors.drift, (model.drift.speed, model.drift.turn))
    drawn = pull_of_motion(motion)
    noise = []
    for pair, biases, old in (
        (factors.sightings, factors.biases[0], model.landmarks), (factors.mates, factors.biases[1], model.robots)
    ):  # fmt: skip
        if pair is None or biases is None:
            noise.append(old)
            continue
        ranges, bearings = (Linearised(solution, factor) for factor in pair)
        distance, angle = _scale(ranges, old.range), _scale(bearings, old.bearing)
        bias = _deviations(solution, biases, (old.range_bias, old.bearing_bias))
        noise.append(SightingNoise(max(distance, _LEAST_RANGE), max(angle, _LEAST_BEARING), *bias))
        drawn += pull_of_sightings(ranges, bearings)
    return replace(model, motion=VelocityNoise(**deviations), drift=ScaleDrift(speed, turn), landmarks=noise[0],
                   robots=noise[1], pull=drawn)  # fmt: skip


def _deviations(solution: Solution, factor: Factor, old: tuple[float, float]) -> tuple[float, float]:
    """Standard deviations of points about zero, whose prior is the factor."""
    at = Linearised(solution, factor)
    square, variance = np.einsum("nii->i", at.squares), np.einsum("nii->i", at.covariance())
    redundancy = np.maximum(len(at.error) - variance / np.square(old), 0.0)
    ratio = np.sqrt((square / np.square(old) + _CAUTION) / (redundancy + _CAUTION))
    first, second = (old * ratio).tolist()
    return max(first, _LEAST_DEVIATION), max(second, _LEAST_DEVIATION)


def _scale(at: Linearised, scale: float) -> float:
    """Scale of Student's t distribution (Liu and Rubin 1995, "ML estimation of the t distribution using EM")."""
    square = at.squares[:, 0, 0]
    weight = (TAIL + 1.0) / (TAIL + square / scale**2)
    redundancy = 1.0 - np.mean(weight * at.covariance()[:, 0, 0]) / scale**2
    return float(np.sqrt(np.mean(weight * square) / max(redundancy, _LEAST_SIGHTING_REDUNDANCY)))
