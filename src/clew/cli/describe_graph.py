"""What `clew info` says of a graph."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from clew.cli.description import Description, count, metres
from clew.geometry import SE2, SE3
from clew.graph import FactorGraph, Role
from clew.io import GraphFile, read_graph
from clew.slam.pose_graph import chi2

Array = NDArray[np.float64]


def describe_graph(path: Path, kind: str) -> Description:
    """Poses, landmarks, edges by kind, connected parts, extent, and what is wrong with it."""
    file = read_graph(path)
    graph = file.graph
    edges = edges_by_kind(graph)
    parts = part_sizes(graph)
    poses = [variables for variables in graph.variables() if variables.kind in (SE2, SE3)]
    planar = all(variables.kind is not SE3 for variables in graph.variables())
    number = sum(len(variables.keys) for variables in poses)
    landmarks = len(graph) - number
    about = Description(kind)
    about.data = {"poses": number, "landmarks": landmarks, "edges": dict(edges), "dimension": 2 if planar else 3,
                  "parts": parts, "fixed": len(file.report.fixed), "robots": robots_of(graph)}
    about.lines.append(("variables", f"{count(number, 'pose')} {'in the plane' if planar else 'in space'}"
                        + (f", {count(landmarks, 'landmark')}" if landmarks else "")))
    width = max((len(f"{many:,}") for many in edges.values()), default=0)
    about.lines += [("edges" if place == 0 else "", f"{many:>{width},} {name}")
                    for place, (name, many) in enumerate(edges.items())]
    about.lines.append(("parts", f"{count(len(parts), 'connected part')}"
                        + ("" if len(parts) < 2 else f" of {', '.join(f'{size:,}' for size in parts[:6])}"
                           + (", ..." if len(parts) > 6 else "") + " variables")))
    if len(about.data["robots"]) > 1:  # type: ignore[arg-type]  # a list
        about.lines.append(("robots", ", ".join(robots_of(graph))))
    if file.features is not None:
        about.data["features"] = len(file.features.keys)
        about.lines.append(("features", f"{count(len(file.features.keys), 'sighting')} without association"))
    if len(file.report.fixed):
        about.lines.append(("held", f"{count(len(file.report.fixed), 'variable')} held constant (FIX)"))
    if file.has_values and poses:
        _values(about, poses[0].values, graph)
    about.problems = graph_problems(file, parts)
    about.data["problems"] = about.problems
    return about


def _values(about: Description, values: Array, graph: FactorGraph) -> None:
    space = 2 if values.shape[1] == 3 else 3
    extent = np.ptp(values[:, :space], axis=0)
    about.lines.append(("extent", " x ".join(metres(float(side)) for side in extent)))
    about.data["extent_m"] = extent.tolist()
    if graph.factor_count:
        cost = chi2(graph)
        about.data["chi2"] = cost if np.isfinite(cost) else None
        about.lines.append(("chi2", f"{cost:.6g} at the values of the file"))


def edges_by_kind(graph: FactorGraph) -> Counter[str]:
    """Number of measurements by what they measure and their role."""
    edges: Counter[str] = Counter()
    names = {"Between": "relative poses", "PointObservation": "points seen", "Prior": "priors",
             "Bearing": "bearings", "Range": "ranges"}
    for block in graph.blocks():
        name = names.get(type(block).__name__, type(block).__name__)
        role = {Role.ODOMETRY: "between neighbours (odometry)", Role.LOOP: "between others (closures)"}
        edges[f"{name} {role[block.role]}" if block.role in role else name] += len(block)
    return edges


def part_sizes(graph: FactorGraph) -> list[int]:
    """Number of variables of each connected part, the largest first."""
    keys = np.sort(graph.keys())
    first, second = [], []
    for block in graph.blocks():
        rows = np.searchsorted(keys, block.keys)
        for column in range(1, rows.shape[1]):
            first.append(rows[:, 0])
            second.append(rows[:, column])
    ends = (np.concatenate([*first, np.empty(0, np.int64)]), np.concatenate([*second, np.empty(0, np.int64)]))
    links = coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(len(keys), len(keys)))
    _, labels = connected_components(links, directed=False)
    return sorted(np.bincount(labels).tolist(), reverse=True) if len(keys) else []


def robots_of(graph: FactorGraph) -> list[str]:
    """Letters of the robots, where the upper byte of the keys names one."""
    letters = np.unique(graph.keys() >> 56)
    return [chr(letter) if 32 < letter < 127 else str(letter) for letter in letters.tolist() if letter]


def graph_problems(file: GraphFile, parts: list[int]) -> list[str]:
    """What a user should know before optimising."""
    report, graph = file.report, file.graph
    found = []
    if not file.has_values:
        found.append("no vertices: the initial guess is made from the edges (clew optimize does)")
    elif len(report.created):
        found.append(f"vertices only mentioned by edges, without a value of their own: {len(report.created):,}, first "
                     f"{report.created[0]}")
    if len(parts) > 1:
        found.append(f"{len(parts):,} parts that no edge joins: each is solved in a frame of its own")
    if len(report.reduced):
        found.append(f"{count(len(report.reduced), 'edge')} with an indefinite information matrix, first in line "
                     f"{report.reduced[0]}: their translation and rotation blocks are used")
    if len(report.repeated):
        found.append(f"{count(len(report.repeated), 'vertex line')} for a vertex that was defined before, first line "
                     f"{report.repeated[0]}: the first definition counts")
    found += [f"{count(many, 'line')} {tag} not understood and left out"
              for tag, many in report.unknown_tags.most_common(5)]
    if file.features is not None:
        found.append("sightings without association are not part of the optimisation")
    if not graph.factor_count:
        found.append("no edges: there is nothing to optimise")
    return found
