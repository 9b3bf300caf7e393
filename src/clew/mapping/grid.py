"""The occupancy grid: what a finished map is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError

Array = NDArray[np.float64]

#: Narrower than anything that a robot drives through, metres.
STRAY_WIDTH = 0.25
KEPT_SHARE = 0.95


class CellState(IntEnum):
    """State of a cell in `OccupancyGrid.states`."""

    FREE = 0
    OCCUPIED = 1
    UNKNOWN = 2


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A map of square cells, each with the log-odds of being occupied; row 0 is the lowest y.

    Attributes:
        log_odds: ``(H, W)`` natural logarithm of p / (1 - p), float32; exactly 0 where nothing was observed.
        resolution: side of a cell, metres.
        origin: ``(2,)`` world position of the outer corner of cell (0, 0), metres.

    Raises:
        InputError: a shape is wrong, or the resolution is not positive.
    """

    log_odds: NDArray[np.float32]
    resolution: float
    origin: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "log_odds", np.asarray(self.log_odds, dtype=np.float32))
        object.__setattr__(self, "origin", np.asarray(self.origin, dtype=np.float64))
        if self.log_odds.ndim != 2 or self.origin.shape != (2,):
            raise InputError(f"an occupancy grid needs log_odds (H, W) and origin (2,); got "
                             f"{self.log_odds.shape} and {self.origin.shape}")
        if not (np.isfinite(self.resolution) and self.resolution > 0.0):
            raise InputError(f"the resolution of an occupancy grid must be positive, not {self.resolution}")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns ``(H, W)``."""
        return (self.log_odds.shape[0], self.log_odds.shape[1])

    @property
    def observed(self) -> NDArray[np.bool_]:
        """``(H, W)`` True where at least one ray says something about the cell."""
        return np.not_equal(self.log_odds, 0.0)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """World coordinates ``(x_min, x_max, y_min, y_max)`` of the outer border, metres."""
        x, y = (float(value) for value in self.origin)
        rows, cols = self.shape
        return (x, x + cols * self.resolution, y, y + rows * self.resolution)

    def probabilities(self) -> NDArray[np.float32]:
        """``(H, W)`` probability that each cell is occupied; 0.5 where nothing was observed."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.log_odds)), dtype=np.float32)

    def states(self) -> NDArray[np.uint8]:
        """``(H, W)`` the likelier state of each cell, or unknown, as numbers of `CellState`."""
        states = np.full(self.shape, CellState.UNKNOWN, dtype=np.uint8)
        states[self.log_odds < 0.0] = CellState.FREE
        states[self.log_odds > 0.0] = CellState.OCCUPIED
        return states

    def world_to_cell(self, p_world: Array) -> NDArray[np.int64]:
        """Cells ``(..., 2)`` as (row, column) that hold world points ``(..., 2)``; may be outside."""
        cells = np.floor((np.asarray(p_world, dtype=np.float64) - self.origin) / self.resolution)
        return cells[..., ::-1].astype(np.int64)

    def cell_to_world(self, cells: NDArray[np.int64]) -> Array:
        """World positions ``(..., 2)`` of the centres of cells ``(..., 2)`` given as (row, column)."""
        return self.origin + (np.asarray(cells)[..., ::-1] + 0.5) * self.resolution

    def cropped(self, padding: float = 0.0) -> OccupancyGrid:
        """The part that holds what was observed, and `padding` metres around.

        Stray rays do not stretch the map: rows and columns at the rim in which less than `STRAY_WIDTH` was
        observed are left out, as long as 95 % of all observed cells stay. A grid that observed nothing is
        returned as it is.
        """
        observed = self.observed
        if not observed.any():
            return self
        box = _box(observed, STRAY_WIDTH / self.resolution)
        if observed[box].sum() < KEPT_SHARE * observed.sum():
            box = _box(observed, 0.0)
        border = round(padding / self.resolution)
        corner = np.array([span.start - border for span in box])
        end = np.array([span.stop + border for span in box])
        log_odds = np.zeros(end - corner, dtype=np.float32)
        low, high = np.maximum(corner, 0), np.minimum(end, self.shape)
        inside = tuple(slice(*span) for span in zip(low - corner, high - corner, strict=True))
        log_odds[inside] = self.log_odds[low[0]:high[0], low[1]:high[1]]
        return OccupancyGrid(log_odds, self.resolution, self.origin + corner[::-1] * self.resolution)


def _box(observed: NDArray[np.bool_], fewest: float) -> tuple[slice, slice]:
    """From the first to the last row and column with at least `fewest` observed cells, and at least one."""
    spans = []
    for axis in (1, 0):
        counts = observed.sum(axis=axis)
        kept = np.flatnonzero(counts >= min(max(fewest, 1.0), counts.max()))
        spans.append(slice(int(kept[0]), int(kept[-1]) + 1))
    return spans[0], spans[1]
