"""A whole run in one picture: map, odometry, trajectory and loop closures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from clew.geometry import so2
from clew.mapping import OccupancyGrid
from clew.view.ellipses import Ellipses, ellipse_collection, readable_ellipses
from clew.view.raster import fitted
from clew.view.style import LIGHT, LINE_HEIGHT, MARGIN, Sheet, Theme, counted

Array = NDArray[np.float64]
Pairs = NDArray[np.int64]

_LONGEST = 2000  # pixels of the map's longer side
_NARROWEST = 1000  # pixels of the picture, so that heading and legend have room
_HEAD = 120  # strip for the heading, pixels
_COLUMN = 430  # of the legend, pixels
_BAR = 320  # room for the scale bar, pixels
_DASHES = (4.0, 2.5)
_DOTS = (1.5, 2.0)

# The end fits into the start, for a run often ends where it began.
def _ends(theme: Theme) -> tuple[dict[str, Any], dict[str, Any]]:
    """Markers of start and end of a path."""
    start = {"marker": "o", "markersize": 10, "markeredgewidth": 2.2, "markerfacecolor": theme.paper,
             "markeredgecolor": theme.trajectory}
    return start, {"marker": "s", "markersize": 6, "markeredgewidth": 0.0, "markerfacecolor": theme.trajectory}


def save_overview_png(
    path: str | Path,
    *,
    grid: OccupancyGrid,
    odometry_xy: Array,
    trajectory_xy: Array,
    keyframes: Array,
    closures_accepted: Pairs,
    closures_rejected: Pairs | None = None,
    covariances: Array | None = None,
    title: str = "",
    subtitle: str = "",
    theme: Theme = LIGHT,
) -> None:
    """Write the picture of a run: the paths over the map, with what holds them together.

    The picture shows the map's extent; odometry that drifts out of it is cut off at the border, and the
    legend says so.

    Args:
        path: the PNG file to write.
        grid: the map.
        odometry_xy: ``(N, 2)`` path of the odometry alone, moved so that its first pose is the trajectory's.
        trajectory_xy: ``(M, 2)`` optimised path, in the world frame.
        keyframes: ``(K, 3)`` optimised poses ``T_world_robot`` of the keyframes.
        closures_accepted: ``(C, 2)`` keyframes tied together by loop closures, as indices into `keyframes`.
        closures_rejected: ``(R, 2)`` likewise, of closures that were taken out again.
        covariances: ``(K, 2, 2)`` covariance of the keyframes' positions, each in the frame of its pose
            (docs/conventions.md); drawn as ellipses that hold 95 %, some of them where there are many.
        title: heading, one line.
        subtitle: the run's numbers, one line below the heading.
        theme: `LIGHT` or `DARK`.

    Raises:
        InputError: the file cannot be written.
    """
    pixels, metres_per_pixel = fitted(grid, _LONGEST, theme)
    height, width = pixels.shape[:2]
    sheet_width = max(width, _NARROWEST)
    left = (sheet_width - width) // 2
    x_min, y_min = grid.origin - (left * metres_per_pixel, 0.0)
    box = (x_min, x_min + sheet_width * metres_per_pixel, y_min, y_min + height * metres_per_pixel)
    ellipses = None
    if covariances is not None:
        turn = so2.matrix(keyframes[:, 2:])
        in_world = turn @ covariances @ np.swapaxes(turn, 1, 2)
        ellipses = readable_ellipses(keyframes[:, :2], in_world, 1.0 / metres_per_pixel)
    handles = _legend(box, odometry_xy, closures_accepted, closures_rejected, ellipses, theme)
    columns = max(1, (sheet_width - 2 * MARGIN - _BAR) // _COLUMN)
    foot = 2 * MARGIN + LINE_HEIGHT * -(-len(handles) // columns)

    sheet = Sheet(sheet_width, foot + height + _HEAD, theme)
    sheet.fill(0, foot, sheet_width, height, theme.unknown)
    sheet.image(pixels, left, foot)
    axes = sheet.axes(0, foot, sheet_width, height)
    axes.set(xlim=box[:2], ylim=box[2:])
    _draw_paths(axes, odometry_xy, trajectory_xy, theme)
    _draw_closures(axes, keyframes, closures_accepted, closures_rejected, theme)
    if ellipses is not None:
        axes.add_collection(ellipse_collection(ellipses.outlines, theme.uncertainty), autolim=False)
    _draw_ends(axes, trajectory_xy, theme)

    top = sheet.height
    sheet.text(MARGIN, top - 58, title, 17, bold=True)
    sheet.text(MARGIN, top - 96, subtitle, 10, color=theme.muted)
    sheet.legend(handles, MARGIN, foot - MARGIN, columns)
    sheet.scale_bar(sheet.width - MARGIN, foot - MARGIN - LINE_HEIGHT + 6, 1.0 / metres_per_pixel, _BAR)
    sheet.save(Path(path))


def _draw_paths(axes: Axes, odometry_xy: Array, trajectory_xy: Array, theme: Theme) -> None:
    axes.plot(*odometry_xy.T, color=theme.odometry, linewidth=1.0, dashes=_DASHES, zorder=2)
    axes.plot(*trajectory_xy.T, color=theme.trajectory, linewidth=1.3, solid_joinstyle="round", zorder=3)


def _draw_closures(axes: Axes, keyframes: Array, accepted: Pairs, rejected: Pairs | None, theme: Theme) -> None:
    """Closures as lines; dots at their ends, for on an optimised path the two ends often coincide."""
    positions = keyframes[:, :2]
    if rejected is not None and len(rejected):
        axes.add_collection(LineCollection(
            list(positions[rejected]), colors=theme.rejected, linewidths=0.6, alpha=0.5,
            linestyles=[(0.0, _DOTS)], zorder=4), autolim=False)
    if len(accepted):
        ends = positions[np.unique(accepted)]
        axes.add_collection(LineCollection(
            list(positions[accepted]), colors=theme.closure, linewidths=0.9, alpha=0.85, zorder=5), autolim=False)
        axes.plot(*ends.T, linestyle="none", marker="o", markersize=2.2, markerfacecolor=theme.closure,
                  markeredgewidth=0.0, zorder=6)


def _draw_ends(axes: Axes, trajectory_xy: Array, theme: Theme) -> None:
    if len(trajectory_xy):
        for position, style in zip(trajectory_xy[[0, -1]], _ends(theme), strict=True):
            axes.plot(*position, linestyle="none", zorder=8, clip_on=False, **style)


def _legend(
    box: tuple[float, float, float, float], odometry_xy: Array, accepted: Pairs, rejected: Pairs | None,
    ellipses: Ellipses | None, theme: Theme,
) -> list[Line2D]:
    x, y = odometry_xy.T
    x_min, x_max, y_min, y_max = box
    start, end = _ends(theme)
    leaves = bool(((x < x_min) | (x > x_max) | (y < y_min) | (y > y_max)).any())
    handles = [
        Line2D([], [], color=theme.trajectory, linewidth=1.8, label="optimised trajectory"),
    ]
    if len(odometry_xy):
        handles.append(Line2D([], [], color=theme.odometry, linewidth=1.2, dashes=_DASHES,
                              label="odometry alone" + (" (leaves the picture)" if leaves else "")))
    if len(accepted):
        handles.append(Line2D([], [], color=theme.closure, linewidth=1.2, marker="o", markersize=4,
                              markeredgewidth=0.0, label=counted(len(accepted), "loop closure")))
    if rejected is not None and len(rejected):
        handles.append(Line2D([], [], color=theme.rejected, linewidth=1.0, alpha=0.7, dashes=_DOTS,
                              label=counted(len(rejected), "rejected closure")))
    if ellipses is not None:
        handles.append(Line2D([], [], color=theme.uncertainty, linewidth=1.0, label=ellipses.label))
    handles.append(Line2D([], [], linestyle="none", label="start", **start))
    handles.append(Line2D([], [], linestyle="none", label="end", **end))
    return handles
