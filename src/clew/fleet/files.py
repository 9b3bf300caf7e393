"""Robots from files: the output folders of runs, and pose graphs with edges to other robots' poses."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.factors import Between
from clew.fleet.keys import SHIFT
from clew.fleet.robot import InterRobotEdges, RobotGraph, robot_graph
from clew.geometry import SE2, SE3, Point2
from clew.graph import FactorGraph
from clew.io import GraphFile, atomic_write, read_graph

Array = NDArray[np.float64]
Index = NDArray[np.int64]

COLUMNS = ("identity", "x", "y", "cov_xx", "cov_xy", "cov_yy", "sightings")
#: A row of landmarks.csv stands for the landmark of the graph at its place, to this distance, metres (rounding).
SAME_PLACE = 1e-3


@dataclass(frozen=True, eq=False)
class _Part:
    """One input on its way to a robot."""

    name: str
    file: GraphFile
    identities: dict[int, str]
    own: Index
    letters: frozenset[int]


def read_robots(paths: Sequence[Path], *, progress: Callable[[int, int], None] | None = None) -> list[RobotGraph]:
    """Read robots: folders with ``graph.g2o`` (and ``landmarks.csv``), or graph files.

    A vertex that a file's edges mention, that it does not define, and whose top byte is another robot's letter, is
    a pose of that robot; such edges tie the robots. Each graph is solved by itself.

    Args:
        paths: at least two.
        progress: told how many of how many robots are solved.

    Raises:
        InputError: a path is neither, two inputs are the same, a file is broken, or edges lead to a robot that is
            not among the inputs.
    """
    parts = [_read(Path(path), names) for path, names in zip(paths, _names(paths), strict=True)]
    if len(parts) < 2:
        raise InputError("merging takes at least two inputs; give the output folders or graphs of several robots")
    of_letter: dict[int, str] = {}
    for part in parts:
        for letter in part.letters - {0}:
            if letter in of_letter:
                raise InputError(f"{of_letter[letter]} and {part.name}: keys of both carry the letter "
                                 f"{chr(letter)!r} in their top byte; rename one of the robots")
            of_letter[letter] = part.name
    robots: list[RobotGraph] = []
    for part in parts:
        if progress is not None:
            progress(len(robots), len(parts))
        robots.append(_robot(part, of_letter))
    if progress is not None:
        progress(len(parts), len(parts))
    return robots


def read_landmarks(path: Path) -> tuple[list[str], Array]:
    """Identities (empty for landmarks without one) and positions ``(L, 2)`` of a ``landmarks.csv``.

    Raises:
        InputError: the file cannot be read, lacks a column, or a row is broken.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error})") from None
    rows = csv.DictReader(io.StringIO(text))
    missing = [name for name in COLUMNS if name not in (rows.fieldnames or [])]
    if missing:
        raise InputError(f"{path}: the column {missing[0]} is missing; expected {','.join(COLUMNS)}")
    identities, positions = [], []
    for row in rows:
        try:
            place = (float(row["x"]), float(row["y"]))
        except (TypeError, ValueError):
            place = (float("nan"),) * 2
        if not np.isfinite(place).all():
            raise InputError(f"{path}, line {rows.line_num}: x and y must be finite numbers; correct the row")
        identities.append((row["identity"] or "").strip())
        positions.append(place)
    return identities, np.array(positions, dtype=np.float64).reshape(-1, 2)


