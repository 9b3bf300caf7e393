"""Reads pose graphs: g2o and TORO text, plain or packed."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.errors import InputError
from clew.factors import Bearing, Between, PointObservation, Prior, Range
from clew.geometry import SE2, SE3, so3
from clew.graph import FactorGraph, Role
from clew.io.content import check_text, printable, read_content
from clew.io.graph_file import Features, GraphFile, GraphReport
from clew.io.graph_tags import EDGES, OFFSETS, RECORDS, TORO_ORDER, VERTICES, Tag
from clew.io.graph_vertices import Vertices
from clew.io.information import from_triangle, reduce_indefinite, scale_rotation
from clew.io.poses import quaternions_of_angles

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Tables = dict[str, tuple[Indices, Array]]

#: How the rotation block of `EDGE_SE3:QUAT` is to be read: its unit in radians.
ROTATION_UNITS = {"radians": 1.0, "g2o": 0.5}


class _Reader:
    """One file on its way from tables of records to a graph."""

    def __init__(self, path: Path, tables: Tables, unit: float) -> None:
        self.path = path
        self.tables = tables
        self.unit = unit
        self.graph = FactorGraph()
        self.reduced: list[Indices] = []
        self.offsets: dict[int, Array] = {}
        for offset in OFFSETS:
            for row, numbers in zip(*tables.get(offset.name, ((), ())), strict=True):
                self.offsets[int(row[1])] = self.poses(offset.kind, numbers[None], row[:1])[0]

    def fail(self, line: int, what: str) -> InputError:
        return InputError(f"{self.path}, line {line}: {what}")

    def poses(self, kind: type[Any], numbers: Array, lines: Indices) -> Array:
        """Storage of poses or points as the file has them: quaternion or roll, pitch, yaw."""
        if kind is SE3 and numbers.shape[1] == 6:
            return np.column_stack([numbers[:, :3], quaternions_of_angles(*numbers[:, 3:].T)])
        if kind is SE3:
            length = np.linalg.norm(numbers[:, 3:], axis=1)
            bad = np.flatnonzero(np.abs(length - 1) > 0.1)
            if len(bad):
                raise self.fail(lines[bad[0]], "the quaternion (qx qy qz qw) has length "
                                f"{length[bad[0]]:.4g}, not 1; correct it")
            return np.column_stack([numbers[:, :3], so3.canonical(numbers[:, 3:])])
        return numbers

    def vertices(self) -> Vertices:
        """All variables, those that only edges mention included."""
        vertices = Vertices(self.path)
        for tag in VERTICES:
            if tag.name in self.tables:
                ids, numbers = self.tables[tag.name]
                values = self.poses(tag.kinds[0], numbers, ids[:, 0])
                vertices.define(tag.kinds[0], ids[:, 1], ids[:, 0], values)
        for tag in EDGES:
            if tag.name in self.tables:
                ids, _ = self.tables[tag.name]
                for position, kind in enumerate(tag.kinds):
                    vertices.mention(kind, ids[:, 1 + position], ids[:, 0], tag.name)
        vertices.fill(self.graph)
        return vertices

    def information(self, tag: Tag, numbers: Array, lines: Indices) -> Array:
        triangle = numbers[:, tag.measurement:]
        if tag.name == "EDGE2":
            triangle = triangle[:, TORO_ORDER]
        full = from_triangle(triangle, tag.residual)
        if tag.measurement == 7 and self.unit != 1.0:
            full = scale_rotation(full, self.unit)
        full, reduced, hopeless = reduce_indefinite(full, tag.kinds[0])
        if len(hopeless):
            raise self.fail(lines[hopeless[0]], f"{tag.name}: the information matrix has a negative "
                            "eigenvalue and no usable diagonal blocks; correct it")
        self.reduced.append(lines[reduced])
        return full

    def edges(self, tag: Tag) -> None:
        """Add all edges of one kind to the graph."""
        ids, numbers = self.tables[tag.name]
        lines, keys = ids[:, 0], ids[:, 1 : 1 + len(tag.kinds)]
        information = self.information(tag, numbers, lines)
        measurement = numbers[:, : tag.measurement]
        if tag.kinds[0] in (SE2, SE3) and tag.measurement >= 3 and tag.name != "EDGE_SE3_TRACKXYZ":
            measurement = self.poses(tag.kinds[0], measurement, lines)
        if tag.kinds in ((SE2, SE2), (SE3, SE3)):
            self.relations(tag, keys, lines, measurement, information)
            return
        parameter = ids[:, -1] if tag.parameter else np.full(len(ids), -1)
        for number in np.unique(parameter):
            rows = np.flatnonzero(parameter == number)
            offset = self.offset(tag, int(number), lines[rows[0]])
            self.observations(tag, keys[rows], measurement[rows], information[rows], offset)

    def offset(self, tag: Tag, number: int, line: int) -> Array | None:
        """Sensor's place that a parameter id stands for; None for the identity."""
        if number not in self.offsets:
            if number > 0:
                raise self.fail(line, f"{tag.name} refers to the parameter {number}, for which there is no "
                                "PARAMS_SE3OFFSET line; add it")
            return None
        offset = self.offsets[number]
        return None if np.array_equal(offset, tag.kinds[0].identity(()).array) else offset

    def relations(self, tag: Tag, keys: Indices, lines: Indices, measurement: Array,
                  information: Array) -> None:
        loops = np.flatnonzero(keys[:, 0] == keys[:, 1])
        if len(loops):
            raise self.fail(lines[loops[0]], f"{tag.name} joins vertex {keys[loops[0], 0]} with itself; "
                            "remove it")
        # Neighbours in the order of the poses, not ids one apart: landmarks may take ids in between. The
        # upper byte of an id may name a robot (gtsam symbols), and robots do not follow each other.
        order = np.sort(self.graph.keys(tag.kinds[0]))
        apart = np.abs(np.searchsorted(order, keys[:, 1]) - np.searchsorted(order, keys[:, 0]))
        odometry = (apart == 1) & (keys[:, 0] >> 56 == keys[:, 1] >> 56)
        for role, rows in ((Role.ODOMETRY, odometry), (Role.LOOP, ~odometry)):
            if rows.any():
                self.graph.add(Between(keys[rows, 0], keys[rows, 1], measurement[rows],
                                       information=information[rows], role=role))

    def observations(self, tag: Tag, keys: Indices, measurement: Array, information: Array,
                     offset: Array | None) -> None:
        pose, other = keys[:, 0], keys[:, -1]
        if len(tag.kinds) == 1:
            kind = tag.kinds[0]
            value = kind.from_array(measurement)
            if offset is not None:  # z = x o was measured, so x = z o^-1 and e_z = Ad(o^-1) e_x
                adjoint = kind.from_array(offset).inverse().adjoint()
                value = value @ kind.from_array(offset).inverse()
                information = adjoint.T @ information @ adjoint
                information = 0.5 * (information + np.swapaxes(information, 1, 2))
            self.graph.add(Prior(pose, value, information=information))
        elif tag.name == "EDGE_BEARING_SE2_XY":
            self.graph.add(Bearing(pose, other, measurement[:, 0], information=information))
        elif tag.name == "EDGE_RANGE_SE2_XY":
            self.graph.add(Range(pose, other, measurement[:, 0], information=information))
        else:
            self.graph.add(PointObservation(pose, other, measurement, information=information,
                                            T_robot_sensor=offset))


