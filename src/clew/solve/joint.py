"""Initial guess by rotations and translations at once, as if rotations were any matrices.

Where translations tell more of directions than the measured rotations do, rotations first (`rotation_guess`) are a
poor start. Here the rows of ``[R_i t_i]`` are found together: ``t_j - t_i = R_i t_z`` and ``R_j = R_i R_z`` are linear
in them, with the weights of Rosen et al., "SE-Sync", Int. J. of Robotics Research 2019, section 3. That matrices
shrink away from the known poses is the price, so that this is another start and no replacement.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import so2, so3
from clew.solve.linear import LinearProblem, Terms
from clew.solve.problem import Problem
from clew.solve.relations import Relations
from clew.solve.rotation import nearest_rotations, with_positions

Array = NDArray[np.float64]


def joint_guess(problem: Problem, relations: Relations) -> Array | None:
    """Poses ``(N, storage)``, or None if some pose hangs on no known one."""
    space = relations.kind.space
    rotations = _rotations(relations, LinearProblem.of(problem, relations, space + 1))
    if rotations is None:
        return None
    return with_positions(relations, LinearProblem.of(problem, relations, space), rotations)


def _rotations(relations: Relations, system: LinearProblem) -> Array | None:
    """Rotation part of the storage of each pose; a pose's vectors are the rows of ``[R_i t_i]``, ``(space + 1,)``."""
    space = relations.kind.space
    matrix = so2.matrix if space == 2 else so3.matrix
    turns = 1 if space == 2 else 3

    def terms(piece: slice, measurement: Array, information: Array) -> Terms:
        count = len(measurement)
        by_i = np.zeros((count, space + 1, space + 1))
        by_i[:, :space, :space] = -np.swapaxes(matrix(measurement[:, space:]), 1, 2)
        by_i[:, space, :space] = -measurement[:, :space]
        by_i[:, space, space] = -1.0
        weight = np.zeros_like(by_i)
        diagonal = np.diagonal(information, axis1=1, axis2=2)
        rows = np.arange(space)
        weight[:, rows, rows] = np.maximum(diagonal[:, space:].sum(axis=1, keepdims=True) / (2 * turns), 1e-9)
        weight[:, space, space] = diagonal[:, :space].mean(axis=1)
        eye = np.broadcast_to(np.eye(space + 1), by_i.shape)
        return by_i, eye, np.zeros((count, space + 1, space)), weight

    known = np.zeros((len(relations.start), space + 1, space))
    first = relations.known
    known[first, :space] = np.swapaxes(matrix(relations.start[first, space:]), 1, 2)
    known[first, space] = relations.start[first, :space]
    solution = system.solve(terms, known)
    if solution is None or not np.isfinite(solution).all():
        return None
    transposed = solution[:, :space]
    if space == 3:
        return so3.inverse(nearest_rotations(transposed))
    sine, cosine = transposed[:, 0, 1] - transposed[:, 1, 0], transposed[:, 0, 0] + transposed[:, 1, 1]
    angles: Array = np.arctan2(sine, cosine)[:, None]
    return angles
