"""Initial guess by rotations first: chordal relaxation, then the translations as a linear problem.

Carlone, Tron, Daniilidis, Dellaert, "Initialization techniques for 3D SLAM: a survey on rotation estimation
and its use in pose graph optimization", ICRA 2015, section III-B. With ``X_i = R_i^T`` a relative rotation
says ``X_j = R_z^T X_i``, which is linear once ``X`` may be any matrix; its columns are independent, and in
the plane one column says it all. The solutions are projected to the nearest rotations.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.geometry import so2, so3
from clew.linalg import BlockPattern, FactorStatus, SymbolicFactor, analyse
from clew.solve.plan import pattern_of, scatter_plan
from clew.solve.problem import Problem
from clew.solve.relations import Relations

Array = NDArray[np.float64]
#: Of relations in a row: ``A (m, s, s)``, ``B (m, s, s)``, ``c (m, s, k)``, ``Omega (m, s, s)``; see `_Linear.solve`.
Terms = tuple[Array, Array, Array, Array]


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
    positions = _positions(relations, system, rotations)
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
        self.relations = relations
        self.free = np.flatnonzero(columns >= 0)
        self.given = columns < 0
        self.pattern, self.symbolic = pattern, symbolic
        self.gradient = np.append(pattern.starts[:-1], -1).astype(np.int32)[pairs]
        self.plan = scatter_plan(pattern, pairs)

    def solve(self, terms: Callable[[slice, Array, Array], Terms], known: Array) -> Array | None:
        """Minimise ``sum |A_m x_i + B_m x_j + c_m|^2`` in the norm of ``Omega_m``, for k problems that differ in
        ``c`` and in `known` only.

        Args:
            terms: of a piece of the relations, see `Relations.pieces`; `c` is overwritten.
            known: ``(N, space, k)`` values of the known poses, zero elsewhere.

        Returns:
            ``(N, space, k)``, or None if the measurements leave a pose free.
        """
        problems, relations = known.shape[2], self.relations
        hessian = np.zeros(int(self.pattern.offsets[-1]))
        gradient = np.zeros((problems, self.pattern.dim))
        for piece, *measured in relations.pieces():
            by_i, by_j, constant, information = terms(piece, *measured)
            residual = constant
            for jacobian, pose in ((by_i, relations.i[piece]), (by_j, relations.j[piece])):
                here = np.flatnonzero(self.given[pose])  # most relations see no known pose
                residual[here] += np.einsum("mij,mjk->mik", jacobian[here], known[pose[here]])
            jacobians = [np.ascontiguousarray(by_i), np.ascontiguousarray(by_j)]
            for k in range(problems):
                _native.solve.accumulate(
                    np.ascontiguousarray(residual[:, :, k]),
                    jacobians,
                    information,
                    self.gradient[piece],
                    self.plan[piece],
                    0,
                    1.0,
                    hessian,
                    gradient[k],
                )
        hessian /= problems  # each of them has added it
        factor = self.symbolic.factorize(hessian)
        if factor.status is not FactorStatus.OK:
            return None
        del hessian
        solution: Array = known.copy()
        downhill = np.negative(gradient.T, order="C")
        del gradient
        solution[self.free] = factor.solve(downhill, overwrite=True).reshape(len(self.free), -1, problems)
        return solution


def _rotations(relations: Relations, system: _Linear) -> Array | None:
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
    if space == 2:
        angles: Array = np.arctan2(-solution[:, 1], solution[:, 0])
        return angles
    quaternions = np.empty((len(solution), 4))
    _native.solve.nearest_rotations(solution, quaternions)
    return so3.inverse(quaternions)


def _positions(relations: Relations, system: _Linear, rotations: Array) -> Array | None:
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