def write_landmarks(path: Path, identities: Sequence[str], positions: Array, covariances: Array,
                    sightings: Index) -> None:
    """Write a ``landmarks.csv``: identity, position ``(L, 2)``, covariance ``(L, 2, 2)``, number of sightings."""
    with atomic_write(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for name, (x, y), cov, count in zip(identities, positions, covariances, sightings.tolist(), strict=True):
            writer.writerow([name, f"{x:.6f}", f"{y:.6f}", f"{cov[0, 0]:.6e}", f"{cov[0, 1]:.6e}",
                             f"{cov[1, 1]:.6e}", count])


def _names(paths: Sequence[Path]) -> list[str]:
    """Names of the robots: of folders and files without what they share."""
    resolved = [Path(path).resolve() for path in paths]
    if len(set(resolved)) < len(resolved):
        raise InputError("the same input is given twice; give each robot once")
    short = [path.name if path.is_dir() else path.name.split(".")[0] for path in resolved]
    return short if len(set(short)) == len(short) else [str(path) for path in paths]


def _read(path: Path, name: str) -> _Part:
    graph_path = path / "graph.g2o" if path.is_dir() else path
    if not graph_path.exists():
        raise InputError(f"{path}: " + ("the folder holds no graph.g2o; give the output folder of a run"
                                        if path.is_dir() else "there is no such file or folder"))
    file = read_graph(graph_path)
    marks = path / "landmarks.csv"
    identities = _identities(marks, file.graph) if path.is_dir() and marks.exists() else {}
    defined = np.setdiff1d(file.graph.keys(), file.report.created)
    return _Part(name, file, identities, defined, frozenset(np.unique(defined >> SHIFT).tolist()))


def _identities(path: Path, graph: FactorGraph) -> dict[int, str]:
    """Identity of each landmark of the graph that carries one, by key; rows are found by their place."""
    names, positions = read_landmarks(path)
    keys = graph.keys(Point2)
    if not len(keys) or not len(names):
        return {}
    there = graph.values(keys).array
    apart = np.hypot(*np.moveaxis(positions[:, None] - there[None], 2, 0))
    nearest = apart.argmin(axis=1)
    lost = np.flatnonzero(apart.min(axis=1) > SAME_PLACE)
    if len(lost):
        raise InputError(f"{path}: landmark {names[lost[0]] or lost[0] + 1} stands where {path.parent.name}/graph.g2o "
                         "has none; the two files are of different runs")
    return {int(keys[at]): name for at, name in zip(nearest, names, strict=True) if name}


def _robot(part: _Part, of_letter: dict[int, str]) -> RobotGraph:
    """The robot's own graph, and its edges to others taken out of it."""
    graph = part.file.graph
    created = part.file.report.created
    foreign = created[~np.isin(created >> SHIFT, sorted(part.letters))]
    strange = [chr(int(letter)) for letter in np.unique(foreign >> SHIFT) if int(letter) not in of_letter]
    if strange:
        raise InputError(f"{part.file.path}: edges lead to poses of robot {strange[0]!r}, whose graph is not among "
                         "the inputs; give it too")
    edges = _edges(graph, foreign, of_letter)
    if len(foreign):
        graph.remove_variable(foreign)
    init = "file" if part.file.has_values else "auto"
    return robot_graph(part.name, graph, part.identities, edges=edges, init=init)


def _edges(graph: FactorGraph, foreign: Index, of_letter: dict[int, str]) -> InterRobotEdges | None:
    kind = SE3 if len(graph.keys(SE3)) else SE2
    functions = kind.functions
    columns = []
    for block in graph.blocks():
        if not isinstance(block, Between):
            continue
        away = np.isin(block.keys, foreign)
        z, information = block.measurement, block.information
        adjoint = functions.adjoint(functions.inverse(z))
        back = np.swapaxes(adjoint, 1, 2) @ information @ adjoint  # of the inverse, see `edges_between`
        for rows, own, other, measured, weights in (
            (away[:, 1] & ~away[:, 0], 0, 1, z, information),
            (away[:, 0] & ~away[:, 1], 1, 0, functions.inverse(z), back),
        ):
            keys = block.keys[rows]
            names = np.array([of_letter[int(key) >> SHIFT] for key in keys[:, other]], dtype=np.str_)
            columns.append((keys[:, own], names, keys[:, other], measured[rows], weights[rows]))
    if not sum(len(column[0]) for column in columns):
        return None
    return InterRobotEdges(*(np.concatenate(column) for column in zip(*columns, strict=True)))
