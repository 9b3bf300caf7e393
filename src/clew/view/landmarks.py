"""Robots' paths and the landmarks that they mapped, with how sure the landmarks' places are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from clew.errors import InputError
from clew.view.ellipses import ellipse_collection, readable_ellipses
from clew.view.style import LIGHT, LINE_HEIGHT, MARGIN, Sheet, Theme, counted

Array = NDArray[np.float64]

_LONGEST, _NARROWEST = 1400, 1000  # pixels of the longer side, and of the width
_HEAD, _COLUMN, _BAR = 110, 330, 320  # strip for the heading, width of a column of the legend, room for the scale bar


def save_landmarks_png(
    path: str | Path,
    paths: Sequence[tuple[str, Array]],
    landmarks: Array,
    covariances: Array,
    names: Sequence[str] | None = None,
    title: str = "",
    subtitle: str = "",
    confidence: float = 0.95,
    theme: Theme = LIGHT,
) -> None:
    """Write the picture of landmarks as PNG.

    Args:
        path: the PNG file to write.
        paths: name and ``(N, 2)`` positions of each robot.
        landmarks: ``(L, 2)`` positions.
        covariances: ``(L, 2, 2)`` of them in the world frame; drawn as ellipses, all magnified by one
            factor, which the legend states, where they would be dots.
        names: what to write beside each landmark, or None.
        title: heading, one line.
        subtitle: the numbers, one line below the heading.
        confidence: probability that a landmark lies within its ellipse.
        theme: `LIGHT` or `DARK`.

    Raises:
        InputError: shapes do not fit, a number is not finite, or the file cannot be written.
    """
    everything = [landmarks, covariances.reshape(len(covariances), -1), *(xy for _, xy in paths)]
    if landmarks.shape != (len(landmarks), 2) or covariances.shape != (len(landmarks), 2, 2):
        raise InputError(
            f"a picture of landmarks needs (L, 2) positions and (L, 2, 2) covariances, not {landmarks.shape} and "
            f"{covariances.shape}"
        )
    if not all(np.isfinite(values).all() for values in everything):
        raise InputError("a picture of landmarks needs finite positions; some are not")
    bare = np.concatenate([landmarks, *(xy for _, xy in paths)])
    rough = float(_LONGEST / max(np.ptp(bare, axis=0).max(), 1e-3)) if len(bare) else 1.0
    ellipses = readable_ellipses(landmarks, covariances, rough, confidence)
    drawn = np.concatenate([bare, ellipses.outlines.reshape(-1, 2)])
    low, high = (drawn.min(axis=0), drawn.max(axis=0)) if len(drawn) else (np.zeros(2), np.ones(2))
    span = np.maximum(high - low, 1e-3)
    scale = float(_LONGEST / span.max())
    inner = np.ceil(span * scale).astype(int)
    width, height = max(int(inner[0]) + 2 * MARGIN, _NARROWEST), int(inner[1]) + 2 * MARGIN
    handles = [
        Line2D([], [], color=theme.robot(n), linewidth=1.8, label=name) for n, (name, _) in enumerate(paths)
    ]
    handles.append(
        Line2D([], [], linestyle="none", marker="^", markersize=6, color=theme.landmark,
               label=counted(len(landmarks), "landmark"))
    )
    handles.append(Line2D([], [], color=theme.uncertainty, linewidth=1.2, label=ellipses.label))
    columns = max(1, (width - 2 * MARGIN - _BAR) // _COLUMN)
    foot = 2 * MARGIN + LINE_HEIGHT * -(-len(handles) // columns)
    sheet = Sheet(width, foot + height + _HEAD, theme)
    axes = sheet.axes(0, foot, width, height)
    centre, half = (low + high) / 2.0, np.array([width, height]) / (2.0 * scale)
    axes.set(xlim=(centre[0] - half[0], centre[0] + half[0]), ylim=(centre[1] - half[1], centre[1] + half[1]))
    for n, (_, xy) in enumerate(paths):
        axes.plot(*xy.T, color=theme.robot(n), linewidth=0.9, alpha=0.8, zorder=2)
    axes.plot(*landmarks.T, linestyle="none", marker="^", markersize=6, color=theme.landmark, zorder=5)
    axes.add_collection(ellipse_collection(ellipses.outlines, theme.uncertainty), autolim=False)
    for name, place in zip(names or (), landmarks, strict=False):
        x, y = (place - centre) * scale + (width / 2.0, foot + height / 2.0)
        sheet.text(x + 9.0, y + 6.0, name, 9)
    sheet.text(MARGIN, sheet.height - 50, title, 15, bold=True)
    sheet.text(MARGIN, sheet.height - 84, subtitle, 10, color=theme.muted)
    sheet.legend(handles, MARGIN, foot - MARGIN, columns)
    sheet.scale_bar(width - MARGIN, foot - MARGIN - LINE_HEIGHT + 6, scale, _BAR)
    sheet.save(Path(path))
