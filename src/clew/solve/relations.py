"""The relative poses of a problem, gathered for initial guesses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.geometry import SE2, SE3
from clew.graph import Role
from clew.solve.evaluate import CompiledBlock
from clew.solve.problem import Problem, Values

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PIECE = 4096  # relations handled together


@dataclass(frozen=True, eq=False)
class Relations:
    """All relative-pose measurements between poses of one kind, and the poses that are known beforehand.

    Attributes:
        table: number of the kind in the problem.
        kind: `SE2` or `SE3`.
        blocks: the factors that they come from, in the order of the rows of the arrays below.
        i: ``(M,)`` row of the pose that is seen from.
        j: ``(M,)`` row of the pose that is seen.
        known: rows of the poses whose values are taken as they are.
        start: ``(N, storage)`` values of all poses, priors applied.
    """

    table: int
    kind: type[Any]
    blocks: tuple[CompiledBlock, ...]
    i: Index
    j: Index
    known: Index
    start: Array

    def measurement(self, *, odometry: bool = False) -> Array:
        """Measurements ``(M, storage)`` of all, or of odometry alone."""
        return np.concatenate(
            [b.factor.measurement[: None if _is_odometry(b) or not odometry else 0] for b in self.blocks]
        )

    def odometry(self) -> Index:
        """Which of the rows are odometry."""
        return np.flatnonzero(np.concatenate([np.full(len(b.factor), _is_odometry(b)) for b in self.blocks]))

    def pieces(self) -> Iterator[tuple[slice, Array, Array]]:
        """Some thousand rows at a time, so that what is made of them is small: slice, measurement and information."""
        first = 0
        for block in self.blocks:
            measurement, information = block.factor.measurement, block.factor.information
            for start in range(0, len(measurement), _PIECE):
                some = slice(start, min(start + _PIECE, len(measurement)))
                yield slice(first + some.start, first + some.stop), measurement[some], information[some]
            first += len(measurement)


def relations(problem: Problem, values: Values) -> list[Relations]:
    """Relations of each kind of pose that has any.

    Known are the poses that are constant; in a part without such a pose the first that has a prior, at its
    prior.
    """
    found = []
    for number, table in enumerate(problem.tables):
        kind = table.kind
        blocks = tuple(
            b
            for b in problem.blocks
            if b.factor.native == "between" and b.tables == (number, number) and len(b.factor)
        )
        if kind not in (SE2, SE3) or not blocks:
            continue
        i = np.concatenate([b.rows[:, 0] for b in blocks]).astype(np.int64)
        j = np.concatenate([b.rows[:, 1] for b in blocks]).astype(np.int64)
        start = values[number]
        constant = np.flatnonzero(problem.columns[number] < 0)
        component = _native.solve.spanning_forest(len(start), i, j, np.empty(0, np.int64))[4]
        priors = [b for b in problem.blocks if b.factor.native == "prior" and b.tables == (number,)]
        seeds = [constant]
        if priors:
            rows = np.concatenate([b.rows[:, 0] for b in priors]).astype(np.int64)
            poses = np.concatenate([b.factor.measurement for b in priors])
            open_ = ~np.isin(component[rows], component[constant])
            _, first = np.unique(component[rows[open_]], return_index=True)
            chosen = np.flatnonzero(open_)[first]
            start = start.copy()
            start[rows[chosen]] = poses[chosen]
            seeds.append(rows[chosen])
        found.append(Relations(number, kind, blocks, i, j, np.unique(np.concatenate(seeds)), start))
    return found


def _is_odometry(block: CompiledBlock) -> bool:
    return block.factor.role == Role.ODOMETRY
