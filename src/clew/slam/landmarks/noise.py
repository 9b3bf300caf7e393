"""Noise parameters from the data: expectation maximisation with the engine's marginals.

Dempster, Laird, Rubin 1977. The expected square of an error is its square at the solution plus its variance there, so
a parameter does not look smaller than it is because the solution was fitted to the data.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from clew.graph import Factor
from clew.motion import VelocityNoise
from clew.slam.landmarks.graph import RobotFactors
from clew.slam.landmarks.model import SensorModel, SightingNoise
from clew.slam.landmarks.track import TAIL
from clew.solve import Solution

Array = NDArray[np.float64]

_LARGEST_CHANGE = 2.0  # of a deviation in one step
_LEAST_MOTION, _LEAST_RANGE, _LEAST_BEARING = 1e-5, 1e-4, 1e-5


def reestimate(solution: Solution, factors: RobotFactors, model: SensorModel) -> SensorModel:
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
    landmarks = _sighting_noise(solution, factors.sightings, model.landmarks)
    robots = model.robots if factors.mates is None else _sighting_noise(solution, factors.mates, model.robots)
    return replace(model, motion=VelocityNoise(**deviations), landmarks=landmarks, robots=robots)


def _sighting_noise(solution: Solution, pair: tuple[Factor, Factor], noise: SightingNoise) -> SightingNoise:
    return SightingNoise(
        max(_scale(solution, pair[0], noise.range), _LEAST_RANGE),
        max(_scale(solution, pair[1], noise.bearing), _LEAST_BEARING),
    )


def _scale(solution: Solution, factor: Factor, scale: float) -> float:
    """Scale of Student's t distribution (Liu and Rubin 1995, "ML estimation of the t distribution using EM")."""
    error, expected = expected_squares(solution, factor)
    weight = (TAIL + 1.0) / (TAIL + error[:, 0] ** 2 / scale**2)
    return float(np.sqrt(np.mean(weight * expected[:, 0, 0])))


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
