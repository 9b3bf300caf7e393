"""What a report says and shows, apart from how its page looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from clew.mapping import OccupancyGrid
    from clew.place import Closure

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Focus:
    """What a line of the report leads to on the map.

    Attributes:
        kind: "pose", "edge", "closure", "landmark" or "span" (of the poses from `first` to `last`).
        first: row of the pose, edge, closure or landmark in the scene.
        last: of a span.
    """

    kind: str
    first: int
    last: int = -1


@dataclass(frozen=True)
class Note:
    """A sentence that says what is to be looked at.

    Attributes:
        text: one or two sentences.
        level: "check" (may be wrong), "know" (should be known) or "good".
        focus: what it leads to, or None.
    """

    text: str
    level: str = "check"
    focus: Focus | None = None


@dataclass(frozen=True)
class Table:
    """Rows of text; each may lead to something on the map.

    Attributes:
        title: heading.
        columns: of the head.
        rows: one text a column.
        focus: what each row leads to, or None.
        empty: what to say if there are no rows.
        caption: what the numbers mean.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    focus: Sequence[Focus | None] = ()
    empty: str = ""
    caption: str = ""


@dataclass(frozen=True)
class Chart:
    """Curves over the time of the scene.

    Attributes:
        title: heading.
        unit: of the values.
        times: ``(N,)`` as those of the scene.
        curves: name and ``(N,)`` values of each.
        caption: what the curves mean.
    """

    title: str
    unit: str
    times: Array
    curves: Sequence[tuple[str, Array]]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A part of the page below the map.

    Attributes:
        title: heading.
        facts: short name and value of what is known.
        notes: sentences.
        tables, charts: see there.
    """

    title: str
    facts: Sequence[tuple[str, str]] = ()
    notes: Sequence[Note] = ()
    tables: Sequence[Table] = ()
    charts: Sequence[Chart] = ()


@dataclass(frozen=True, eq=False)
class Path:
    """A curve through the scene: where a robot was.

    Attributes:
        name: for the legend.
        kind: "trajectory", "odometry" or "truth".
        robot: row of the robot in the scene.
        times: ``(N,)``, increasing.
        poses: ``(N, 3)`` x, y, theta.
    """

    name: str
    kind: str
    robot: int
    times: Array
    poses: Array


@dataclass(frozen=True, eq=False)
class Edges:
    """Measurements between two variables of the scene.

    Attributes:
        ends: ``(E, 2)`` nodes; those from ``N`` on are landmarks.
        role: ``(E,)`` numbers of `clew.evaluate.ROLES`.
        squared: ``(E,)`` squared residual for one degree of freedom.
        weight: ``(E,)`` robust weight.
    """

    ends: Index
    role: NDArray[np.int8]
    squared: Array
    weight: Array


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Attributes: ``(L, dim)`` positions, ``(L, 2, 2)`` covariances in the world frame or None, names, sightings."""

    positions: Array
    covariances: Array | None
    names: Sequence[str]
    sightings: Index


@dataclass(frozen=True, eq=False)
class Summarised:
    """Poses that the graph no longer has, because others say what they said; closures still lead to them.

    Attributes:
        names: ``(S,)`` keys that they had, as text.
        times: ``(S,)`` seconds.
        poses: ``(S, 3)`` where they lie by the poses that stayed: x, y, heading.
    """

    names: Sequence[str] = ()
    times: Array = field(default_factory=lambda: np.zeros(0))
    poses: Array = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class Scene:
    """What the map of a report shows.

    Attributes:
        positions: ``(N, dim)`` of the poses of the graph, 2 or 3 coordinates.
        headings: ``(N,)`` radians, nan in space.
        names: ``(N,)`` keys of the poses, as text.
        times: ``(N,)`` seconds, or the place in the path where there are no times.
        robot: ``(N,)`` row of each pose's robot in `robots`.
        robots: names.
        timed: whether `times` are seconds.
        covariances: ``(N, 3, 3)`` of x, y, heading in the axes of the world (in space: of x, y, z), or None.
        edges: see `Edges`.
        landmarks: see `Landmarks`.
        paths: dense trajectories and odometry; empty where the poses are all there is.
        closures: candidates with their evidence, by rows of the poses; row `N` and up are of `summarised`.
        scans: returns ``(n, 2)`` of each pose in the robot's frame, or empty.
        grid: the map, or None.
        summarised: see `Summarised`.
    """

    positions: Array
    headings: Array
    names: Sequence[str]
    times: Array
    robot: Index
    robots: Sequence[str]
    timed: bool
    covariances: Array | None
    edges: Edges
    landmarks: Landmarks
    paths: Sequence[Path] = ()
    closures: Sequence[Closure] = ()
    scans: Sequence[Array] = ()
    grid: OccupancyGrid | None = None
    summarised: Summarised = field(default_factory=Summarised)

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.positions.shape[1])


@dataclass(frozen=True, eq=False)
class Report:
    """A page.

    Attributes:
        title: what it is about, one line.
        kind: what made it ("run", "optimize", "merge").
        lead: the summary in sentences.
        notes: what to check, most important first.
        scene: of the map.
        sections: below the map.
    """

    title: str
    kind: str
    lead: Sequence[str]
    notes: Sequence[Note]
    scene: Scene
    sections: Sequence[Section] = field(default_factory=tuple)
