"""Initial guess of landmarks: where the first sighting puts them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.solve.evaluate import CompiledBlock
from clew.solve.problem import Problem, Values

Array = NDArray[np.float64]


def place_landmarks(problem: Problem, values: Values) -> Values:
    """Move each free landmark to its first sighting by point, or by range and bearing; others stay."""
    placed = [array.copy() for array in values]
    done = [columns < 0 for columns in problem.columns]
    for block in problem.blocks:
        seen = _sightings(block)
        if seen is None:
            continue
        pose_kind = block.factor.kinds[0]
        if block.factor.T_robot_sensor is not None:
            seen = pose_kind.functions.act(block.factor.T_robot_sensor, seen)
        poses, points = block.tables
        rows, first = np.unique(block.rows[:, 1], return_index=True)
        new = ~done[points][rows]
        rows, first = rows[new], first[new]
        placed[points][rows] = pose_kind.functions.act(values[poses][block.rows[first, 0]], seen[first])
        done[points][rows] = True
    return placed


def _sightings(block: CompiledBlock) -> Array | None:
    """Points in the sensor's frame ``(M, space)`` for factors that say as much."""
    z = block.factor.measurement
    if block.factor.native == "point":
        return z
    if block.factor.native == "range_bearing" and z.shape[1] == 2:
        return np.stack([z[:, 0] * np.cos(z[:, 1]), z[:, 0] * np.sin(z[:, 1])], axis=1)
    return None
