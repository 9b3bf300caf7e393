"""Noise parameters from the data: expectation maximisation with the engine's marginals.

Dempster, Laird, Rubin 1977: the expected square of an error is its square at the solution plus its variance there, so
a parameter does not look smaller than it is because the solution was fitted to the data. Plain steps of it are slow
where the variance is most of that, as it is for odometry between sightings; dividing the squares by the redundancy,
what the variance leaves of the degrees of freedom (Förstner 1979), has the same fixed points and gets there in a few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from clew.graph import Factor
from clew.motion import VelocityNoise
from clew.slam.landmarks.graph import RobotFactors
from clew.slam.landmarks.linearised import Linearised
from clew.slam.landmarks.model import MarkNoise, Marks, ScaleDrift, SensorModel, SightingNoise
from clew.slam.landmarks.pull import pull_of_motion, pull_of_sightings
from clew.slam.landmarks.student import mean_over_open
from clew.slam.landmarks.track import TAIL
from clew.solve import Solution

Array = NDArray[np.float64]

_LARGEST_CHANGE = 2.0  # of a deviation in one step
_CAUTION = 5.0  # degrees of freedom that say in each step that nothing changes; little redundancy tells little
_LEAST_REDUNDANCY, _LEAST_SIGHTING_REDUNDANCY = 1e-3, 0.2  # shares
_FEWEST_MARKS = 3
_MOST_GROWTH = 3.0  # times the errors of near ranges, at the median of ranges
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
        bias = _deviations(solution, biases, (old.range_bias, old.bearing_bias))
        distance, growth = _range_noise(ranges, old)
        noise.append(SightingNoise(distance, _scale(bearings, old.bearing), *bias, growth))
        drawn += pull_of_sightings(ranges, bearings, factors.shares if pair is factors.sightings else 0.0)
    return replace(model, motion=VelocityNoise(**deviations), drift=ScaleDrift(speed, turn), landmarks=noise[0],
                   robots=noise[1], pull=drawn)  # fmt: skip


def reestimate_marks(solution: Solution, apart: Sequence[Factor], marks: Marks) -> Marks:
    """How much marks differ, from what the solution has set them apart by."""
    pairs = zip(apart, (marks.landmarks, marks.robots), strict=True)
    return Marks(*(_differing(solution, prior, old) for prior, old in pairs))


def _differing(solution: Solution, prior: Factor, old: MarkNoise) -> MarkNoise:
    """Deviations of marks about their mean, which nothing tells from the size of the map and the camera's mounting."""
    count = len(prior)
    if count < _FEWEST_MARKS:
        return old
    values = Linearised(solution, prior).values[0]
    joint = solution.joint_covariance(prior.keys[:, 0]).reshape(count, 2, count, 2)
    variance = np.einsum("ikik->k", joint) - np.einsum("ikjk->k", joint) / count
    before = np.array([old.share, old.turn])
    square = np.sum(np.square(values - values.mean(axis=0)), axis=0) / before**2
    redundancy = np.maximum(count - 1.0 - variance / before**2, 0.0)
    share, turn = (before * np.sqrt((square + _CAUTION) / (redundancy + _CAUTION))).tolist()
    return MarkNoise(max(share, _LEAST_DEVIATION), max(turn, _LEAST_DEVIATION))


def _deviations(solution: Solution, factor: Factor, old: tuple[float, float]) -> tuple[float, float]:
    """Standard deviations of points about zero, whose prior is the factor."""
    at = Linearised(solution, factor)
    weight = np.einsum("nii->ni", factor.information)
    square = np.sum(weight * np.square(at.error), axis=0)
    redundancy = np.maximum(len(at.error) - np.sum(weight * np.einsum("nii->ni", at.covariance()), axis=0), 0.0)
    ratio = np.sqrt((square + _CAUTION) / (redundancy + _CAUTION))
    first, second = (old * ratio).tolist()
    return max(first, _LEAST_DEVIATION), max(second, _LEAST_DEVIATION)


def _range_noise(at: Linearised, old: SightingNoise) -> tuple[float, float]:
    """Scale of the errors of near ranges, and their growth: the likeliest, searched for over the growth."""
    distance = at.factor.measurement[:, 0]
    scale = old.range * old.larger(distance)
    square, redundancy = _weighed_squares(at, scale)
    square = square * scale**2

    def scale_at(larger: Array) -> float:
        return float(np.sqrt(np.mean(square / larger**2) / np.mean(redundancy)))

    def cost(growth: float) -> float:
        larger = replace(old, growth=growth).larger(distance)
        logarithm = np.log(scale_at(larger) * larger)
        return float(np.sum(2.0 * redundancy * logarithm))

    most = _MOST_GROWTH / float(np.median(distance)) ** 2
    growth = float(minimize_scalar(cost, bounds=(0.0, most), method="bounded", options={"xatol": 1e-3 * most}).x)
    return max(scale_at(replace(old, growth=growth).larger(distance)), _LEAST_RANGE), growth


def _scale(at: Linearised, old: float) -> float:
    """Scale of the errors of bearings."""
    square, redundancy = _weighed_squares(at, np.full(len(at.error), old))
    return max(old * float(np.sqrt(np.mean(square) / np.mean(redundancy))), _LEAST_BEARING)


def _weighed_squares(at: Linearised, scale: Array) -> tuple[Array, Array]:
    """Squares ``(M,)`` of sightings over their scales, and their redundancies: equal in the mean at the right scale.

    The scale of Student's t distribution (Liu and Rubin 1995, "ML estimation of the t distribution using EM") is that
    over which squares, weighed, are 1 in the mean over the errors and what is left open of each.
    """

    def weighed(error: Array) -> Array:
        square: Array = np.square(error / scale[:, None])
        return square * (TAIL + 1.0) / (TAIL + square)

    square = weighed(at.error)[:, 0]
    return square, np.maximum(1.0 - (mean_over_open(at, weighed) - square), _LEAST_SIGHTING_REDUNDANCY)
