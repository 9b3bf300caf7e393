"""From the keys that users know to the slots that arrays know."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.graph.growing import Growing

Keys = NDArray[np.int64]


class KeyIndex:
    """Slot of each key; slots count variables in the order in which they were added and are never reused.

    As long as keys are 0, 1, 2, ... a key *is* its slot and nothing is looked up. The first other key
    switches to a dictionary for single look-ups and a sorted copy, made when needed, for batches.
    """

    def __init__(self) -> None:
        self._keys: Growing[np.int64] = Growing((), np.int64)
        self._alive: Growing[np.bool_] = Growing((), np.bool_)
        self._slot_of: dict[int, int] | None = None  # None while keys are their own slots
        self._sorted: tuple[Keys, Keys] | None = None
        self.next_key = 0

    def __len__(self) -> int:
        return len(self._keys)

    @property
    def keys(self) -> Keys:
        """Key of each slot, removed ones included."""
        return self._keys.rows

    def add(self, keys: Keys) -> Keys:
        """Give new slots to new keys.

        Raises:
            InputError: a key is in use or occurs twice.
        """
        start = len(self._keys)
        slots = np.arange(start, start + len(keys))
        if len(keys) > 1 and len(np.unique(keys)) < len(keys):
            names, times = np.unique(keys, return_counts=True)
            raise InputError(
                f"key {names[times > 1][0]} occurs twice among the new variables; keys must be unique"
            )
        taken = self.find(keys) >= 0
        if taken.any():
            raise InputError(f"key {keys[taken][0]} is in use already; choose another or leave `key` out")
        if self._slot_of is None and not np.array_equal(keys, slots):
            alive = np.flatnonzero(self._alive.rows)
            self._slot_of = dict(zip(alive.tolist(), alive.tolist(), strict=True))
        if self._slot_of is not None:
            self._slot_of.update(zip(keys.tolist(), slots.tolist(), strict=True))
        self._sorted = None
        self._keys.append(keys)
        self._alive.extend(len(keys))[:] = True
        if len(keys):
            self.next_key = max(self.next_key, int(keys.max()) + 1)
        return slots

    def remove(self, slots: Keys) -> None:
        """Forget the keys of these slots."""
        self._alive.rows[slots] = False
        if self._slot_of is not None:
            for key in self._keys.rows[slots].tolist():
                del self._slot_of[key]
        self._sorted = None

    def find_one(self, key: int) -> int:
        """Slot of a key, or -1."""
        if self._slot_of is not None:
            return self._slot_of.get(key, -1)
        return key if 0 <= key < len(self._keys) and self._alive.rows[key] else -1

    def find(self, keys: Keys) -> Keys:
        """Slots of keys of any shape, -1 where unknown."""
        if self._slot_of is None:
            known = (keys >= 0) & (keys < len(self._keys))
            slots = np.where(known, keys, 0)
            if len(self._keys):
                known &= self._alive.rows[slots]
            return np.where(known, slots, -1)
        if keys.size <= 16:
            found = [self._slot_of.get(key, -1) for key in keys.ravel().tolist()]
            return np.array(found, np.int64).reshape(keys.shape)
        if self._sorted is None:
            alive = np.flatnonzero(self._alive.rows)
            order = alive[np.argsort(self._keys.rows[alive], kind="stable")]
            self._sorted = (self._keys.rows[order], order)
        names, order = self._sorted
        if not len(names):
            return np.full(keys.shape, -1, np.int64)
        place = np.minimum(np.searchsorted(names, keys), len(names) - 1)
        return np.where(names[place] == keys, order[place], -1)

    def copy(self) -> KeyIndex:
        """An independent copy."""
        twin = object.__new__(KeyIndex)
        twin._keys, twin._alive = self._keys.copy(), self._alive.copy()
        twin._slot_of = None if self._slot_of is None else dict(self._slot_of)
        twin._sorted = self._sorted
        twin.next_key = self.next_key
        return twin


def as_keys(keys: Any, what: str = "keys") -> Keys:
    """Integers of any shape as int64.

    Raises:
        InputError: not integers.
    """
    array = np.asarray(keys)
    if array.size == 0:
        return array.astype(np.int64)
    if array.dtype.kind not in "iu":
        raise InputError(f"{what} must be integers as `add_pose` and `add_point` return them, not {keys!r}")
    return array.astype(np.int64, copy=False)
