"""All factors that can be evaluated together."""

from __future__ import annotations

import copy
from collections.abc import Hashable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.graph.factor import Factor
from clew.graph.growing import Growing

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PER_MEASUREMENT = ("keys", "measurement", "information")


def signature(factor: Factor) -> Hashable:
    """What two factors must have in common to share a block: everything but keys, measurement and
    information."""
    shared: list[Hashable] = [type(factor), factor.measurement.shape[1:], factor.information.shape[1:]]
    for name, value in vars(factor).items():
        if name in _PER_MEASUREMENT:
            continue
        if isinstance(value, np.ndarray):
            shared.append((name, value.shape, value.tobytes()))
        else:
            try:
                hash(value)
            except TypeError:  # something that only its owner can compare: a block of its own
                shared.append((name, id(value)))
            else:
                shared.append((name, value))
    return tuple(shared)


class FactorTable:
    """Factors of one signature in growing arrays; `block` shows them as one `Factor`."""

    def __init__(self, prototype: Factor) -> None:
        self._prototype = prototype
        self.keys: Growing[np.int64] = Growing(prototype.keys.shape[1:], np.int64)
        self._measurement: Growing[np.float64] = Growing(prototype.measurement.shape[1:], np.float64)
        self._information: Growing[np.float64] = Growing(prototype.information.shape[1:], np.float64)
        self.ids: Growing[np.int64] = Growing((), np.int64)
        self.alive: Growing[np.bool_] = Growing((), np.bool_)
        self.dead = 0
        self._block: Factor | None = None

    def __len__(self) -> int:
        return len(self.ids) - self.dead

    @property
    def prototype(self) -> Factor:
        """Any factor of this signature."""
        return self._prototype

    def append(self, factor: Factor, ids: Index) -> Index:
        """Add a factor's measurements and return their rows."""
        start = len(self.ids)
        self.keys.append(factor.keys)
        self._measurement.append(factor.measurement)
        self._information.append(factor.information)
        self.ids.append(ids)
        self.alive.extend(len(ids))[:] = True
        self._block = None
        return np.arange(start, start + len(ids))

    def remove(self, rows: Index) -> None:
        """Mark rows dead."""
        self.alive.rows[rows] = False
        self.dead += len(rows)
        self._block = None

    def live_rows(self) -> Index:
        """Rows in use, in the order of addition."""
        return np.flatnonzero(self.alive.rows) if self.dead else np.arange(len(self.ids))

    def live_ids(self) -> Index:
        """Factor ids of `block`, row by row."""
        return self.ids.rows[self.alive.rows] if self.dead else self.ids.rows

    def compact(self) -> None:
        """Drop dead rows; rows move, ids stay."""
        rows = self.live_rows()
        for column in (self.keys, self._measurement, self._information, self.ids, self.alive):
            column.replace(column.rows[rows])
        self.dead = 0
        self._block = None

    def block(self) -> Factor:
        """The live factors as one read-only `Factor`."""
        if self._block is None:
            self._block = self.select(self.alive.rows if self.dead else slice(None))
        return self._block

    def touching(self, keys: Index) -> Index:
        """Rows of the live factors that refer to any of the keys."""
        return np.flatnonzero(np.isin(self.keys.rows, keys).any(axis=1) & self.alive.rows)

    def select(self, rows: Index | NDArray[np.bool_] | slice) -> Factor:
        """Some rows as one read-only `Factor`."""
        block: Any = copy.copy(self._prototype)
        columns = (self.keys.rows, self._measurement.rows, self._information.rows)
        for name, column in zip(_PER_MEASUREMENT, columns, strict=True):
            view = column[rows]
            view.flags.writeable = False
            object.__setattr__(block, name, view)  # a factor may be a frozen dataclass
        chosen: Factor = block
        return chosen

    def copy(self) -> FactorTable:
        """An independent copy."""
        twin = object.__new__(FactorTable)
        twin._prototype, twin.dead, twin._block = self._prototype, self.dead, None
        twin.keys, twin.ids, twin.alive = self.keys.copy(), self.ids.copy(), self.alive.copy()
        twin._measurement, twin._information = self._measurement.copy(), self._information.copy()
        return twin
