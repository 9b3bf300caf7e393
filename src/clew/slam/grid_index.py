"""Which keyframes stand near a place? An index that is updated as they are added, moved and taken out."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Accept = Callable[[Index], NDArray[np.bool_]]


class GridIndex:
    """Points in the plane with numbers of their own, in square cells.

    What is asked costs as much as there are points near, however many there are elsewhere; a move costs only where a
    point gets into another cell.

    Args:
        cell: side of a cell, metres; about the distance that is asked for most.
    """

    def __init__(self, cell: float) -> None:
        self._cell = cell
        self._members: dict[tuple[int, int], set[int]] = {}
        self._where = np.empty((0, 2), dtype=np.int64)  # cell of each number
        self._points = np.empty((0, 2))
        self._present = np.empty(0, dtype=np.bool_)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def put(self, numbers: Index, points: Array) -> None:
        """Add points, or move those that are there already.

        Args:
            numbers: ``(n,)`` of the points, none twice.
            points: ``(n, 2)`` metres.
        """
        self._make_room(int(numbers.max(initial=-1)) + 1)
        cells = self._cells(points)
        known = self._present[numbers]
        changed = ~known | (self._where[numbers] != cells).any(axis=1)
        for number, was_known, cell in zip(
            numbers[changed].tolist(), known[changed].tolist(), cells[changed].tolist(), strict=True
        ):
            if was_known:
                self._leave(number)
            self._members.setdefault((cell[0], cell[1]), set()).add(number)
        self._where[numbers] = cells
        self._points[numbers] = points
        self._present[numbers] = True
        self._count += int((~known).sum())

    def remove(self, numbers: Index) -> None:
        """Take points out; those that are not there are passed over."""
        numbers = numbers[numbers < len(self._present)]
        numbers = numbers[self._present[numbers]]
        for number in numbers.tolist():
            self._leave(number)
        self._present[numbers] = False
        self._count -= len(numbers)

    def within(self, point: Array, radius: float) -> Index:
        """Numbers, ascending, of the points at most ``radius`` metres from ``(2,)`` a point."""
        low, high = self._cells(np.array([point - radius, point + radius]))
        if (high[0] - low[0] + 1) * (high[1] - low[1] + 1) > len(self._members):
            near = np.flatnonzero(self._present)  # a disc that covers most of them
        else:
            near = self._in_cells(product(range(low[0], high[0] + 1), range(low[1], high[1] + 1)))
        return near[self._distances(point, near) <= radius]

    def nearest(self, point: Array, count: int, accept: Accept) -> Index:
        """Numbers of the nearest ``count`` points that are accepted, or of as many as there are, nearest first.

        Args:
            point: ``(2,)`` metres.
            count: how many.
            accept: tells of ``(n,)`` numbers which may be among them, ``(n,)``.
        """
        radius = self._cell
        while True:
            found = self.within(point, radius)
            near = found[accept(found)]
            if len(near) >= count or len(found) == len(self):
                order = np.argsort(self._distances(point, near), kind="stable")
                return near[order[:count]]
            radius *= 2.0

    def _distances(self, point: Array, numbers: Index) -> Array:
        return np.asarray(np.hypot(*(self._points[numbers] - point).T))

    def _cells(self, points: Array) -> Index:
        return np.floor(points / self._cell).astype(np.int64)

    def _in_cells(self, cells: product[tuple[int, int]]) -> Index:
        found: list[int] = []
        for cell in cells:
            found.extend(self._members.get(cell, ()))
        return np.array(sorted(found), dtype=np.int64)

    def _leave(self, number: int) -> None:
        """Take a point out of its cell; empty cells go."""
        x, y = self._where[number].tolist()
        members = self._members[x, y]
        members.discard(number)
        if not members:
            del self._members[x, y]

    def _make_room(self, size: int) -> None:
        """Rows for numbers below ``size``; the arrays double, so that each row is copied about once."""
        if size <= len(self._present):
            return
        grown = max(size, 2 * len(self._present)) - len(self._present)
        self._where = np.concatenate([self._where, np.zeros((grown, 2), dtype=np.int64)])
        self._points = np.concatenate([self._points, np.zeros((grown, 2))])
        self._present = np.concatenate([self._present, np.zeros(grown, dtype=np.bool_)])
