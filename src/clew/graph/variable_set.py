"""The variables of a factor graph: what is to be estimated."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry import SE2, SE3, Manifold, Point2, Point3
from clew.graph.growing import Growing
from clew.graph.index import KeyIndex, as_keys
from clew.graph.variables import Variables, VariableTable

Array = NDArray[np.float64]
Index = NDArray[np.int64]

POSES = (SE2, SE3)
POINTS = (Point2, Point3)


class VariableSet:
    """Variables by kind and key; the half of `FactorGraph` that knows nothing of factors.

    ``len`` is the number of variables; ``key in`` asks for one.
    """

    def __init__(self) -> None:
        self._index = KeyIndex()
        self._tables: list[VariableTable] = []
        self._table_of: dict[type[Any], int] = {}
        self._slot_table: Growing[np.int8] = Growing((), np.int8)  # table of each slot, -1 once removed
        self._slot_row: Growing[np.int64] = Growing((), np.int64)
        self._structure = 0

    def add_pose(self, pose: SE2 | SE3, *, key: ArrayLike | None = None, constant: bool = False) -> Any:
        """Add one pose or a batch of poses with their initial values.

        Args:
            pose: `SE2` or `SE3`; a batch of shape ``(N,)`` adds N variables.
            key: the key, or ``(N,)`` keys for a batch; by default the next free ones.
            constant: hold the value fixed while optimising.

        Returns:
            The key (an int), or an int64 array of ``(N,)`` keys for a batch.

        Raises:
            InputError: not a pose, a value that is not finite, a key in use.
        """
        if type(pose) not in POSES:
            raise InputError(
                f"add_pose takes SE2 or SE3, not {type(pose).__name__}; for landmarks use add_point"
            )
        return self._add(type(pose), pose.array, key, constant)

    def add_point(
        self, point: Point2 | Point3 | ArrayLike, *, key: ArrayLike | None = None, constant: bool = False
    ) -> Any:
        """Add one point (a landmark) or a batch of points; as `add_pose`.

        Args:
            point: `Point2`, `Point3` or coordinates, ``(2,)`` or ``(3,)``, or ``(N, 2)`` or ``(N, 3)`` for a
                batch.
            key: the key or keys; by default the next free ones.
            constant: hold the value fixed while optimising.
        """
        if isinstance(point, POINTS):
            return self._add(type(point), point.array, key, constant)
        try:
            array = np.asarray(point, np.float64)
        except (TypeError, ValueError):
            array = np.empty(0)
        if array.ndim not in (1, 2) or array.shape[-1] not in (2, 3):
            raise InputError(
                f"add_point takes (x, y) or (x, y, z) or a batch of them, not {type(point).__name__} "
                f"of shape {array.shape}"
            )
        return self._add(Point2 if array.shape[-1] == 2 else Point3, array, key, constant)

    def _add(self, kind: type[Any], array: Array, key: ArrayLike | None, constant: bool) -> Any:
        if array.ndim > 2:
            raise InputError(f"a batch of variables has one batch axis; got shape {array.shape}")
        rows = array.reshape(-1, kind.storage)
        if not np.isfinite(rows).all():
            bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))[0]
            raise InputError(f"initial value {bad} of {len(rows)} {kind.__name__} is not finite: {rows[bad]}")
        if key is None:
            keys = np.arange(self._index.next_key, self._index.next_key + len(rows))
        else:
            keys = as_keys(key).reshape(-1)
            if len(keys) != len(rows):
                raise InputError(
                    f"{len(keys)} keys for {len(rows)} values of {kind.__name__}; give one key a value"
                )
        slots = self._index.add(keys)
        table = self._table_of.get(kind)
        if table is None:
            table = self._table_of[kind] = len(self._tables)
            self._tables.append(VariableTable(kind))
        self._slot_row.append(self._tables[table].append(rows, slots, constant))
        self._slot_table.extend(len(rows))[:] = table
        self._structure += 1
        return int(keys[0]) if array.ndim == 1 else keys

    def _remove(self, keys: Index) -> None:
        """Remove variables, whatever refers to them."""
        slots = np.unique(self._slots(keys))
        for number, variables in enumerate(self._tables):
            mine = slots[self._slot_table.rows[slots] == number]
            if len(mine):
                variables.remove(self._slot_row.rows[mine])
                if variables.dead > max(64, len(variables)):
                    variables.compact()
                    self._slot_row.rows[variables.slots.rows] = np.arange(len(variables))
        self._slot_table.rows[slots] = -1
        self._index.remove(slots)
        self._structure += 1

    def set_constant(self, key: ArrayLike, constant: bool = True) -> None:
        """Hold variables fixed while optimising, or let them go.

        Raises:
            InputError: an unknown key.
        """
        for table, rows, _ in self._by_table(as_keys(key).reshape(-1)):
            table.constant.rows[rows] = constant
        self._structure += 1

    def is_constant(self, key: int) -> bool:
        """Whether a variable is held fixed."""
        table, row = self._locate(key)
        return bool(table.constant.rows[row])

    def kind(self, key: int) -> type[Any]:
        """Manifold of a variable: `SE2`, `SE3`, `Point2` or `Point3`."""
        return self._locate(key)[0].kind

    def keys(self, kind: type[Any] | None = None) -> Index:
        """Keys of all variables, or of those of one kind, in the order of addition."""
        if kind is None:
            return self._index.keys[self._slot_table.rows >= 0]
        if kind not in self._table_of:
            return np.empty(0, np.int64)
        table = self._tables[self._table_of[kind]]
        return self._index.keys[table.slots.rows[table.live_rows()]]

    @property
    def kinds(self) -> tuple[type[Any], ...]:
        """Manifolds of the variables that occur."""
        return tuple(table.kind for table in self._tables if len(table))

    def variables(self) -> Iterator[Variables]:
        """Copies of the variables, kind by kind."""
        for table in self._tables:
            if len(table):
                rows = table.live_rows()
                slots = table.slots.rows[rows]
                yield Variables(
                    table.kind,
                    self._index.keys[slots],
                    table.values.rows[rows],
                    table.constant.rows[rows],
                    slots,
                )

    def positions(self, keys: ArrayLike) -> Index:
        """Place of each key among the keys of its kind, ``keys(kind)``.

        Raises:
            InputError: an unknown key.
        """
        slots = self._slots(as_keys(keys))
        rows = self._slot_row.rows[slots]
        for number, table in enumerate(self._tables):
            if table.dead:
                mine = self._slot_table.rows[slots] == number
                rows[mine] = (np.cumsum(table.alive.rows) - 1)[rows[mine]]
        return rows

    def value(self, key: int) -> Any:
        """Value of a variable, as the type that it was added as."""
        table, row = self._locate(key)
        return table.kind.from_array(table.values.rows[row].copy())

    def values(self, keys: ArrayLike | type[Manifold]) -> Any:
        """Values of variables of one kind as a batch, in the order of `keys`; a kind stands for all of that
        kind.

        Raises:
            InputError: an unknown key, or keys of more than one kind.
        """
        if isinstance(keys, type):
            if keys not in self._table_of:
                return keys.from_array(np.empty((0, keys.storage)))
            table = self._tables[self._table_of[keys]]
            return table.kind.from_array(table.values.rows[table.live_rows()])
        wanted = as_keys(keys)
        parts = list(self._by_table(wanted.reshape(-1)))
        if len(parts) != 1:
            names = ", ".join(part[0].kind.__name__ for part in parts) or "none"
            raise InputError(f"values takes keys of one kind, these are of: {names}; ask kind by kind")
        table, rows, _ = parts[0]
        return table.kind.from_array(table.values.rows[rows].reshape(*wanted.shape, table.kind.storage))

    def set_value(self, key: int, value: Any) -> None:
        """Replace the value of a variable; coordinates do for a point."""
        self.set_values(np.array([key]), value)

    def set_values(self, keys: ArrayLike, values: Any) -> None:
        """Replace the values of variables of one kind by a batch of that kind (or its array).

        Raises:
            InputError: unknown keys, another kind, another number of values, values that are not finite.
        """
        wanted = as_keys(keys).reshape(-1)
        for table, rows, _ in self._by_table(wanted):
            kind = table.kind
            if isinstance(values, POSES + POINTS) and type(values) is not kind:
                raise InputError(
                    f"key {wanted[0]} is a {kind.__name__}; cannot give it a {type(values).__name__}"
                )
            array = np.asarray(getattr(values, "array", values), np.float64)
            if len(rows) != len(wanted) or array.size != len(rows) * kind.storage:
                raise InputError(
                    f"{len(rows)} {kind.__name__} need an array of shape ({len(rows)}, {kind.storage}), "
                    f"not {array.shape}"
                )
            if not np.isfinite(array).all():
                raise InputError(f"new values of {kind.__name__} are not finite")
            table.values.rows[rows] = array.reshape(len(rows), kind.storage)

    def __len__(self) -> int:
        return sum(len(table) for table in self._tables)

    def __contains__(self, key: object) -> bool:
        return isinstance(key, (int, np.integer)) and self._index.find_one(int(key)) >= 0

    def _copy_variables(self, twin: VariableSet) -> None:
        twin._index = self._index.copy()
        twin._tables = [table.copy() for table in self._tables]
        twin._table_of = dict(self._table_of)
        twin._slot_table, twin._slot_row = self._slot_table.copy(), self._slot_row.copy()
        twin._structure = self._structure

    def _slots(self, keys: Index) -> Index:
        slots = self._index.find(keys)
        if slots.size and slots.min() < 0:
            raise InputError(f"the graph has no variable with key {keys[slots < 0][0]}")
        return slots

    def _locate(self, key: int) -> tuple[VariableTable, int]:
        slot = self._index.find_one(int(key))
        if slot < 0:
            raise InputError(f"the graph has no variable with key {key}")
        return self._tables[self._slot_table.rows[slot]], int(self._slot_row.rows[slot])

    def _by_table(self, keys: Index) -> Iterator[tuple[VariableTable, Index, Index]]:
        """For each kind among `keys`: its table, the rows in it, and the places in `keys`."""
        slots = self._slots(keys)
        tables = self._slot_table.rows[slots]
        for number in np.unique(tables):
            places = np.flatnonzero(tables == number)
            yield self._tables[number], self._slot_row.rows[slots[places]], places
