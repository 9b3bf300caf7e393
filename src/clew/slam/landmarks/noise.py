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

from clew.factors import CalibratedBearing, CalibratedRange
from clew.graph import Factor
from clew.motion import VelocityNoise
from clew.slam.landmarks.graph import RobotFactors
from clew.slam.landmarks.model import ScaleDrift, SensorModel, SightingNoise
from clew.slam.landmarks.track import TAIL
from clew.solve import Solution

Array = NDArray[np.float64]

_LARGEST_CHANGE = 2.0  # of a deviation in one step
_CAUTION = 5.0  # degrees of freedom that say in each step that nothing changes; little redundancy tells little
_LEAST_REDUNDANCY, _LEAST_SIGHTING_REDUNDANCY = 1e-3, 0.2  # shares
_LEAST_MOTION, _LEAST_RANGE, _LEAST_BEARING, _LEAST_DEVIATION = 1e-5, 1e-4, 1e-5, 1e-4


def reestimate(solution: Solution, factors: RobotFactors, model: SensorModel) -> SensorModel:
    """A robot's model with noise parameters that make the errors at the solution likelier."""
    error, expected = expected_squares(solution, factors.motion)
    squares = error[:, :, None] * error[:, None, :]
    weight = factors.motion.information
    deviations = {}
    for source, entry in zip(factors.sources, fields(VelocityNoise), strict=True):
        # The likelihood is stationary where tr(W C W (S + V)) = tr(W C), summed over the motions (S: squares, V: their
        # variance): where found and due are equal.
        weighed = weight @ source @ weight
        found = np.einsum("sij,sji->", weighed, squares)
        most = np.einsum("sij,sji->", weight, source)
        due = most - np.einsum("sij,sji->", weighed, expected - squares)
        due = max(due, _LEAST_REDUNDANCY * most)
        ratio = float(np.sqrt((found + _CAUTION) / (due + _CAUTION)))
        change = min(max(ratio, 1.0 / _LARGEST_CHANGE), _LARGEST_CHANGE)
        deviations[entry.name] = max(getattr(model.motion, entry.name) * change, _LEAST_MOTION)
    landmarks = _sighting_noise(solution, factors.sightings, factors.biases[0], model.landmarks)
    robots = model.robots
    if factors.mates is not None and factors.biases[1] is not None:
        robots = _sighting_noise(solution, factors.mates, factors.biases[1], model.robots)
    speed, turn = _deviations(solution, factors.drift, (model.drift.speed, model.drift.turn))
    return replace(model, motion=VelocityNoise(**deviations), drift=ScaleDrift(speed, turn), landmarks=landmarks,
                   robots=robots, pull=pull(solution, factors))  # fmt: skip


def _deviations(solution: Solution, factor: Factor, old: tuple[float, float]) -> tuple[float, float]:
    """Standard deviations of points about zero, whose prior is the factor."""
    error, expected = expected_squares(solution, factor)
    square = np.sum(error**2, axis=0)
    variance = np.einsum("nii->i", expected) - square
    redundancy = np.maximum(len(error) - variance / np.square(old), 0.0)
    ratio = np.sqrt((square / np.square(old) + _CAUTION) / (redundancy + _CAUTION))
    first, second = (old * ratio).tolist()
    return max(first, _LEAST_DEVIATION), max(second, _LEAST_DEVIATION)


def _sighting_noise(
    solution: Solution, pair: tuple[Factor, Factor], biases: Factor, noise: SightingNoise
) -> SightingNoise:
    distance, angle = _scale(solution, pair[0], noise.range), _scale(solution, pair[1], noise.bearing)
    bias = _deviations(solution, biases, (noise.range_bias, noise.bearing_bias))
    return SightingNoise(max(distance, _LEAST_RANGE), max(angle, _LEAST_BEARING), *bias)


def _scale(solution: Solution, factor: Factor, scale: float) -> float:
    """Scale of Student's t distribution (Liu and Rubin 1995, "ML estimation of the t distribution using EM")."""
    error, expected = expected_squares(solution, factor)
    square = error[:, 0] ** 2
    weight = (TAIL + 1.0) / (TAIL + square / scale**2)
    redundancy = 1.0 - np.mean(weight * (expected[:, 0, 0] - square)) / scale**2
    return float(np.sqrt(np.mean(weight * square) / max(redundancy, _LEAST_SIGHTING_REDUNDANCY)))


def expected_squares(solution: Solution, factor: Factor) -> tuple[Array, Array]:
    """Residuals ``(M, d)`` at the solution, and their expected outer products ``(M, d, d)`` under its covariance."""
    parts = Linearised(solution, factor)
    everything = range(len(factor.kinds))
    return parts.error, parts.error[:, :, None] * parts.error[:, None, :] + parts.covariance(everything)


