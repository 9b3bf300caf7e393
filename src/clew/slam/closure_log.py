"""Closures about which all has been decided, in little memory: a long run sees very many."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.graph.growing import Growing
from clew.place import Closure, Verdict

VERDICTS = tuple(Verdict)
NAMES = tuple(field.name for field in fields(Closure))


class ClosureLog:
    """Closures as rows of one array, made into `Closure` again when they are asked for."""

    def __init__(self) -> None:
        self._rows: Growing[np.float64] | None = None
        self._like: Closure | None = None  # tells shapes and types

    def __len__(self) -> int:
        return 0 if self._rows is None else len(self._rows)

    def __iter__(self) -> Iterator[Closure]:
        if self._rows is not None:
            yield from map(self._unpacked, self._rows.rows)

    def count(self, verdict: Verdict) -> int:
        """How many ended with a verdict."""
        if self._rows is None:
            return 0
        column = sum(len(_flat(getattr(self._like, name))) for name in NAMES[: NAMES.index("verdict")])
        return int(np.count_nonzero(self._rows.rows[:, column] == VERDICTS.index(verdict)))

    def add(self, closures: Iterable[Closure]) -> None:
        """Append closures."""
        for closure in closures:
            row = np.concatenate([_flat(getattr(closure, name)) for name in NAMES])
            if self._rows is None:
                self._rows, self._like = Growing(row.shape, np.float64), closure
            self._rows.append(row[None])

    def forget(self, source: int) -> None:
        """Take out all closures of a source."""
        if self._rows is not None:
            other = self._rows.rows[:, NAMES.index("source")] != source
            if not other.all():
                self._rows.replace(self._rows.rows[other])

    def _unpacked(self, row: NDArray[np.float64]) -> Closure:
        values, start = [], 0
        for name in NAMES:
            like = getattr(self._like, name)
            count = len(_flat(like))
            values.append(_shaped(row[start : start + count], like))
            start += count
        return Closure(*values)


def _flat(value: Any) -> NDArray[np.float64]:
    """Numbers ``(n,)`` of one attribute."""
    if isinstance(value, Verdict):
        value = VERDICTS.index(value)
    return np.asarray(value, dtype=np.float64).reshape(-1)


def _shaped(numbers: NDArray[np.float64], like: Any) -> Any:
    """An attribute of the kind of another."""
    if isinstance(like, np.ndarray):
        return numbers.reshape(like.shape).copy()
    if isinstance(like, tuple):
        return tuple(numbers.tolist())
    if isinstance(like, Verdict):
        return VERDICTS[int(numbers[0])]
    return type(like)(numbers[0])
