"""A factor graph: poses, landmarks, the measurements between them, and how sure their positions are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from clew.errors import InputError
from clew.view.ellipses import ellipse_collection, ellipse_outlines
from clew.view.style import (
    CLOSURE,
    INK,
    LANDMARK,
    LINE_HEIGHT,
    MARGIN,
    MUTED,
    OBSERVATION,
    REJECTED,
    TRAJECTORY,
    UNCERTAINTY,
    Sheet,
    counted,
    format_metres,
    round_length,
)

Array = NDArray[np.float64]

_MOST_ELLIPSES = 60
_WIDEST, _HIGHEST = 1800, 1500  # of the graph, pixels
_NARROWEST, _LOWEST = 1000, 400
_HEAD = 100  # strip for the heading, pixels
_COLUMN = 400  # of the legend, pixels
_BAR = 320  # room for the scale bar, pixels

# Colour and opacity of each role (`clew.graph.Role`): what is many lies below what is telling.
_STYLES = {"observation": (OBSERVATION, 0.35), "odometry": (TRAJECTORY, 1.0), "loop": (CLOSURE, 0.6),
           "prior": (REJECTED, 1.0)}
_OTHER = (INK, 1.0)
# Where the axes x, y and z point in the picture of a graph in space.
_ISOMETRIC = np.array([[np.sqrt(0.75), -0.5], [np.sqrt(0.75), 0.5], [0.0, 1.0]])


def plot_graph(
    path: str | Path,
    poses_xy: Array,
    edges_by_role: Mapping[str, Array],
    points_xy: Array | None = None,
    covariances: Array | None = None,
    point_covariances: Array | None = None,
    title: str | None = None,
) -> None:
    """Write the picture of a factor graph as PNG; one in space is seen from above one corner (isometric).

    Args:
        path: the PNG file to write.
        poses_xy: ``(N, 2)`` or ``(N, 3)`` positions of the poses, metres.
        edges_by_role: for each role (`clew.graph.Role` or its value) the ``(M, 2, 2)`` or ``(M, 2, 3)``
            positions of both ends of its edges.
        points_xy: ``(P, 2)`` or ``(P, 3)`` positions of landmarks.
        covariances: ``(N, d, d)`` covariances of the poses' positions in the world frame; drawn as ellipses that
            hold 95 % of what is seen in the picture, spread over the poses where there are many.
        point_covariances: ``(P, d, d)`` the same of the landmarks.
        title: heading, one line.

    Raises:
        InputError: a position is not finite, the shapes do not fit together, or the file cannot be written.
    """
    poses = np.asarray(poses_xy, dtype=np.float64)
    dim = poses.shape[-1]
    points = np.zeros((0, dim)) if points_xy is None else np.asarray(points_xy, dtype=np.float64)
    edges = {str(getattr(role, "value", role)): np.asarray(ends, dtype=np.float64)
             for role, ends in edges_by_role.items()}
    _check(poses, points, edges, covariances, point_covariances)
    outlines = np.concatenate([_ellipses(poses, covariances), _ellipses(points, point_covariances)])
    if dim == 3:
        poses, points = poses @ _ISOMETRIC, points @ _ISOMETRIC
        edges = {role: ends @ _ISOMETRIC for role, ends in edges.items()}
    drawn = np.concatenate([poses, points, *(ends.reshape(-1, 2) for ends in (*edges.values(), outlines))])
    low, high = (drawn.min(axis=0), drawn.max(axis=0)) if len(drawn) else (np.zeros(2), np.ones(2))
    span = np.maximum(high - low, 1e-3 * max(1.0, float((high - low).max())))
    pixels_per_metre = float(min(_WIDEST / span[0], _HIGHEST / span[1]))
    inner = np.maximum(np.ceil(span * pixels_per_metre), (_NARROWEST, _LOWEST)).astype(int)
    width, height = int(inner[0]) + 2 * MARGIN, int(inner[1]) + 2 * MARGIN

    handles = _legend(poses, points, edges, len(outlines) > 0)
    columns = max(1, (width - 2 * MARGIN - _BAR) // _COLUMN)
    foot = 2 * MARGIN + LINE_HEIGHT * -(-len(handles) // columns)
    sheet = Sheet(width, foot + height + _HEAD)
    axes = sheet.axes(0, foot, width, height)
    half = np.array([width, height]) / (2.0 * pixels_per_metre)
    centre = (low + high) / 2.0
    axes.set(xlim=(centre[0] - half[0], centre[0] + half[0]), ylim=(centre[1] - half[1], centre[1] + half[1]))
    _draw(axes, poses, points, edges)
    if len(outlines):
        axes.add_collection(ellipse_collection(outlines, UNCERTAINTY), autolim=False)

    sheet.text(MARGIN, sheet.height - 64, title or "", 15, bold=True)
    sheet.legend(handles, MARGIN, foot - MARGIN, columns)
    if dim == 3:
        _draw_triad(sheet, foot, pixels_per_metre)
    else:
        sheet.scale_bar(width - MARGIN, foot - MARGIN - LINE_HEIGHT + 6, pixels_per_metre, _BAR)
    sheet.save(Path(path))


def _ellipses(positions: Array, covariances: Array | None) -> Array:
    """Outlines ``(K, n, 2)`` in the picture of some of the positions; more would hide the graph."""
    if covariances is None or not len(positions):
        return ellipse_outlines(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    every = -(-len(positions) // _MOST_ELLIPSES)
    some, spread = positions[::every], covariances[::every]
    if positions.shape[1] == 3:
        some, spread = some @ _ISOMETRIC, _ISOMETRIC.T @ spread @ _ISOMETRIC
    return ellipse_outlines(some, spread)


def _check(
    poses: Array, points: Array, edges: Mapping[str, Array], covariances: Array | None, point_covariances: Array | None
) -> None:
    dim = poses.shape[-1]
    fits = poses.ndim == 2 and dim in (2, 3) and points.ndim == 2 and points.shape[1] == dim
    if not fits or any(ends.ndim != 3 or ends.shape[1:] != (2, dim) for ends in edges.values()):
        raise InputError("a picture of a graph needs poses (N, d), landmarks (P, d) and edges (M, 2, d) with "
                         "d = 2 or 3")
    ellipses = {"covariances": covariances, "covariances of landmarks": point_covariances}
    for (name, given), count in zip(ellipses.items(), (len(poses), len(points)), strict=True):
        if given is not None and given.shape != (count, dim, dim):
            raise InputError(f"ellipses need {name} ({count}, {dim}, {dim}), not {given.shape}")
    for name, values in {"poses": poses, "landmarks": points, **ellipses, **edges}.items():
        if values is not None and not np.isfinite(values).all():
            raise InputError(f"a picture of a graph needs finite positions; some {name} are not")


def _in_order(edges: Mapping[str, Array]) -> list[tuple[str, Array, str, float]]:
    """Role, ends, colour and opacity of each kind of edges that there is, from the lowest to the topmost."""
    others = sorted(set(edges) - set(_STYLES))
    return [(role, edges[role], *_STYLES.get(role, _OTHER)) for role in (*_STYLES, *others)
            if len(edges.get(role, ()))]


def _draw(axes: Axes, poses: Array, points: Array, edges: Mapping[str, Array]) -> None:
    count = sum(len(ends) for ends in edges.values())
    line = float(np.clip(2.2 - 0.4 * np.log10(max(count, 1)), 0.6, 1.4))  # thinner where there are more
    for level, (_, ends, colour, alpha) in enumerate(_in_order(edges)):
        axes.add_collection(LineCollection(list(ends), colors=colour, linewidths=line, alpha=alpha,
                                           zorder=2 + 0.1 * level), autolim=False)
    size = float(np.clip(5.0 - 1.2 * np.log10(max(len(poses), 1)), 0.4, 3.0))
    axes.plot(*poses.T, linestyle="none", marker="o", markersize=size, color=INK, markeredgewidth=0.0,
              zorder=1)
    axes.plot(*points.T, linestyle="none", marker="^", markersize=4.5, color=LANDMARK, markeredgewidth=0.0,
              zorder=4)


def _legend(
    poses: Array, points: Array, edges: Mapping[str, Array], ellipses: bool
) -> list[Line2D]:
    handles = [Line2D([], [], linestyle="none", marker="o", markersize=4, color=INK, markeredgewidth=0.0,
                      label=counted(len(poses), "pose"))]
    if len(points):
        handles.append(Line2D([], [], linestyle="none", marker="^", markersize=6, color=LANDMARK,
                              markeredgewidth=0.0, label=counted(len(points), "landmark")))
    handles += [Line2D([], [], color=colour, linewidth=1.8, label=counted(len(ends), f"{role} edge"))
                for role, ends, colour, _ in _in_order(edges)]
    if ellipses:
        handles.append(Line2D([], [], color=UNCERTAINTY, linewidth=1.2, label="95 % ellipses of position"))
    return handles


def _draw_triad(sheet: Sheet, foot: int, pixels_per_metre: float) -> None:
    """The axes x, y and z of a round length, for an isometric picture has no one scale for all directions."""
    metres = round_length(90.0 / pixels_per_metre)
    corner = np.array([sheet.width - MARGIN - 110.0, foot - MARGIN - 10.0])
    axes = sheet.axes(0, 0, sheet.width, sheet.height)
    axes.set(xlim=(0, sheet.width), ylim=(0, sheet.height))
    for name, direction in zip("xyz", _ISOMETRIC, strict=True):
        tip = corner + metres * pixels_per_metre * direction
        axes.plot(*np.stack([corner, tip]).T, color=INK, linewidth=1.4, solid_capstyle="round")
        x, y = tip + 16.0 * direction - (0.0, 6.0)
        sheet.text(x, y, name, 9, color=MUTED, align="center")
    sheet.text(corner[0] - 20.0, corner[1] - 6.0, f"axes of {format_metres(metres)}", 8.5, align="right")
