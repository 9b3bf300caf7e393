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
from clew.linalg import BlockPattern, FactorStatus, SymbolicFactor, analyse
from clew.solve.plan import pattern_of, scatter_plan
from clew.solve.problem import Problem
from clew.solve.relations import Relations

Array = NDArray[np.float64]


def rotation_guess(problem: Problem, relations: Relations) -> Array | None:
    """Poses ``(N, storage)``, or None if some pose hangs on no known one.

    The poses are eliminated in the order that was found for the whole problem.
    """
    space = relations.kind.space
    columns = np.zeros(len(relations.start), np.int32)
    columns[relations.known] = -1
    columns[columns == 0] = np.arange(len(columns) - len(relations.known))
    pairs = np.stack([columns[relations.i], columns[relations.j]], axis=1)
    pattern = pattern_of(np.full(len(columns) - len(relations.known), space, np.int32), [pairs])
    if not pattern.dim:
        known: Array = relations.start.copy()
        return known
    eliminated = problem.symbolic.permutation
    eliminated = eliminated[problem.table_of[eliminated] == relations.table]
    order = columns[problem.row_of[eliminated]]
    symbolic = analyse(
        pattern, ordering=problem.symbolic.ordering, threads=problem.threads, order=order[order >= 0]
    )
    system = _Linear(relations, columns, pairs, pattern, symbolic)
    rotations = _rotations(relations, system)
    if rotations is None:
        return None
    turned = so2.matrix(rotations) if space == 2 else so3.matrix(rotations)
    positions = _positions(relations, system, turned)
    return None if positions is None else np.concatenate([positions, rotations], axis=1)


class _Linear:
    """A linear least squares problem in a vector of ``(space,)`` a pose, known poses given."""

    def __init__(
        self,
        relations: Relations,
        columns: NDArray[np.int32],
        pairs: NDArray[np.int32],
        pattern: BlockPattern,
        symbolic: SymbolicFactor,
    ) -> None:
        self.i, self.j, self.known = relations.i, relations.j, relations.known
        self.free = np.flatnonzero(columns >= 0)
        self.pattern, self.symbolic = pattern, symbolic
        self.gradient = np.append(pattern.starts[:-1], -1).astype(np.int32)[pairs]
        self.plan = scatter_plan(pattern, pairs)

    def solve(
        self, by_i: Array, by_j: Array, constant: Array, information: Array, known: Array
    ) -> Array | None:
        """Minimise ``sum |by_i x_i + by_j x_j + constant|^2`` in the norm of `information`.

        Args:
            by_i: ``(M, space, space)``.
            by_j: ``(M, space, space)``.
            constant: ``(M, space, k)`` for k problems that differ in this and in `known` only.
            information: ``(M, space, space)``.
            known: ``(N, space, k)`` values of the known poses, zero elsewhere.

        Returns:
            ``(N, space, k)``, or None if the measurements leave a pose free.
        """
        residual = by_i @ known[self.i] + by_j @ known[self.j] + constant
        hessian = np.zeros(int(self.pattern.offsets[-1]))
        jacobians = [np.ascontiguousarray(by_i), np.ascontiguousarray(by_j)]
        right = np.empty((self.pattern.dim, residual.shape[2]))
        for k in range(residual.shape[2]):
            gradient = np.zeros(self.pattern.dim)
            hessian.fill(0.0)
            _native.solve.accumulate(
                np.ascontiguousarray(residual[:, :, k]),
                jacobians,
                information,
                self.gradient,
                self.plan,
                0,
                1.0,
                hessian,
                gradient,
            )
            right[:, k] = -gradient
        factor = self.symbolic.factorize(hessian)
        if factor.status is not FactorStatus.OK:
            return None
        solution: Array = known.copy()
        solution[self.free] = factor.solve(right).reshape(len(self.free), -1, residual.shape[2])
        return solution


def _rotations(relations: Relations, system: _Linear) -> Array | None:
    """Rotation part of the storage of each pose, ``(N, 1)`` or ``(N, 4)``."""
    space = relations.kind.space
    matrix = so2.matrix if space == 2 else so3.matrix
    measured = np.swapaxes(matrix(relations.measurement[:, space:]), 1, 2)
    weight = np.trace(relations.information[:, space:, space:], axis1=1, axis2=2)
    weight = np.maximum(weight, 1e-9 * weight.max(initial=1e-9))
    eye = np.broadcast_to(np.eye(space), measured.shape)
    vectors = 1 if space == 2 else 3
    known = np.zeros((len(relations.start), space, vectors))
    known[system.known] = np.swapaxes(matrix(relations.start[system.known, space:]), 1, 2)[:, :, :vectors]
    solution = system.solve(
        -measured, eye, np.zeros((len(eye), space, vectors)), weight[:, None, None] * eye, known
    )
    if solution is None or not np.isfinite(solution).all():
        return None
    if space == 2:
        angles: Array = np.arctan2(-solution[:, 1], solution[:, 0])
        return angles
    left, _, right = np.linalg.svd(solution)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    quaternions: Array = so3.from_matrix(np.swapaxes(left @ right, 1, 2))
    return quaternions


def _positions(relations: Relations, system: _Linear, turned: Array) -> Array | None:
    """Positions ``(N, space)`` given the rotation matrices: ``e = R_z^T (R_i^T (t_j - t_i) - t_z)`` is
    linear."""
    space = relations.kind.space
    matrix = so2.matrix if space == 2 else so3.matrix
    measured = np.swapaxes(matrix(relations.measurement[:, space:]), 1, 2)
    turn = measured @ np.swapaxes(turned[relations.i], 1, 2)
    offset = measured @ relations.measurement[:, :space, None]
    information = np.ascontiguousarray(relations.information[:, :space, :space])
    known = np.zeros((len(relations.start), space, 1))
    known[system.known, :, 0] = relations.start[system.known, :space]
    solution = system.solve(-turn, turn, -offset, information, known)
    return None if solution is None else solution[:, :, 0]
