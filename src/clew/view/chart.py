"""Axes with ticks, titles and units, in the look that all pictures share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from clew.view.style import DPI, Theme, font

Place: TypeAlias = Literal["best", "upper right", "upper left", "lower left", "lower right"]


def chart(
    width: int, height: int, rows: int, columns: int, theme: Theme, *, share_x: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure of `width` x `height` pixels with a grid of axes, row by row."""
    layout = ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.1, wspace=0.03, hspace=0.04)
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor=theme.paper, layout=layout)
    grid = np.atleast_1d(figure.subplots(rows, columns, sharex=share_x)).reshape(-1).tolist()
    for axes in grid:
        axes.set_facecolor(theme.paper)
        for side, spine in axes.spines.items():
            spine.set_color(theme.muted)
            spine.set_visible(side in ("left", "bottom"))
        axes.grid(color=theme.faint, linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(which="both", colors=theme.muted, labelcolor=theme.ink, length=3)
    return figure, grid


def heading(figure: Figure, title: str, theme: Theme) -> None:
    """The heading above all axes, one line."""
    if title:
        figure.suptitle(title, x=0.02, ha="left", fontproperties=font(13, bold=True), color=theme.ink)


def describe(axes: Axes, x: str, y: str, theme: Theme, title: str = "") -> None:
    """What the axes measure, with units, and the typeface of their ticks."""
    axes.set_xlabel(x, fontproperties=font(9), color=theme.ink)
    axes.set_ylabel(y, fontproperties=font(9), color=theme.ink)
    if title:
        axes.set_title(title, fontproperties=font(10, bold=True), color=theme.ink, loc="left")
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set_fontproperties(font(8))


def key_below(figure: Figure, handles: Sequence[Line2D], theme: Theme) -> None:
    """What lines and markers mean, below all axes, where they hide nothing."""
    box = figure.legend(handles=list(handles), loc="outside lower left", ncols=min(len(handles), 3), prop=font(8.5),
                        frameon=False, borderpad=0.2, columnspacing=1.6)
    for label in box.get_texts():
        label.set_color(theme.ink)


def key_to(axes: Axes, handles: Sequence[Line2D], theme: Theme, place: Place = "best") -> None:
    """What lines and markers mean, within the axes."""
    box = axes.legend(handles=list(handles), loc=place, prop=font(8.5), facecolor=theme.paper,
                      edgecolor=theme.faint, framealpha=0.9)
    for label in box.get_texts():
        label.set_color(theme.ink)
