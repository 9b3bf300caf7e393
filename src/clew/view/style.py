"""The look that all pictures share, and how they are laid out and written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from clew.io import atomic_write_binary

DPI = 160

# A map in greys leaves the colours to what lies upon it; blue and orange stay apart for eyes that confuse red
# and green.
PAPER = "#ffffff"
INK = "#1b1f27"
MUTED = "#687080"
UNKNOWN = "#e4e6ea"
FREE = "#ffffff"
OCCUPIED = "#14171d"
TRAJECTORY = "#1668d6"
ODOMETRY = "#a0714f"
CLOSURE = "#e8590c"
REJECTED = "#c2255c"
LANDMARK = "#0b7285"
OBSERVATION = "#66a9b5"
UNCERTAINTY = "#7048e8"


@dataclass(frozen=True)
class Theme:
    """The colours of a picture, by what they stand for; all of them are `#rrggbb`.

    Each pair that has to be told apart differs in lightness too, so that it stays apart for colour-blind eyes
    and in a grey print; `robots` are Okabe and Ito's (2008), which were chosen for that.
    """

    paper: str = PAPER
    ink: str = INK
    muted: str = MUTED
    faint: str = "#d5d9e0"
    unknown: str = UNKNOWN
    free: str = FREE
    occupied: str = OCCUPIED
    trajectory: str = TRAJECTORY
    odometry: str = ODOMETRY
    closure: str = CLOSURE
    rejected: str = REJECTED
    landmark: str = LANDMARK
    observation: str = OBSERVATION
    uncertainty: str = UNCERTAINTY
    robots: tuple[str, ...] = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#7a5c00", "#56b4e9")

    def robot(self, number: int) -> str:
        """The colour of one of several robots."""
        return self.robots[number % len(self.robots)]


LIGHT = Theme()
DARK = Theme(
    paper="#12151b", ink="#e8ebf0", muted="#9aa3b2", faint="#343a45", unknown="#2a2f38", free="#12151b",
    occupied="#e8ebf0", trajectory="#63a8ff", odometry="#c99d7b", closure="#ff9248", rejected="#ff6f9f",
    landmark="#5fd3e0", observation="#4b8d9a", uncertainty="#b49bff",
    robots=("#56b4e9", "#ff9248", "#2fd0a0", "#e8a6cb", "#f0e442", "#8f9dff"),
)  # fmt: skip

LINE_HEIGHT = 30  # of a row of the legend, pixels
MARGIN = 40  # around everything, pixels
_BAR_LENGTHS = (1.0, 2.0, 5.0)


def font(points: float, bold: bool = False) -> FontProperties:
    """The typeface of all pictures: it comes with matplotlib, so that a picture looks the same everywhere."""
    return FontProperties(family="DejaVu Sans", size=points, weight="bold" if bold else "normal")


class _Pixels(Artist):
    """An image that is copied as it is; matplotlib's own would resample it in floats, at 20 times the memory."""

    def __init__(self, pixels: NDArray[np.uint8], left: int, bottom: int) -> None:
        super().__init__()
        opaque = np.full((*pixels.shape[:2], 1), 255, dtype=np.uint8)
        self._rgba = np.concatenate([pixels, opaque], axis=2)[::-1]  # the renderer's rows rise with y
        self._left, self._bottom = left, bottom
        self.set_zorder(-1)

    def draw(self, renderer: RendererBase) -> None:
        """Copy the pixels to the canvas."""
        renderer.draw_image(renderer.new_gc(), self._left, self._bottom, self._rgba)


class Sheet:
    """A picture of `width` x `height` pixels; everything is placed in pixels from its lower left corner."""

    def __init__(self, width: int, height: int, theme: Theme = LIGHT, background: str | None = None) -> None:
        self.width, self.height, self.theme = width, height, theme
        background = background or theme.paper
        self.figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor=background)
        self._canvas: Any = FigureCanvasAgg(self.figure)  # matplotlib gives it no types

    def axes(self, left: int, bottom: int, width: int, height: int) -> Axes:
        """Axes without frame or ticks."""
        axes = self.figure.add_axes(
            (left / self.width, bottom / self.height, width / self.width, height / self.height))
        axes.set_axis_off()
        return axes

    def fill(self, left: int, bottom: int, width: int, height: int, color: str) -> None:
        """A plain rectangle behind everything else."""
        self._rectangle(left, bottom, width, height, color, zorder=-2)

    def image(self, pixels: NDArray[np.uint8], left: int, bottom: int) -> None:
        """An image ``(height, width, 3)`` pixel by pixel, below all lines; its row 0 is at the top."""
        self.figure.add_artist(_Pixels(pixels, left, bottom))

    def text(self, x: float, y: float, text: str, points: float, *, color: str | None = None, bold: bool = False,
             align: str = "left") -> None:
        """One line of text on its baseline; in the theme's ink unless a colour is given."""
        self.figure.text(x / self.width, y / self.height, text, fontproperties=font(points, bold),
                         color=color or self.theme.ink, ha=align, va="baseline", parse_math=False)

    def scale_bar(self, right: float, y: float, pixels_per_metre: float, longest: float) -> None:
        """A bar of a round length of at most `longest` pixels that ends at `right`, its length above it."""
        metres = round_length(longest / pixels_per_metre)
        width, height = metres * pixels_per_metre, 5
        self._rectangle(right - width, y, width, height, self.theme.ink, zorder=1)
        self.text(right - width / 2, y + 12, format_metres(metres), 8.5, align="center")

    def legend(self, handles: Sequence[Line2D], left: int, top: int, columns: int) -> None:
        """What the lines and markers mean, in columns below `top`."""
        box = self.figure.legend(
            handles=list(handles), loc="upper left", bbox_to_anchor=(left / self.width, top / self.height),
            ncols=columns, frameon=False, prop=font(9), borderpad=0.0, borderaxespad=0.0, handlelength=2.4,
            handletextpad=0.7, columnspacing=2.2, labelspacing=0.55)
        for label in box.get_texts():
            label.set_color(self.theme.ink)

    def _rectangle(
        self, left: float, bottom: float, width: float, height: float, color: str, zorder: int
    ) -> None:
        self.figure.add_artist(Rectangle(
            (left / self.width, bottom / self.height), width / self.width, height / self.height,
            transform=self.figure.transFigure, facecolor=color, edgecolor="none", zorder=zorder))

    def pixels(self) -> NDArray[np.uint8]:
        """``(height, width, 3)`` the picture as it will be written; row 0 is at the top."""
        self._canvas.draw()
        return np.array(self._canvas.buffer_rgba(), dtype=np.uint8)[..., :3]

    def save(self, path: Path) -> None:
        """Write the picture as PNG; the bytes depend on nothing but what was drawn."""
        save_figure(self.figure, path)


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as PNG, in its own size and colours; the bytes depend on nothing but what was drawn.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_write_binary(Path(path)) as file:
        FigureCanvasAgg(figure).print_png(file, metadata={"Software": None})  # type: ignore[no-untyped-call]  # matplotlib gives it no types


def counted(number: int, noun: str) -> str:
    """A number with its noun: ``1 pose``, ``1,728 poses``."""
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def round_length(longest: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above `longest`."""
    power = 10.0 ** np.floor(np.log10(longest))
    return float(max(length * power for length in _BAR_LENGTHS if length * power <= longest * (1.0 + 1e-9)))


def format_metres(length: float) -> str:
    """A length in metres, or in kilometres or centimetres where that reads better."""
    if length >= 1000.0:
        return f"{length / 1000.0:g} km"
    return f"{length:g} m" if length >= 1.0 else f"{length * 100.0:g} cm"
