"""An occupancy grid as pixels."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from clew.mapping import OccupancyGrid
from clew.view.style import LIGHT, Theme

# Probabilities at which a cell is drawn fully free and fully occupied; weaker evidence fades towards unknown.
_SURELY_FREE = 0.25
_SURELY_OCCUPIED = 0.7
_LEVELS = 1000  # probabilities that are told apart


def grid_pixels(grid: OccupancyGrid, theme: Theme = LIGHT) -> NDArray[np.uint8]:
    """``(H, W, 3)`` colours of the cells; row 0 is the highest y, as in a picture."""
    return _coloured(_levels(grid), theme)


def fitted(grid: OccupancyGrid, longest: int, theme: Theme = LIGHT) -> tuple[NDArray[np.uint8], float]:
    """The cells' colours at the largest size of at most `longest` pixels a side, and metres per pixel.

    A cell becomes a square of whole pixels; where there are more cells than pixels, a pixel becomes a square
    of whole cells. The lower left corner is that of the grid.
    """
    cells = max(grid.shape)
    if cells <= longest:
        factor = longest // cells
        return enlarged(grid_pixels(grid, theme), factor), grid.resolution / factor
    factor = -(-cells // longest)
    return _coloured(_reduced(_levels(grid), factor), theme), grid.resolution * factor


def enlarged(pixels: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Each pixel as a square of `factor` pixels."""
    return np.repeat(np.repeat(pixels, factor, axis=0), factor, axis=1)


def _levels(grid: OccupancyGrid) -> NDArray[np.uint16]:
    """``(H, W)`` probabilities in steps of one in a thousand, the highest y first."""
    return np.rint(grid.probabilities()[::-1] * _LEVELS).astype(np.uint16)


def _coloured(levels: NDArray[np.uint16], theme: Theme) -> NDArray[np.uint8]:
    stops = (_SURELY_FREE, 0.5, np.nextafter(0.5, 1.0), _SURELY_OCCUPIED)
    unknown, free, occupied = (np.array(to_rgb(c)) for c in (theme.unknown, theme.free, theme.occupied))
    colours = np.stack([free, unknown, 0.5 * (unknown + occupied), occupied])
    steps = np.arange(_LEVELS + 1) / _LEVELS
    table = np.stack([np.interp(steps, stops, colours[:, channel]) for channel in range(3)], axis=-1)
    return np.asarray(np.round(255.0 * table).astype(np.uint8)[levels])


def _reduced(levels: NDArray[np.uint16], factor: int) -> NDArray[np.uint16]:
    """Each square of `factor` cells as its likeliest wall, so that thin walls stay; the rim is unknown."""
    rows, cols = (-(-length // factor) for length in levels.shape)
    padded = np.full((rows * factor, cols * factor), _LEVELS // 2, dtype=np.uint16)
    padded[rows * factor - levels.shape[0]:, :levels.shape[1]] = levels
    return np.asarray(padded.reshape(rows, factor, cols, factor).max(axis=(1, 3)), dtype=np.uint16)
