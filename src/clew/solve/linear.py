"""Linear least squares in relative poses, for initial guesses: one vector a pose, some poses known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.linalg import BlockPattern, FactorStatus, SymbolicFactor, analyse
from clew.solve.plan import pattern_of, scatter_plan
from clew.solve.problem import Problem
from clew.solve.relations import Relations

Array = NDArray[np.float64]
#: Of relations in a row, for `LinearProblem.solve`: ``A``, ``B (m, s, s)``, ``c (m, s, k)``, ``Omega (m, s, s)``.
Terms = tuple[Array, Array, Array, Array]


class LinearProblem:
    """A linear least squares problem in a vector of ``(s,)`` a pose, known poses given."""

    @classmethod
    def of(cls, problem: Problem, relations: Relations, size: int) -> LinearProblem:
        """The problem with vectors of that size; poses are eliminated in the order found for the whole problem."""
        columns = np.zeros(len(relations.start), np.int32)
        columns[relations.known] = -1
        columns[columns == 0] = np.arange(len(columns) - len(relations.known))
        pairs = np.stack([columns[relations.i], columns[relations.j]], axis=1)
        pattern = pattern_of(np.full(len(columns) - len(relations.known), size, np.int32), [pairs])
        eliminated = problem.symbolic.permutation
        eliminated = eliminated[problem.table_of[eliminated] == relations.table]
        order = columns[problem.row_of[eliminated]]
        symbolic = analyse(
            pattern, ordering=problem.symbolic.ordering, threads=problem.threads, order=order[order >= 0]
        )
        return cls(relations, columns, pairs, pattern, symbolic)

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
            known: ``(N, s, k)`` values of the known poses, zero elsewhere.

        Returns:
            ``(N, s, k)``, or None if the measurements leave a pose free.
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
        solution[self.free] = factor.solve(downhill, overwrite=True).reshape(len(self.free), *known.shape[1:])
        return solution
