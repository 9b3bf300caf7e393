"""All variables of one kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.graph.growing import Growing

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Variables:
    """All variables of one kind, in the order of addition.

    Attributes:
        kind: their manifold.
        keys: ``(N,)``.
        values: ``(N, storage)``.
        constant: ``(N,)`` whether each is held fixed.
        order: ``(N,)`` numbers that sort the variables of all kinds by their addition.
    """

    kind: type[Any]
    keys: Index
    values: Array
    constant: NDArray[np.bool_]
    order: Index


class VariableTable:
    """Values of one kind in one growing array, with the slot and the constant flag of each row.

    Rows of removed variables stay, marked dead, until they are the majority.
    """

    def __init__(self, kind: type[Any]) -> None:
        self.kind = kind
        self.values: Growing[np.float64] = Growing((kind.storage,), np.float64)
        self.slots: Growing[np.int64] = Growing((), np.int64)
        self.constant: Growing[np.bool_] = Growing((), np.bool_)
        self.alive: Growing[np.bool_] = Growing((), np.bool_)
        self.dead = 0

    def __len__(self) -> int:
        return len(self.values) - self.dead

    def append(self, values: Array, slots: Index, constant: bool) -> Index:
        """Add variables and return their rows."""
        start = len(self.values)
        self.values.append(values)
        self.slots.append(slots)
        self.constant.extend(len(slots))[:] = constant
        self.alive.extend(len(slots))[:] = True
        return np.arange(start, start + len(slots))

    def live_rows(self) -> Index:
        """Rows in use, in the order of addition."""
        return np.flatnonzero(self.alive.rows) if self.dead else np.arange(len(self.values))

    def remove(self, rows: Index) -> None:
        """Mark rows dead."""
        self.alive.rows[rows] = False
        self.dead += len(rows)

    def compact(self) -> None:
        """Drop dead rows; rows move, slots stay."""
        rows = self.live_rows()
        for column in (self.values, self.slots, self.constant, self.alive):
            column.replace(column.rows[rows])
        self.dead = 0

    def copy(self) -> VariableTable:
        """An independent copy."""
        twin = object.__new__(VariableTable)
        twin.kind, twin.dead = self.kind, self.dead
        twin.values, twin.slots = self.values.copy(), self.slots.copy()
        twin.constant, twin.alive = self.constant.copy(), self.alive.copy()
        return twin
