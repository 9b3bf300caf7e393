"""Writes pose graphs as g2o or TORO text."""

from __future__ import annotations

import bz2
import gzip
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.errors import InputError
from clew.factors import Bearing, Between, PointObservation, Prior, Range
from clew.geometry import SE2, SE3, Point2, Point3
from clew.graph import Factor, FactorGraph
from clew.io.atomic import atomic_write_binary
from clew.io.graph_file import Features
from clew.io.graph_tags import TORO_ORDER
from clew.io.information import scale_rotation, to_triangle
from clew.io.poses import angles_of_quaternions
from clew.io.read_graph import ROTATION_UNITS

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_G2O_VERTICES = {SE2: "VERTEX_SE2", SE3: "VERTEX_SE3:QUAT", Point2: "VERTEX_XY", Point3: "VERTEX_TRACKXYZ"}
_TORO_VERTICES = {SE2: "VERTEX2", SE3: "VERTEX3"}
_G2O_EDGES: dict[tuple[type[Any], ...], str] = {
    (Between, SE2, SE2): "EDGE_SE2", (Between, SE3, SE3): "EDGE_SE3:QUAT", (Prior, SE2): "EDGE_PRIOR_SE2",
    (Prior, SE3): "EDGE_SE3_PRIOR", (PointObservation, SE2, Point2): "EDGE_SE2_XY",
    (PointObservation, SE3, Point3): "EDGE_SE3_TRACKXYZ", (Bearing, SE2, Point2): "EDGE_BEARING_SE2_XY",
    (Range, SE2, Point2): "EDGE_RANGE_SE2_XY",
}
_TORO_EDGES: dict[tuple[type[Any], ...], str] = {(Between, SE2, SE2): "EDGE2", (Between, SE3, SE3): "EDGE3"}
#: These name a sensor's place on the robot by the id of a PARAMS line.
_WITH_OFFSET = ("EDGE_SE3_PRIOR", "EDGE_SE3_TRACKXYZ")


def _lines(tag: str, keys: Array | Indices, numbers: Array) -> bytes:
    ids = np.ascontiguousarray(keys.reshape(len(keys), -1), dtype=np.int64)
    return _native.io.format_records(tag, ids, np.ascontiguousarray(numbers, dtype=np.float64))


def _with_angles(poses: Array) -> Array:
    """TORO's x y z roll pitch yaw of SE3 storage."""
    return np.column_stack([poses[:, :3], angles_of_quaternions(poses[:, 3:])])


class _Writer:
    """Collects the lines of one file."""

    def __init__(self, path: Path, toro: bool, unit: float) -> None:
        self.path = path
        self.toro = toro
        self.unit = unit
        self.parts: list[bytes] = []
        self.offsets: list[Array] = []  # of the PARAMS lines, by id

    def unsupported(self, what: str) -> InputError:
        style = "TORO" if self.toro else "g2o"
        return InputError(f"{self.path}: {style} files have no record for {what}; remove it before writing")

    def vertices(self, graph: FactorGraph, features: Features | None) -> None:
        names = _TORO_VERTICES if self.toro else _G2O_VERTICES
        for variables in graph.variables():
            if variables.kind not in names:
                raise self.unsupported(f"variables of kind {variables.kind.name}")
            spatial = self.toro and variables.kind is SE3
            values = _with_angles(variables.values) if spatial else variables.values
            text = _lines(names[variables.kind], variables.keys, values)
            if features is not None and variables.kind is SE2:
                text = _interleave(text, variables.keys, features)
            self.parts.append(text)
            held = variables.keys[variables.constant]
            if len(held) and self.toro:
                raise self.unsupported("variables that are held constant")
            self.parts.extend(b"FIX %d\n" % key for key in held.tolist())

    def offset(self, tag: str, factor: Factor) -> int:
        """Id of the PARAMS line for a factor's sensor."""
        pose = factor.T_robot_sensor
        place = np.asarray(factor.kinds[0].identity(()).array if pose is None else pose)
        for number, known in enumerate(self.offsets):
            if np.array_equal(known, place):
                return number
        self.offsets.append(place)
        return len(self.offsets) - 1

    def edges(self, factor: Factor) -> None:
        tag = (_TORO_EDGES if self.toro else _G2O_EDGES).get((type(factor), *factor.kinds))
        if tag is None:
            names = ", ".join(kind.name for kind in factor.kinds)
            raise self.unsupported(f"{type(factor).__name__} of {names}")
        keys, measurement, information = factor.keys, factor.measurement, factor.information
        if tag in _WITH_OFFSET:
            keys = np.column_stack([keys, np.full(len(keys), self.offset(tag, factor))])
        elif factor.T_robot_sensor is not None and np.any(factor.T_robot_sensor):
            raise self.unsupported(f"{type(factor).__name__} of a sensor that is not at the robot's centre")
        if measurement.shape[1] == 7 and not self.toro:
            information = scale_rotation(information, 1.0 / self.unit)
        triangle = to_triangle(information)
        if tag == "EDGE2":
            triangle = triangle[:, np.argsort(TORO_ORDER)]
        if tag == "EDGE3":
            measurement = _with_angles(measurement)
        self.parts.append(_lines(tag, keys, np.column_stack([measurement, triangle])))

    def text(self) -> bytes:
        places = [_lines("PARAMS_SE3OFFSET", np.array([[number]]), place[None])
                  for number, place in enumerate(self.offsets)]
        return b"".join(places + self.parts)


