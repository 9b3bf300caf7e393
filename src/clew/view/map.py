"""The map alone."""

from __future__ import annotations

from pathlib import Path

from clew.mapping import OccupancyGrid
from clew.view.raster import enlarged, grid_pixels
from clew.view.style import LIGHT, MARGIN, Sheet, Theme

_SMALLEST = 1000  # pixels along the longer side, reached by drawing each cell as a larger square
_FOOT = 64  # strip for the scale bar, pixels


def save_map_png(path: str | Path, grid: OccupancyGrid, theme: Theme = LIGHT) -> None:
    """Write the map as a picture: free white, occupied black, unknown grey, with a scale bar below.

    A cell is one pixel, or a square of pixels where the map is small. The map's upper left corner is that of
    the picture.

    Args:
        path: the PNG file to write.
        grid: the map.
        theme: `LIGHT` or `DARK`, where free is dark and occupied bright.

    Raises:
        InputError: the file cannot be written.
    """
    rows, cols = grid.shape
    factor = max(1, -(-_SMALLEST // max(rows, cols)))
    width, height = cols * factor, rows * factor
    sheet = Sheet(max(width, 240), height + _FOOT, theme, theme.unknown)
    sheet.image(enlarged(grid_pixels(grid, theme), factor), 0, _FOOT)
    right = sheet.width - MARGIN
    sheet.scale_bar(right, 20, factor / grid.resolution, min(0.3 * sheet.width, 400))
    sheet.save(Path(path))
