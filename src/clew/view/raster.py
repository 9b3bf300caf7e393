"""An occupancy grid as pixels."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from clew.mapping import OccupancyGrid
from clew.view.style import FREE, OCCUPIED, UNKNOWN

# Probabilities at which a cell is drawn fully free and fully occupied; weaker evidence fades towards unknown.
_SURELY_FREE = 0.25
_SURELY_OCCUPIED = 0.7
_LEVELS = 1000  # probabilities that are told apart


def grid_pixels(grid: OccupancyGrid) -> NDArray[np.uint8]:
    """``(H, W, 3)`` colours of the cells; row 0 is the highest y, as in a picture."""
    stops = (_SURELY_FREE, 0.5, np.nextafter(0.5, 1.0), _SURELY_OCCUPIED)
    unknown, free, occupied = (np.array(to_rgb(colour)) for colour in (UNKNOWN, FREE, OCCUPIED))
    colours = np.stack([free, unknown, 0.5 * (unknown + occupied), occupied])
    levels = np.arange(_LEVELS + 1) / _LEVELS
    table = np.stack([np.interp(levels, stops, colours[:, channel]) for channel in range(3)], axis=-1)
    level_of_cell = np.rint(grid.probabilities()[::-1] * _LEVELS).astype(np.uint16)
    return np.asarray(np.round(255.0 * table).astype(np.uint8)[level_of_cell])


def fitted(grid: OccupancyGrid, longest: int) -> tuple[NDArray[np.uint8], float]:
    """The cells' colours at the largest size of at most `longest` pixels a side, and metres per pixel.

    A cell becomes a square of whole pixels; where there are more cells than pixels, a pixel becomes a square
    of whole cells. The lower left corner is that of the grid.
    """
    pixels = grid_pixels(grid)
    cells = max(grid.shape)
    if cells <= longest:
        factor = longest // cells
        return enlarged(pixels, factor), grid.resolution / factor
    factor = -(-cells // longest)
    return _reduced(pixels, factor), grid.resolution * factor


def enlarged(pixels: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Each pixel as a square of `factor` pixels."""
    return np.repeat(np.repeat(pixels, factor, axis=0), factor, axis=1)


def _reduced(pixels: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """Each square of `factor` pixels as its darkest one, so that thin walls stay; the rim is unknown."""
    rows, cols = (-(-length // factor) for length in pixels.shape[:2])
    padded = np.empty((rows * factor, cols * factor, 3), dtype=np.uint8)
    padded[...] = np.round(255.0 * np.array(to_rgb(UNKNOWN)))
    padded[rows * factor - pixels.shape[0]:, :pixels.shape[1]] = pixels
    return np.asarray(padded.reshape(rows, factor, cols, factor, 3).min(axis=(1, 3)), dtype=np.uint8)
