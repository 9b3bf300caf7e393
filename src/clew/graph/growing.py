"""An array that grows at its end at amortised constant cost."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

Scalar = TypeVar("Scalar", bound=np.generic)


class Growing(Generic[Scalar]):
    """Rows of one shape; capacity doubles when it is used up, so a million appends copy each row about
    once."""

    __slots__ = ("_data", "_size")

    def __init__(self, shape: tuple[int, ...], dtype: DTypeLike) -> None:
        self._data: NDArray[Any] = np.empty((4, *shape), dtype)
        self._size = 0

    def __len__(self) -> int:
        return self._size

    @property
    def rows(self) -> NDArray[Scalar]:
        """View of the rows in use; valid until the next `append`."""
        return self._data[: self._size]

    def append(self, rows: NDArray[Any]) -> None:
        """Add ``(N, *shape)`` rows at the end."""
        self.extend(len(rows))[:] = rows

    def extend(self, count: int) -> NDArray[Scalar]:
        """Add `count` rows with undefined content at the end and return a view of them."""
        size = self._size + count
        if size > len(self._data):
            data = np.empty((max(size, 2 * len(self._data)), *self._data.shape[1:]), self._data.dtype)
            data[: self._size] = self.rows
            self._data = data
        start, self._size = self._size, size
        return self._data[start:size]

    def detach(self) -> None:
        """Move to a place of its own, so that what is written to rows from now on does not show in older views."""
        self._data = self._data.copy()

    def replace(self, rows: NDArray[Any]) -> None:
        """Hold a copy of `rows` and nothing else."""
        self._data = np.array(rows, dtype=self._data.dtype, copy=True)
        self._size = len(rows)
        if not self._size:
            self._data = np.empty((4, *self._data.shape[1:]), self._data.dtype)

    def copy(self) -> Growing[Scalar]:
        """An independent copy."""
        twin = object.__new__(Growing)
        twin._data = np.empty(0)
        twin._data = self._data[: max(self._size, 4)].copy()
        twin._size = self._size
        return twin
