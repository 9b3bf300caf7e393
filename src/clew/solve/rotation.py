"""Initial guess by rotations first: chordal relaxation, then the translations as a linear problem.

Carlone, Tron, Daniilidis, Dellaert, "Initialization techniques for 3D SLAM: a survey on rotation estimation
and its use in pose graph optimization", ICRA 2015, section III-B. With ``X_i = R_i^T`` a relative rotation
says ``X_j = R_z^T X_i``, which is linear once ``X`` may be any matrix; its columns are independent, and in
the plane one column says it all. The solutions are projected to the nearest rotations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.geometry import so2, so3
from clew.solve.linear import LinearProblem, Terms
from clew.solve.problem import Problem
from clew.solve.relations import Relations

Array = NDArray[np.float64]


def rotation_guess(problem: Problem, relations: Relations) -> Array | None:
    """Poses ``(N, storage)``, or None if some pose hangs on no known one."""
    system = LinearProblem.of(problem, relations, relations.kind.space)
    rotations = _rotations(relations, system)
    return None if rotations is None else with_positions(relations, system, rotations)


def with_positions(relations: Relations, system: LinearProblem, rotations: Array) -> Array | None:
    """Poses ``(N, storage)`` of rotations with the best positions, or None if some hang on no known one."""
    positions = _positions(relations, system, rotations)
    if positions is None:
        return None
    poses = np.concatenate([positions, rotations], axis=1)
    poses[relations.known] = relations.start[relations.known]  # to the last bit
    return poses


def nearest_rotations(matrices: Array) -> Array:
    """Quaternions ``(N, 4)`` of the rotations nearest to matrices ``(N, 3, 3)``."""
    quaternions = np.empty((len(matrices), 4))
    _native.solve.nearest_rotations(np.ascontiguousarray(matrices), quaternions)
    return quaternions


def _rotations(relations: Relations, system: LinearProblem) -> Array | None:
    """Rotation part of the storage of each pose, ``(N, 1)`` or ``(N, 4)``."""
    space = relations.kind.space
    matrix = so2.matrix if space == 2 else so3.matrix
    weight = np.concatenate(
        [np.trace(omega[:, space:, space:], axis1=1, axis2=2) for _, _, omega in relations.pieces()]
    )
    weight = np.maximum(weight, 1e-9 * weight.max(initial=1e-9))
    vectors = 1 if space == 2 else 3

    def terms(piece: slice, measurement: Array, _: Array) -> Terms:
        measured = np.swapaxes(matrix(measurement[:, space:]), 1, 2)
        eye = np.broadcast_to(np.eye(space), measured.shape)
        return -measured, eye, np.zeros((len(eye), space, vectors)), weight[piece, None, None] * eye

    known = np.zeros((len(relations.start), space, vectors))
    first = relations.known
    known[first] = np.swapaxes(matrix(relations.start[first, space:]), 1, 2)[:, :, :vectors]
    solution = system.solve(terms, known)
    if solution is None or not np.isfinite(solution).all():
        return None
    if space == 2:  # the first columns of the transposed
        angles: Array = np.arctan2(-solution[:, 1], solution[:, 0])
        return angles
    return so3.inverse(nearest_rotations(solution))


def _positions(relations: Relations, system: LinearProblem, rotations: Array) -> Array | None:
    """Positions ``(N, space)`` given the rotations: ``e = R_z^T (R_i^T (t_j - t_i) - t_z)`` is linear."""
    space = relations.kind.space
    functions = so2 if space == 2 else so3

    def terms(piece: slice, measurement: Array, information: Array) -> Terms:
        position, rotation = measurement[:, :space], measurement[:, space:]
        turned = functions.compose(rotations[relations.i[piece]], rotation)
        turn = np.swapaxes(functions.matrix(turned), 1, 2)
        offset = functions.act(functions.inverse(rotation), position)
        return -turn, turn, -offset[:, :, None], np.ascontiguousarray(information[:, :space, :space])

    known = np.zeros((len(relations.start), space, 1))
    known[relations.known, :, 0] = relations.start[relations.known, :space]
    solution = system.solve(terms, known)
    return None if solution is None else solution[:, :, 0]