def _features(reader: _Reader, table: tuple[Indices, Array]) -> Features | None:
    ids, numbers = table
    if len(ids) == 0:
        return None
    strange = np.flatnonzero(~np.isin(ids[:, 1], reader.graph.keys(SE2)))
    if len(strange):
        raise reader.fail(ids[strange[0], 0], "DATA_FEATURE_POINTXY stands behind a vertex that is no "
                          "VERTEX_SE2; move or remove it")
    return Features(ids[:, 1].copy(), numbers[:, :2].copy(), from_triangle(numbers[:, 2:], 2))


def read_graph(path: str | PathLike[str], *, rotation_information: str = "radians") -> GraphFile:
    """Read a pose graph: g2o or TORO text, plain or packed with gzip or bzip2.

    Edges between neighbouring poses (in the order of ids) get the role odometry, the others loop. Vertices
    that only edges mention are created at the identity, unknown tags are kept aside; both are reported.

    Args:
        path: the file.
        rotation_information: unit of the rotation block of ``EDGE_SE3:QUAT`` information: ``"radians"`` (as
            GTSAM, SE-Sync and Ceres read it) or ``"g2o"`` (of qx, qy, qz: half angles).

    Raises:
        InputError: the file cannot be read, is no graph, or a line is broken (the text says which and how).
    """
    path = Path(path)
    if rotation_information not in ROTATION_UNITS:
        raise InputError(f"rotation_information={rotation_information!r}: choose radians or g2o")
    content = read_content(path)
    check_text(path, content.data)
    if content.truncated:
        raise InputError(f"{path}: the packed file ends early or is damaged; get it again")
    records = _native.io.parse_graph(content.data, RECORDS)
    if records["bad_line"]:
        bad = printable(records["bad"].decode("latin-1"))
        raise InputError(f"{path}, line {records['bad_line']}: {bad}; correct or remove the line")
    unknown = tuple((line, text.decode("latin-1").strip(" \t\r\v\f")) for line, text in records["unknown"])
    if not any(tag.name in records["tables"] for tag in VERTICES + EDGES):
        found = ", ".join(sorted(GraphReport(unknown=unknown).unknown_tags)[:5]) or "nothing"
        raise InputError(f"{path}: no vertices and no edges of a known kind (found: "
                         f"{printable(found[:80])}); give a g2o or TORO file")
    reader = _Reader(path, records["tables"], ROTATION_UNITS[rotation_information])
    vertices = reader.vertices()
    for tag in EDGES:
        if tag.name in records["tables"]:
            reader.edges(tag)
    strangers = np.flatnonzero(~np.isin(records["fixed"][:, 1], reader.graph.keys()))
    if len(strangers):
        line, key = records["fixed"][strangers[0]]
        raise reader.fail(int(line), f"FIX refers to vertex {key}, which is not in the file; remove it")
    fixed = np.unique(records["fixed"][:, 1])
    if len(fixed):
        reader.graph.set_constant(fixed)
    reduced = np.sort(np.concatenate([*reader.reduced, np.empty(0, np.int64)]))
    report = GraphReport(unknown, reduced, vertices.created, vertices.repeated, fixed)
    return GraphFile(path, reader.graph, report, vertices.has_values, _features(reader, records["features"]))
