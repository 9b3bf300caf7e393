"""Initial guess of landmarks: where the first sighting puts them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.solve.evaluate import CompiledBlock
from clew.solve.problem import Problem, Values

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def place_landmarks(problem: Problem, values: Values) -> Values:
    """Move each free landmark to its first sighting by point, or by range and bearing; others stay."""
    if not any(block.factor.native in ("point", "range_bearing") for block in problem.blocks):
        return values
    return sighted_landmarks(problem, values, [np.ones(len(array), bool) for array in values])[0]


def sighted_landmarks(problem: Problem, values: Values, known: list[Flags]) -> tuple[Values, list[Flags]]:
    """Values with each free landmark at its first sighting from a known pose, and which those are.

    Args:
        problem: the compiled graph.
        values: of all variables; those of the known poses count.
        known: for each kind ``(N,)`` which poses to believe.
    """
    placed = [array.copy() for array in values]
    found = [np.zeros(len(array), bool) for array in values]
    for block in problem.blocks:
        seen = _sightings(block)
        if seen is None:
            continue
        pose_kind = block.factor.kinds[0]
        if block.factor.T_robot_sensor is not None:
            seen = pose_kind.functions.act(block.factor.T_robot_sensor, seen)
        poses, points = block.tables
        usable = np.flatnonzero(
            known[poses][block.rows[:, 0]]
            & (problem.columns[points][block.rows[:, 1]] >= 0)
            & ~found[points][block.rows[:, 1]]
        )
        rows, first = np.unique(block.rows[usable, 1], return_index=True)
        first = usable[first]
        placed[points][rows] = pose_kind.functions.act(values[poses][block.rows[first, 0]], seen[first])
        found[points][rows] = True
    return placed, found


def _sightings(block: CompiledBlock) -> Array | None:
    """Points in the sensor's frame ``(M, space)`` for factors that say as much."""
    z = block.factor.measurement
    if block.factor.native == "point":
        return z
    if block.factor.native == "range_bearing" and z.shape[1] == 2:
        return np.stack([z[:, 0] * np.cos(z[:, 1]), z[:, 0] * np.sin(z[:, 1])], axis=1)
    return None
