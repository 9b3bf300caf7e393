"""Helpers of the tests of pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from numpy.typing import NDArray

Pixels = NDArray[np.int16]


def pixels_of(path: Path) -> Pixels:
    """``(height, width, 3)`` colours 0 to 255; row 0 is at the top."""
    return (255.0 * imread(path)[..., :3] + 0.5).astype(np.int16)


def rgb(colour: str) -> Pixels:
    return np.round(255.0 * np.array(to_rgb(colour))).astype(np.int16)


def close_to(pixels: Pixels, colour: str, tolerance: int = 40) -> NDArray[np.bool_]:
    """Where a picture has about a colour."""
    near = np.abs(pixels - rgb(colour)) <= tolerance
    return near[..., 0] & near[..., 1] & near[..., 2]
