"""Noise parameters from the data: expectation maximisation with the engine's marginals.

Dempster, Laird, Rubin 1977. The expected square of an error is its square at the solution plus its variance there, so
a parameter does not look smaller than it is because the solution was fitted to the data.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from clew.graph import Factor
from clew.io import Sightings
from clew.motion import VelocityNoise
from clew.slam.landmarks.graph import RobotFactors
from clew.slam.landmarks.model import SensorModel, SightingNoise
from clew.slam.landmarks.track import TAIL, RobotTrack
from clew.solve import Solution

Array = NDArray[np.float64]

_SUCCESSION = 2.0  # seconds
_HIGHEST_CORRELATION = 0.95
_LARGEST_CHANGE = 2.0  # of a deviation in one step
_LEAST_MOTION, _LEAST_RANGE, _LEAST_BEARING = 1e-5, 1e-4, 1e-5


def reestimate(solution: Solution, track: RobotTrack, factors: RobotFactors, model: SensorModel) -> SensorModel:
    """A robot's model with noise parameters that make the errors at the solution likelier."""
    _, expected = expected_squares(solution, factors.motion)
    weight = factors.motion.information
    deviations = {}
    for source, entry in zip(factors.sources, fields(VelocityNoise), strict=True):
        # The likelihood is stationary where tr(W C W S) = tr(W C), summed over the motions (S: expected squares).
        found = np.einsum("sij,sjk,skl,sli->", weight, source, weight, expected)
        due = np.einsum("sij,sji->", weight, source)
        ratio = float(np.sqrt(found / due)) if due > 0.0 else 1.0
        change = min(max(ratio, 1.0 / _LARGEST_CHANGE), _LARGEST_CHANGE)
        deviations[entry.name] = max(getattr(model.motion, entry.name) * change, _LEAST_MOTION)
    seen, mates = track.log.landmarks, track.log.robots
    landmarks = _sighting_noise(solution, seen, factors.sightings, model.landmarks)
    robots = model.robots if factors.mates is None else _sighting_noise(solution, mates, factors.mates, model.robots)
    return replace(model, motion=VelocityNoise(**deviations), landmarks=landmarks, robots=robots)


def _sighting_noise(
    solution: Solution, seen: Sightings, pair: tuple[Factor, Factor], noise: SightingNoise
) -> SightingNoise:
    distance, range_repeats = _scale(solution, seen, pair[0], noise.range)
    angle, bearing_repeats = _scale(solution, seen, pair[1], noise.bearing)
    return SightingNoise(max(distance, _LEAST_RANGE), max(angle, _LEAST_BEARING), range_repeats, bearing_repeats)


def _scale(solution: Solution, seen: Sightings, factor: Factor, scale: float) -> tuple[float, float]:
    """Scale of Student's t distribution (Liu and Rubin 1995, "ML estimation of the t distribution using EM"), and
    how many sightings in succession count as one."""
    error, expected = expected_squares(solution, factor)
    weight = (TAIL + 1.0) / (TAIL + error[:, 0] ** 2 / scale**2)
    return float(np.sqrt(np.mean(weight * expected[:, 0, 0]))), repeats(seen, np.sqrt(weight) * error[:, 0])


def repeats(seen: Sightings, error: Array) -> float:
    """How many sightings of one thing in quick succession carry the information of one independent sighting.

    With a correlation ``r`` from each error ``(K,)`` to the next (a first-order process) the mean of many has the
    variance of independent ones times ``(1 + r) / (1 - r)``: Box, Jenkins, Reinsel, "Time series analysis",
    section 2.1.5.
    """
    order = np.lexsort((seen.timestamp, seen.identity))
    identity, stamp, ordered = seen.identity[order], seen.timestamp[order], error[order]
    follows = np.flatnonzero((np.diff(identity) == 0) & (np.diff(stamp) <= _SUCCESSION))
    power = float(np.sum(ordered[follows] ** 2 + ordered[follows + 1] ** 2)) / 2.0
    if power == 0.0:
        return 1.0
    correlation = float(ordered[follows] @ ordered[follows + 1]) / power
    correlation = min(max(correlation, 0.0), _HIGHEST_CORRELATION)
    return (1.0 + correlation) / (1.0 - correlation)


def expected_squares(solution: Solution, factor: Factor) -> tuple[Array, Array]:
    """Residuals ``(M, d)`` at the solution, and their expected outer products ``(M, d, d)`` under its covariance."""
    problem, chol = solution.posterior.problem, solution.posterior.factor
    kinds = [table.kind for table in problem.tables]
    values, columns = [], []
    for position, kind in enumerate(factor.kinds):
        table = kinds.index(kind)
        order = np.argsort(problem.tables[table].keys)
        rows = order[np.searchsorted(problem.tables[table].keys, factor.keys[:, position], sorter=order)]
        values.append(solution.posterior.values[table][rows])
        columns.append(problem.columns[table][rows].astype(np.int64))
    error, jacobians = factor.linearise(*values)
    expected = error[:, :, None] * error[:, None, :]
    for i in range(len(columns)):
        for j in range(len(columns)):
            free = np.flatnonzero((columns[i] >= 0) & (columns[j] >= 0))
            pairs = np.stack([columns[i][free], columns[j][free]], axis=1)
            block = chol.marginal_blocks(pairs).reshape(-1, factor.kinds[i].dim, factor.kinds[j].dim)
            expected[free] += jacobians[i][free] @ block @ np.swapaxes(jacobians[j][free], 1, 2)
    return error, expected
