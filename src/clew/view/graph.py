"""Pictures of factor graphs: poses, landmarks, the measurements between them, how sure their positions are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from clew.errors import InputError
from clew.view.ellipses import Ellipses, ellipse_collection, readable_ellipses
from clew.view.scene import REJECTED_ROLE, Scene
from clew.view.style import LIGHT, LINE_HEIGHT, MARGIN, Sheet, Theme, counted, format_metres, round_length

Array = NDArray[np.float64]

_WIDEST, _HIGHEST = 1800, 1500  # of the graph, pixels
_NARROWEST, _LOWEST = 1000, 400
_HEAD = 100  # strip for the heading, pixels
_COLUMN = 400  # of the legend, pixels
_BAR = 320  # room for the scale bar, pixels
_GUTTER = 40  # between two graphs, pixels
_DOTS = (1.5, 2.0)  # of what was rejected

# What is many lies below what is telling; opacity of each role.
_ROLES = {"observation": 0.35, "odometry": 1.0, "loop": 0.6, "prior": 1.0, REJECTED_ROLE: 0.8}
# Where the axes x, y and z point in the picture of a graph in space.
_ISOMETRIC = np.array([[np.sqrt(0.75), -0.5], [np.sqrt(0.75), 0.5], [0.0, 1.0]])


def graph_figure(
    scene: Scene,
    title: str = "",
    *,
    subtitle: str = "",
    confidence: float = 0.95,
    theme: Theme = LIGHT,
) -> Figure:
    """Picture of a factor graph; one in space is seen from above one corner (isometric).

    Edges have the colour of their role and, if there are several robots, odometry and poses that of their robot.
    Both axes have one scale, which a bar shows. Covariances are drawn as ellipses, thinned where they would
    hide each other and all magnified by one factor, which the legend states, where they would be dots. In
    space they are those of the positions as projected.

    Args:
        scene: of `graph_scene` or `solution_scene`.
        title: heading, one line.
        subtitle: the numbers, one line below the heading.
        confidence: probability that a position lies within its ellipse.
        theme: `LIGHT` or `DARK`.

    Raises:
        InputError: a confidence that is no probability.
    """
    return _sheet([scene], [title], [subtitle], confidence, theme).figure


def before_after_figure(
    before: Scene,
    after: Scene,
    titles: tuple[str, str] = ("before", "after"),
    *,
    subtitles: tuple[str, str] = ("", ""),
    confidence: float = 0.95,
    theme: Theme = LIGHT,
) -> Figure:
    """Two states of one graph side by side, at one scale.

    Args:
        before: the graph at its initial guess, say.
        after: the solved graph.
        titles: headings.
        subtitles: the numbers, one line below each heading.
        confidence: probability that a position lies within its ellipse.
        theme: `LIGHT` or `DARK`.

    Raises:
        InputError: one scene in the plane and one in space, or a confidence that is no probability.
    """
    if before.dim != after.dim:
        raise InputError("before and after must both be in the plane or both in space")
    return _sheet([before, after], list(titles), list(subtitles), confidence, theme).figure


def _sheet(
    scenes: list[Scene], titles: list[str], subtitles: list[str], confidence: float, theme: Theme
) -> Sheet:
    """Graphs beside each other at one scale, with a common legend."""
    dim = scenes[0].dim
    flat = [_flat(scene) for scene in scenes]
    rough = min(_scale(*_box(_bare(scene)), len(flat)) for scene in flat)
    ellipses = [list(_ellipses(scene, rough, confidence)) for scene in flat]
    boxes = [_box(np.concatenate([_bare(scene), *(e.outlines.reshape(-1, 2) for e in own)]))
             for scene, own in zip(flat, ellipses, strict=True)]
    scale = min(_scale(*box, len(flat)) for box in boxes)
    spans = np.stack([np.maximum(high - low, _least(low, high)) for low, high in boxes])
    inner = np.ceil(spans.max(axis=0) * scale)
    width = int(max(inner[0], _NARROWEST / len(flat))) + 2 * MARGIN
    height = int(max(inner[1], _LOWEST)) + 2 * MARGIN

    total = len(flat) * width + (len(flat) - 1) * _GUTTER
    handles = _legend(flat, ellipses, theme)
    columns = max(1, (total - 2 * MARGIN - _BAR) // _COLUMN)
    foot = 2 * MARGIN + LINE_HEIGHT * -(-len(handles) // columns)
    sheet = Sheet(total, foot + height + _HEAD, theme)
    for number, (scene, own, (low, high)) in enumerate(zip(flat, ellipses, boxes, strict=True)):
        left = number * (width + _GUTTER)
        axes = sheet.axes(left, foot, width, height)
        half, centre = np.array([width, height]) / (2.0 * scale), (low + high) / 2.0
        axes.set(xlim=(centre[0] - half[0], centre[0] + half[0]), ylim=(centre[1] - half[1], centre[1] + half[1]))
        _draw(axes, scene, theme)
        for chosen in own:
            axes.add_collection(ellipse_collection(chosen.outlines, theme.uncertainty), autolim=False)
        sheet.text(left + MARGIN, sheet.height - (52 if subtitles[number] else 64), titles[number], 15, bold=True)
        sheet.text(left + MARGIN, sheet.height - 86, subtitles[number], 10, color=theme.muted)
    sheet.legend(handles, MARGIN, foot - MARGIN, columns)
    if dim == 3:
        _draw_triad(sheet, foot, scale)
    else:
        sheet.scale_bar(total - MARGIN, foot - MARGIN - LINE_HEIGHT + 6, scale, _BAR)
    return sheet


def _flat(scene: Scene) -> Scene:
    """The scene as the picture has it, in two dimensions."""
    if scene.dim == 2:
        return scene
    of_poses, of_points = (
        None if covariances is None else _ISOMETRIC.T @ covariances @ _ISOMETRIC
        for covariances in (scene.pose_covariances, scene.point_covariances)
    )
    return replace(
        scene,
        poses=scene.poses @ _ISOMETRIC,
        edges={role: ends @ _ISOMETRIC for role, ends in scene.edges.items()},
        points=scene.landmarks @ _ISOMETRIC,
        pose_covariances=of_poses,
        point_covariances=of_points,
    )


def _bare(scene: Scene) -> Array:
    """Everything that is drawn but ellipses, ``(n, 2)``."""
    return np.concatenate([scene.poses, scene.landmarks, *(ends.reshape(-1, 2) for ends in scene.edges.values())])


def _box(drawn: Array) -> tuple[Array, Array]:
    return (drawn.min(axis=0), drawn.max(axis=0)) if len(drawn) else (np.zeros(2), np.ones(2))


def _least(low: Array, high: Array) -> float:
    """A span below which a graph counts as a point or a line."""
    return 1e-3 * max(1.0, float((high - low).max()))


def _scale(low: Array, high: Array, beside: int) -> float:
    """Pixels per metre at which a graph fits beside others."""
    span = np.maximum(high - low, _least(low, high))
    return float(min(_WIDEST / beside / span[0], _HIGHEST / span[1]))


def _ellipses(scene: Scene, scale: float, confidence: float) -> Iterator[Ellipses]:
    """Those of the landmarks, or of the poses where there are no landmarks with covariances: both would hide all."""
    if scene.point_covariances is not None and len(scene.landmarks):
        yield readable_ellipses(scene.landmarks, scene.point_covariances, scale, confidence)
    elif scene.pose_covariances is not None and len(scene.poses):
        yield readable_ellipses(scene.poses, scene.pose_covariances, scale, confidence)


def _colour(role: str, theme: Theme) -> str:
    return {"observation": theme.observation, "odometry": theme.trajectory, "loop": theme.closure,
            "prior": theme.rejected, REJECTED_ROLE: theme.rejected}.get(role, theme.ink)


def _in_order(scene: Scene) -> list[tuple[str, Array, float]]:
    """Role, ends and opacity of each kind of edges that there is, from the lowest to the topmost."""
    others = sorted(set(scene.edges) - set(_ROLES))
    return [(role, scene.edges[role], _ROLES.get(role, 1.0)) for role in (*_ROLES, *others)
            if len(scene.edges.get(role, ()))]


def _draw(axes: Axes, scene: Scene, theme: Theme) -> None:
    count = sum(len(ends) for ends in scene.edges.values())
    line = float(np.clip(2.2 - 0.4 * np.log10(max(count, 1)), 0.6, 1.4))  # thinner where there are more
    for level, (role, ends, alpha) in enumerate(_in_order(scene)):
        colours: str | list[str] = _colour(role, theme)
        if role == "odometry" and scene.robot_of_edge is not None:
            colours = [theme.robot(n) if n >= 0 else theme.ink for n in scene.robot_of_edge.tolist()]
        dotted = [(0.0, _DOTS)] if role == REJECTED_ROLE else "solid"
        axes.add_collection(LineCollection(list(ends), colors=colours, linewidths=line, alpha=alpha,
                                           linestyles=dotted, zorder=2 + 0.1 * level), autolim=False)
    size = float(np.clip(5.0 - 1.2 * np.log10(max(len(scene.poses), 1)), 0.4, 3.0))
    of_pose = np.full(len(scene.poses), -1) if scene.robot_of_pose is None else scene.robot_of_pose
    for robot in np.unique(of_pose).tolist():
        axes.plot(*scene.poses[of_pose == robot].T, linestyle="none", marker="o", markersize=size,
                  color=theme.robot(robot) if robot >= 0 else theme.ink, markeredgewidth=0.0, zorder=1)
    axes.plot(*scene.landmarks.T, linestyle="none", marker="^", markersize=4.5, color=theme.landmark,
              markeredgewidth=0.0, zorder=4)


def _legend(scenes: list[Scene], ellipses: list[list[Ellipses]], theme: Theme) -> list[Line2D]:
    """What lines and markers mean; counts are those of the last scene."""
    scene = scenes[-1]
    handles = [Line2D([], [], linestyle="none", marker="o", markersize=4, color=theme.ink, markeredgewidth=0.0,
                      label=counted(len(scene.poses), "pose"))]
    if scene.robots:
        handles = [Line2D([], [], color=theme.robot(number), linewidth=1.8, label=str(name))
                   for number, name in enumerate(scene.robots)]
    if len(scene.landmarks):
        handles.append(Line2D([], [], linestyle="none", marker="^", markersize=6, color=theme.landmark,
                              markeredgewidth=0.0, label=counted(len(scene.landmarks), "landmark")))
    handles += [
        Line2D([], [], color=_colour(role, theme), linewidth=1.8, label=counted(len(ends), f"{role} edge"),
               linestyle=(0.0, _DOTS) if role == REJECTED_ROLE else "solid")
        for role, ends, _ in _in_order(scene) if not (scene.robots and role == "odometry")
    ]  # fmt: skip
    labels = dict.fromkeys(chosen.label for own in ellipses for chosen in own)
    handles += [Line2D([], [], color=theme.uncertainty, linewidth=1.2, label=label) for label in labels]
    return handles


def _draw_triad(sheet: Sheet, foot: int, pixels_per_metre: float) -> None:
    """The axes x, y and z of a round length, for an isometric picture has no one scale for all directions."""
    metres = round_length(90.0 / pixels_per_metre)
    corner = np.array([sheet.width - MARGIN - 110.0, foot - MARGIN - 10.0])
    axes = sheet.axes(0, 0, sheet.width, sheet.height)
    axes.set(xlim=(0, sheet.width), ylim=(0, sheet.height))
    for name, direction in zip("xyz", _ISOMETRIC, strict=True):
        tip = corner + metres * pixels_per_metre * direction
        axes.plot(*np.stack([corner, tip]).T, color=sheet.theme.ink, linewidth=1.4, solid_capstyle="round")
        x, y = tip + 16.0 * direction - (0.0, 6.0)
        sheet.text(x, y, name, 9, color=sheet.theme.muted, align="center")
    sheet.text(corner[0] - 20.0, corner[1] - 6.0, f"axes of {format_metres(metres)}", 8.5, align="right")
