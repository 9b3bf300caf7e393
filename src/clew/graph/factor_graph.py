"""The factor graph: what is to be estimated, and what was measured."""

from __future__ import annotations

from collections.abc import Hashable, Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.graph.blocks import FactorTable, signature
from clew.graph.factor import Factor, Role
from clew.graph.growing import Growing
from clew.graph.index import as_keys
from clew.graph.summary import summarise
from clew.graph.variable_set import VariableSet

Index = NDArray[np.int64]


class FactorGraph(VariableSet):
    """Variables and the factors between them, growing and shrinking at will.

    Variables of one kind (`SE2`, `SE3`, `Point2`, `Point3`) are rows of one array; factors of one kind, role,
    robust kernel and sensor offset are rows of one block, whether they came one by one or a thousand at once.
    A variable is known by its key, an integer: the next free one, or one that you choose (say, the vertex id
    of a file).

    ``len(graph)`` is the number of variables; ``key in graph`` asks for one.
    """

    def __init__(self) -> None:
        super().__init__()
        self._factors: list[FactorTable] = []
        self._factors_of: dict[Hashable, int] = {}
        self._id_table: Growing[np.int32] = Growing((), np.int32)  # table of each factor id, -1 once removed
        self._id_row: Growing[np.int64] = Growing((), np.int64)

    # --- factors
    # ---------------------------------------------------------------------------------------------

    def add(self, factor: Factor) -> Index:
        """Add a factor: one measurement, or a block of many of one kind.

        Returns:
            ``(M,)`` ids of the measurements, by which `remove` takes them out again.

        Raises:
            InputError: a key that is unknown or of another kind than the factor needs.
        """
        tables = [self._table_of.get(kind, -1) for kind in factor.kinds]
        if len(factor) != 1 or not self._fits(factor.keys[0].tolist(), tables):
            self._check(factor, tables)
        name = signature(factor)
        number = self._factors_of.get(name)
        if number is None:
            number = self._factors_of[name] = len(self._factors)
            self._factors.append(FactorTable(factor))
        start = len(self._id_table)
        ids = np.arange(start, start + len(factor))
        self._id_row.append(self._factors[number].append(factor, ids))
        self._id_table.extend(len(ids))[:] = number
        self._structure += 1
        return ids

    def _fits(self, keys: list[int], tables: list[int]) -> bool:
        """Whether the keys of one measurement are known and of the kinds in these tables; quick."""
        slots = [self._index.find_one(key) for key in keys]
        return min(slots) >= 0 and [self._slot_table.rows.item(slot) for slot in slots] == tables

    def _check(self, factor: Factor, tables: list[int]) -> None:
        """Raise InputError for the first key of a block that is unknown or of another kind."""
        slots = self._index.find(factor.keys)
        if slots.size and slots.min() < 0:
            raise InputError(
                f"{type(factor).__name__} refers to the unknown key {factor.keys[slots < 0][0]}; "
                "add its variable first"
            )
        wrong = self._slot_table.rows[slots] != np.array(tables)
        if wrong.any():
            row, position = (int(index) for index in np.argwhere(wrong)[0])
            key, kind = int(factor.keys[row, position]), factor.kinds[position]
            raise InputError(
                f"{type(factor).__name__} needs a {kind.__name__} as variable {position + 1}, but key "
                f"{key} is a {self.kind(key).__name__}"
            )

    def remove_variable(self, key: ArrayLike) -> None:
        """Remove a variable, or an array of them, together with all factors that refer to it.

        Raises:
            InputError: an unknown key.
        """
        keys = as_keys(key).reshape(-1)
        self._slots(keys)  # raises before anything is removed
        for table in self._factors:
            hit = table.touching(keys)
            if len(hit):
                self._drop(table, hit)
        self._remove(keys)

    def remove(self, ids: ArrayLike) -> None:
        """Take factors out again, by the ids that `add` returned.

        Raises:
            InputError: an id that is unknown or removed already.
        """
        wanted = np.unique(as_keys(ids, "factor ids"))
        known = (wanted >= 0) & (wanted < len(self._id_table))
        if known.all():
            known = self._id_table.rows[wanted] >= 0
        if not known.all():
            raise InputError(
                f"no factor has the id {wanted[~known][0]}; it was removed before, or is of another graph"
            )
        tables = self._id_table.rows[wanted]
        for number in np.unique(tables):
            self._drop(self._factors[number], self._id_row.rows[wanted[tables == number]])
        self._structure += 1

    def _drop(self, table: FactorTable, rows: Index) -> None:
        self._id_table.rows[table.ids.rows[rows]] = -1
        table.remove(rows)
        if table.dead > max(64, len(table)):
            table.compact()
            self._id_row.rows[table.ids.rows] = np.arange(len(table))

    def blocks(self, role: Role | None = None) -> Iterator[Factor]:
        """The factors, block by block; each block is a read-only `Factor`, valid until the graph changes."""
        for table in self._factors:
            if len(table) and (role is None or table.prototype.role == role):
                yield table.block()

    def block_ids(self, role: Role | None = None) -> Iterator[Index]:
        """Factor ids of each block that `blocks` yields, row by row."""
        for table in self._factors:
            if len(table) and (role is None or table.prototype.role == role):
                yield table.live_ids().copy()

    def touching(self, keys: ArrayLike) -> Iterator[Factor]:
        """The factors that refer to any of the keys, block by block (the Markov blanket is in their keys)."""
        wanted = as_keys(keys).reshape(-1)
        for table in self._factors:
            rows = table.touching(wanted)
            if len(rows):
                yield table.select(rows)

    # --- the graph as a whole
    # --------------------------------------------------------------------------------

    @property
    def structure(self) -> int:
        """A number that changes whenever variables, factors or what is constant change (not with values)."""
        return self._structure

    @property
    def factor_count(self) -> int:
        """Number of factors (measurements)."""
        return sum(len(table) for table in self._factors)

    @property
    def counts(self) -> dict[str, int]:
        """How many variables of each kind and factors of each role there are, by name."""
        counts = {table.kind.__name__: len(table) for table in self._tables if len(table)}
        for role in Role:
            number = sum(len(table) for table in self._factors if table.prototype.role == role)
            if number:
                counts[role.value] = number
        return counts

    def summary(self) -> str:
        """A few lines for people: variables by kind, factors by type, role and kernel."""
        return summarise(self)

    def copy(self) -> FactorGraph:
        """An independent copy; keys and factor ids stay valid."""
        twin = FactorGraph()
        self._copy_variables(twin)
        twin._factors = [table.copy() for table in self._factors]
        twin._factors_of = dict(self._factors_of)
        twin._id_table, twin._id_row = self._id_table.copy(), self._id_row.copy()
        return twin

    def __str__(self) -> str:
        return self.summary()

    def __repr__(self) -> str:
        counts = self.counts
        kinds = ", ".join(f"{counts[kind.__name__]} {kind.__name__}" for kind in self.kinds) or "no variables"
        roles = ", ".join(f"{counts[role.value]} {role.value}" for role in Role if role.value in counts)
        return f"<FactorGraph: {kinds}; {roles or 'no'} factors>"
