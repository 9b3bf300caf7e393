"""A drive in steps with features of the surroundings seen on the way, their identities known or not."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.factors import Between
from clew.geometry import SE2
from clew.graph import FactorGraph
from clew.io.circles import is_circles, read_circles
from clew.io.content import read_content
from clew.io.feature_drive import FeatureLog
from clew.io.graph_file import Features
from clew.io.log import ReadReport
from clew.io.read_graph import read_graph

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_FURTHEST = 1e7  # metres; nothing on this planet is seen from further
_BARE_FEATURE = b"DATA_FEATURE_POINTXY"


def is_feature_log(path: str | PathLike[str]) -> bool:
    """Whether a file is a drive with features: a ``.circles`` log or a g2o file with ``DATA_FEATURE_POINTXY``."""
    path = Path(path)
    if not path.is_file() or not path.stat().st_size:
        return False
    with path.open("rb") as file:
        head = file.read(4)
    if head.startswith((b"#ROSBAG"[:4], b"SQLi", b"\x89MCA")):
        return False
    data = read_content(path).data
    return is_circles(data) or _BARE_FEATURE in data


def read_feature_log(path: str | PathLike[str]) -> FeatureLog:
    """Read a drive with features, of either kind.

    Raises:
        InputError: the file cannot be read or is broken, holds no features, or a pose is not tied to the one before.
    """
    path = Path(path)
    content = read_content(path)
    if is_circles(content.data):
        return _checked(read_circles(path))
    file = read_graph(path)
    if file.features is None:
        raise InputError(f"{path}: holds no features; optimise it with `clew optimize`")
    keys, motion, information = _chain(path, file.graph)
    report = ReadReport()
    report.used["poses"] += len(keys)
    report.used["features"] += len(file.features.keys)
    closures = file.graph.factor_count - (len(keys) - 1)
    if closures:
        report.skipped["measurement that is no odometry"] += closures
    if file.report.unknown:
        report.skipped["line of an unknown kind"] += len(file.report.unknown)
    order = np.argsort(file.features.keys, kind="stable")
    bare = file.features
    features = Features(bare.keys[order], bare.measurement[order], bare.information[order])
    return _checked(FeatureLog(path, keys, motion, information, features, None, report))


def _checked(log: FeatureLog) -> FeatureLog:
    """The log, if every measurement in it says something and says where."""
    for what, keys, information in (
        ("relative pose to pose", log.keys[1:], log.information),
        ("feature seen from pose", log.features.keys, log.features.information),
    ):
        # the smallest eigenvalue against the largest: information must be regular, and safely so
        spectrum = np.linalg.eigvalsh(information)
        bad = np.flatnonzero(~(spectrum[:, 0] > 1e-12 * np.maximum(spectrum[:, -1], 1e-300)))
        if len(bad):
            raise InputError(
                f"{log.path}: the {what} {keys[bad[0]]} has an information matrix that is not positive definite "
                f"(eigenvalues {', '.join(f'{value:.3g}' for value in spectrum[bad[0]])}), as {len(bad)} of "
                f"{len(keys)} have; correct or remove the line"
            )
    far = np.flatnonzero(np.abs(log.features.measurement).max(axis=1, initial=0.0) > _FURTHEST)
    if len(far):
        raise InputError(
            f"{log.path}: the feature seen from pose {log.features.keys[far[0]]} is more than {_FURTHEST:.0e} m away; "
            "correct or remove the line"
        )
    return log


def _chain(path: Path, graph: FactorGraph) -> tuple[Indices, Array, Array]:
    """Keys ``(N,)`` of a graph's poses in order, with motion ``(N - 1, 3)`` and information from each to the next."""
    keys = np.sort(graph.keys(SE2))
    motion, information = np.full((max(len(keys) - 1, 0), 3), np.nan), np.zeros((max(len(keys) - 1, 0), 3, 3))
    for block in graph.blocks():
        if isinstance(block, Between) and block.kinds == (SE2, SE2):
            place = np.searchsorted(keys, block.keys)
            rows = np.flatnonzero(place[:, 1] - place[:, 0] == 1)
            motion[place[rows, 0]], information[place[rows, 0]] = block.measurement[rows], block.information[rows]
    missing = keys[1:][np.isnan(motion[:, 0])]
    if len(missing):
        raise InputError(
            f"{path}: pose {missing[0]} has no relative pose to the one before it; give a graph with odometry"
        )
    return keys, motion, information
