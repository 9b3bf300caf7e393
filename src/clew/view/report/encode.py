"""Arrays and grids as text that a browser reads without a network: base64 of little-endian numbers, PNG."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

if TYPE_CHECKING:
    from clew.mapping import OccupancyGrid

Array = NDArray[np.float64]

#: Most cells a side of an embedded grid; larger ones are shown at a coarser resolution.
LONGEST_GRID = 4000
#: Most points of all embedded scans together; beyond, each scan is thinned. Four bytes a point.
MOST_POINTS = 1_600_000
#: Steps of the probability that an embedded grid tells apart; 0 is unknown.
LEVELS = 40

_TYPES = {"f4": "<f4", "i4": "<i4", "i2": "<i2", "u1": "|u1"}


def pack(values: NDArray[np.generic] | Sequence[float], kind: str) -> dict[str, str]:
    """An array of any shape, row by row, as ``{"type": kind, "data": base64}``; `kind` is f4, i4, i2 or u1."""
    flat = np.ascontiguousarray(np.asarray(values).reshape(-1), dtype=_TYPES[kind])
    return {"type": kind, "data": base64.b64encode(flat.tobytes()).decode("ascii")}


def pack_scans(scans: Sequence[Array]) -> dict[str, object]:
    """Points ``(n, 2)`` of each scan as 16-bit steps of one length, a millimetre or as much more as it takes."""
    total = sum(len(points) for points in scans)
    every = max(1, -(-total // MOST_POINTS))
    kept = [points[::every] for points in scans]
    points = np.concatenate([np.zeros((0, 2)), *kept])
    step = max(1e-3, float(np.abs(points).max(initial=0.0)) / 32767.0)
    return {
        "step": step,
        "first": pack(np.cumsum([0, *(len(p) for p in kept)]), "i4"),
        "points": pack(np.rint(points / step), "i2"),
    }


def pack_grid(grid: OccupancyGrid) -> dict[str, object]:
    """A grid as a grey PNG in a data address: 0 where nothing was observed, else 1 (free) to `LEVELS` + 1 (occupied).

    Row 0 of the picture is the highest y, as in any picture.
    """
    probability = grid.probabilities()
    levels = np.where(grid.observed, 1 + np.rint(LEVELS * probability), 0).astype(np.uint8)
    factor = max(1, -(-max(grid.shape) // LONGEST_GRID))
    if factor > 1:  # the strongest evidence of occupancy in each square, so that thin walls stay
        rows, cols = (-(-length // factor) for length in grid.shape)
        padded = np.zeros((rows * factor, cols * factor), dtype=np.uint8)
        padded[: grid.shape[0], : grid.shape[1]] = levels
        levels = padded.reshape(rows, factor, cols, factor).max(axis=(1, 3))
    with io.BytesIO() as file:
        Image.fromarray(levels[::-1]).save(file, format="PNG", compress_level=9)
        data = base64.b64encode(file.getvalue()).decode("ascii")
    return {
        "resolution": grid.resolution * factor,
        "origin": [float(value) for value in grid.origin],
        "rows": levels.shape[0],
        "cols": levels.shape[1],
        "levels": LEVELS,
        "image": "data:image/png;base64," + data,
    }