def _interleave(vertices: bytes, keys: Indices, features: Features) -> bytes:
    """Vertex lines, each followed by the features seen from it: a feature belongs to the vertex before."""
    numbers = np.column_stack([features.measurement, to_triangle(features.information)])
    kinds = np.tile([0, 2], (len(numbers), 1))
    seen = _lines("DATA_FEATURE_POINTXY", kinds, numbers).splitlines(keepends=True)
    lines = vertices.splitlines(keepends=True)
    order = np.argsort(keys, kind="stable")
    owner = order[np.searchsorted(keys[order], features.keys)]
    place = np.argsort(np.concatenate([np.arange(len(lines)), owner]), kind="stable")
    everything = lines + seen
    return b"".join(everything[i] for i in place.tolist())


def write_graph(path: str | PathLike[str], graph: FactorGraph, *, style: str = "g2o",
                rotation_information: str = "radians", features: Features | None = None,
                unknown: tuple[tuple[int, str], ...] = ()) -> None:
    """Write a graph such that reading it gives an equivalent one; numbers read back exactly.

    Robust kernels have no place in these files. Roles are made anew by `read_graph`.

    Args:
        path: file to write; packed if its name ends in ``.gz`` or ``.bz2``.
        graph: variables, constants (as ``FIX``) and factors.
        style: ``"g2o"``, or ``"toro"`` (poses and relative poses only).
        rotation_information: as in `read_graph`.
        features: sightings without association, as `read_graph` gives them.
        unknown: lines kept aside by `read_graph`, written as they are at the end.

    Raises:
        InputError: the format has no record for something in the graph, or the file cannot be written.
    """
    path = Path(path)
    if style not in ("g2o", "toro"):
        raise InputError(f"style={style!r}: choose g2o or toro")
    if rotation_information not in ROTATION_UNITS:
        raise InputError(f"rotation_information={rotation_information!r}: choose radians or g2o")
    if features is not None and (style == "toro" or not np.isin(features.keys, graph.keys(SE2)).all()):
        raise InputError(f"{path}: features need a g2o file and the planar poses that they were seen from")
    writer = _Writer(path, style == "toro", ROTATION_UNITS[rotation_information])
    writer.vertices(graph, features)
    for block in graph.blocks():
        writer.edges(block)
    data = writer.text() + b"".join(text.encode("latin-1") + b"\n" for _, text in unknown)
    if path.suffix == ".gz":
        data = gzip.compress(data, mtime=0)
    elif path.suffix == ".bz2":
        data = bz2.compress(data)
    with atomic_write_binary(path) as file:
        file.write(data)