def leverages(solution: Solution, factor: Factor, given: Sequence[int]) -> Array:
    """Share ``(M, d)`` of each residual that the variables take up, those at the positions `given` being known."""
    parts = Linearised(solution, factor)
    open_ones = [k for k in range(len(factor.kinds)) if k not in given]
    spread = parts.covariance(open_ones)
    across = parts.between(open_ones, given)
    known = parts.block(given, given)
    spread -= across @ np.linalg.solve(known, np.swapaxes(across, 1, 2))
    weight = factor.information
    if factor.kernel is not None:
        cost = np.einsum("ni,nij,nj->n", parts.error, weight, parts.error)
        weight = weight * factor.kernel.weight(cost)[:, None, None]
    shares: Array = np.einsum("nij,nji->ni", weight, spread)
    return shares


class Linearised:
    """A factor at a solution, with the covariances of its variables."""

    def __init__(self, solution: Solution, factor: Factor) -> None:
        problem, self._factor = solution.posterior.problem, solution.posterior.factor
        kinds = [table.kind for table in problem.tables]
        values, self._columns = [], []
        for position, kind in enumerate(factor.kinds):
            table = kinds.index(kind)
            order = np.argsort(problem.tables[table].keys)
            rows = order[np.searchsorted(problem.tables[table].keys, factor.keys[:, position], sorter=order)]
            values.append(solution.posterior.values[table][rows])
            self._columns.append(problem.columns[table][rows].astype(np.int64))
        self._dims = [kind.dim for kind in factor.kinds]
        self.values = values
        self.error, self.jacobians = factor.linearise(*values)

    def block(self, rows: Sequence[int], columns: Sequence[int]) -> Array:
        """Covariance ``(M, p, q)`` of the variables at some positions with those at others."""
        return np.concatenate([
            np.concatenate([self._pair(i, j) for j in columns], axis=2) for i in rows
        ], axis=1)  # fmt: skip

    def between(self, rows: Sequence[int], columns: Sequence[int]) -> Array:
        """Covariance ``(M, d, q)`` of what some variables make of the residual with the others."""
        return np.concatenate([self.jacobians[i] for i in rows], axis=2) @ self.block(rows, columns)

    def covariance(self, positions: Sequence[int]) -> Array:
        """Covariance ``(M, d, d)`` of the residual from the variables at some positions."""
        total = np.zeros((*self.error.shape, self.error.shape[1]))
        for i in positions:
            for j in positions:
                total += self.jacobians[i] @ self._pair(i, j) @ np.swapaxes(self.jacobians[j], 1, 2)
        return total

    def _pair(self, i: int, j: int) -> Array:
        first, second = self._columns[i], self._columns[j]
        free = np.flatnonzero((first >= 0) & (second >= 0))
        out = np.zeros((len(first), self._dims[i], self._dims[j]))
        pairs = np.stack([first[free], second[free]], axis=1)
        out[free] = self._factor.marginal_blocks(pairs).reshape(len(free), self._dims[i], self._dims[j])
        return out


def pull(solution: Solution, factors: RobotFactors) -> Array:
    """What the calibration ``(7, 2)`` is drawn by beside the cost at the solution, as a derivative of half the cost.

    Likelihood integrates over where robot and landmarks may have been, the solution only has the likeliest places. The
    difference is half the logarithm of the determinant of their information (Laplace's method): calibrations that let
    measurements say more about places are not therefore likelier. The more a measurement is stretched, the more it
    says; the derivative is its leverage times that of the logarithm of the stretch.
    """
    out = np.zeros((7, 2))
    for pair in (factors.sightings, factors.mates):
        if pair is not None:
            out += _pull_of_sightings(solution, *pair)
    motion = factors.motion
    unit = 1.0 + Linearised(solution, motion).values[2][0, 0]
    out[0, 0] = (2.0 * len(motion) - leverages(solution, motion, (2, 3))[:, :2].sum()) / unit
    return out


def _pull_of_sightings(solution: Solution, ranges: CalibratedRange, bearings: CalibratedBearing) -> Array:
    out = np.zeros((7, 2))
    at, measured = Linearised(solution, ranges), ranges.measurement
    share = leverages(solution, ranges, (2, 3, 5))[:, 0] / ranges.stretch(*at.values[2:4], measurement=measured)[:, 0]
    out[2] = share.sum(), -share @ measured[:, 3]
    out[3] = share @ measured[:, 1:3]
    at = Linearised(solution, bearings)
    b = bearings.direction(*at.values, measurement=bearings.measurement)
    slope, (curve, cube) = at.values[2][0, 1], at.values[3][0]
    share = leverages(solution, bearings, (2, 3, 5))[:, 0] / (1.0 + slope + 2.0 * curve * b + 3.0 * cube * b**2)
    out[4, 1] = share.sum()
    out[5] = 2.0 * share @ b, 3.0 * share @ b**2
    return out
