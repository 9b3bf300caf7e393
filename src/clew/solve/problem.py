"""A graph compiled for solving: columns, sparsity, scatter plan, symbolic factor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.geometry import SE2, SE3
from clew.graph import FactorGraph, Role
from clew.linalg import BlockPattern, SymbolicFactor, analyse
from clew.noise import Kernel
from clew.solve.evaluate import CompiledBlock, System
from clew.solve.plan import pattern_of, scatter_plan

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Values = list[Array]  # one (N, storage) array a kind, in the order of `Problem.tables`


@dataclass(frozen=True, eq=False)
class Table:
    """The variables of one kind: their manifold and their keys ``(N,)``."""

    kind: type[Any]
    keys: Index


@dataclass(frozen=True, eq=False)
class Problem:
    """What stays as long as the structure of a graph stands; values come and go.

    Attributes:
        tables: the variables, kind by kind.
        columns: for each kind ``(N,)`` the number of each variable among the free ones, -1 if it is held
            constant.
        table_of: ``(n,)`` kind of each column.
        row_of: ``(n,)`` row of each column in its kind.
        pattern: of the block Hessian.
        blocks: the factors.
    """

    tables: tuple[Table, ...]
    columns: tuple[NDArray[np.int32], ...]
    table_of: NDArray[np.int32]
    row_of: Index
    pattern: BlockPattern
    blocks: tuple[CompiledBlock, ...]
    ordering: str
    threads: int

    @cached_property
    def symbolic(self) -> SymbolicFactor:
        """Elimination order and structure of the factor; made when first needed."""
        return analyse(self.pattern, ordering=self.ordering, threads=self.threads)

    @cached_property
    def offsets(self) -> tuple[NDArray[np.int32], ...]:
        """For each kind ``(N,)`` the first scalar of each variable in the gradient, -1 if constant."""
        starts = np.append(self.pattern.starts[:-1], -1).astype(np.int32)
        return tuple(starts[columns] for columns in self.columns)

    def key_of(self, column: int) -> int:
        """Key of the variable in a column."""
        return int(self.tables[self.table_of[column]].keys[self.row_of[column]])

    def kind_of(self, column: int) -> type[Any]:
        """Manifold of the variable in a column."""
        kind: type[Any] = self.tables[self.table_of[column]].kind
        return kind

    def empty_system(self) -> System:
        """Room for the normal equations."""
        return System(np.zeros(int(self.pattern.offsets[-1])), np.zeros(self.pattern.dim))

    def evaluate(self, values: Values, robust: Kernel | None, system: System | None = None) -> float:
        """Cost at `values`; with a system, also fills in the normal equations there.

        `robust` is the kernel of all blocks without one of their own, priors excepted.
        """
        if system is not None:
            system.clear()
        return sum(block.evaluate(values, kernel_of(block, robust), system) for block in self.blocks)

    def retract(self, values: Values, step: Array) -> Values:
        """Values after a step in the free variables' tangents."""
        moved = []
        for table, offsets, array in zip(self.tables, self.offsets, values, strict=True):
            if table.kind in (SE2, SE3):
                out = np.empty_like(array)
                _native.solve.retract(array, offsets, step, out)
            else:
                out = array.copy()
                free = np.flatnonzero(offsets >= 0)
                delta = step[offsets[free, None] + np.arange(table.kind.dim)]
                out[free] = table.kind.functions.retract(array[free], delta)
            moved.append(out)
        return moved


def values_of(graph: FactorGraph) -> Values:
    """Copies of the values that a graph has, in the order of `Problem.tables`."""
    return [table.values for table in graph.variables()]


def kernel_of(block: CompiledBlock, robust: Kernel | None) -> Kernel | None:
    """Kernel that a block is solved with: its own, else `robust` unless it is a prior."""
    if block.factor.kernel is not None or block.factor.role == Role.PRIOR:
        return block.factor.kernel
    return robust


def build_problem(
    graph: FactorGraph, held: Mapping[type[Any], Index], ordering: str, threads: int
) -> Problem:
    """Compile a graph.

    Args:
        graph: variables and factors.
        held: rows of variables, by kind, that are held besides the graph's own constants (to fix a free
            gauge).
        ordering: of `linalg.analyse`.
        threads: of `linalg.analyse`.
    """
    tables = tuple(graph.variables())
    number_of = {table.kind: number for number, table in enumerate(tables)}
    frees = []
    for table in tables:
        free = ~table.constant
        free[held.get(table.kind, np.empty(0, np.int64))] = False
        frees.append(np.flatnonzero(free))
    table_of = np.concatenate(
        [np.full(len(f), n, np.int32) for n, f in enumerate(frees)] or [np.empty(0, np.int32)]
    )
    row_of = np.concatenate([*frees, np.empty(0, np.int64)])
    if len(tables) > 1:  # columns in the order of addition, kinds mixed
        order = np.argsort(
            np.concatenate([t.order[f] for t, f in zip(tables, frees, strict=True)]), kind="stable"
        )
        table_of, row_of = table_of[order], row_of[order]
    columns = []
    for number, table in enumerate(tables):
        column = np.full(len(table.keys), -1, np.int32)
        mine = np.flatnonzero(table_of == number)
        column[row_of[mine]] = mine
        columns.append(column)
    sizes = np.array([table.kind.dim for table in tables], np.int32)[table_of]

    factors = list(graph.blocks())
    places, rows, touched = [], [], []
    for factor in factors:
        place = tuple(number_of[kind] for kind in factor.kinds)
        row = graph.positions(factor.keys).astype(np.int32)
        places.append(place)
        rows.append(row)
        touched.append(np.stack([columns[n][row[:, p]] for p, n in enumerate(place)], axis=1))
    pattern = pattern_of(sizes, touched)
    starts = np.append(pattern.starts[:-1], -1).astype(np.int32)
    blocks = tuple(
        CompiledBlock(factor, place, row, starts[column], scatter_plan(pattern, column))
        for factor, place, row, column in zip(factors, places, rows, touched, strict=True)
    )
    names = tuple(Table(table.kind, table.keys) for table in tables)
    return Problem(names, tuple(columns), table_of, row_of, pattern, blocks, ordering, threads)
