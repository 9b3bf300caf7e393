"""What a file or folder is, told by its content."""

from __future__ import annotations

import re
from enum import Enum
from os import PathLike
from pathlib import Path

import numpy as np

from clew.errors import InputError
from clew.io.bag import bag_suffix
from clew.io.circles import is_circles
from clew.io.content import check_readable, check_text, read_content
from clew.io.mrclam import is_mrclam


class FileKind(Enum):
    """Kinds of files and folders that clew reads; the value says what it is called."""

    CARMEN = "CARMEN log"
    ROS1_BAG = "ROS 1 bag"
    ROS2_SQLITE = "ROS 2 bag, sqlite3"
    ROS2_MCAP = "ROS 2 bag, MCAP"
    MRCLAM = "MRCLAM folder"
    CIRCLES = "circles log"
    G2O = "g2o graph"
    TORO = "TORO graph"
    TUM = "TUM trajectory"
    KITTI = "KITTI trajectory"
    CSV = "CSV trajectory"
    RELATIONS = "relations"
    ROS_MAP = "ROS map"
    PNG_MAP = "PNG map"
    OUTPUT = "output folder of clew"


_BAGS = {".bag": FileKind.ROS1_BAG, ".db3": FileKind.ROS2_SQLITE, ".mcap": FileKind.ROS2_MCAP}
_GRAPH_TAG = re.compile(rb"^(VERTEX|EDGE|FIX\b|PARAMS_)", re.MULTILINE)
_TORO_TAG = re.compile(rb"^(VERTEX[23]|EDGE[23])\s", re.MULTILINE)
_CARMEN_TAG = re.compile(rb"^(FLASER|RLASER|ROBOTLASER\d|RAWLASER\d|ODOM|PARAM|TRUEPOS|SYNC|NMEA\w*)\s", re.MULTILINE)
_MAP_KEYS = re.compile(rb"^(image|resolution)\s*:", re.MULTILINE)
_CSV_HEADER = re.compile(rb"\s*#?\s*(timestamp|time|t)\s*,\s*x\s*,\s*y\b")
_HEAD = 1 << 20  # bytes that tell what a text is
ADVICE = ("give a CARMEN log, a ROS bag, an MRCLAM folder, a circles log, a g2o or TORO graph, a TUM, KITTI or CSV "
          "trajectory, relations, the YAML file of a ROS map, or an output folder of clew")


def file_kind(path: str | PathLike[str]) -> FileKind:
    """The kind of a file or folder, by what is in it, whatever its name.

    Raises:
        InputError: it is missing, unreadable, empty, or of no kind that clew knows.
    """
    path = Path(path)
    check_readable(path)
    if path.is_dir():
        return _folder_kind(path)
    if not path.is_file():  # it could be read once only, or for ever
        raise InputError(f"{path}: is a pipe or a device; store it in a file first")
    suffix = bag_suffix(path)
    if suffix is not None:
        return _BAGS[suffix]
    data = read_content(path).data[:_HEAD]
    if data.startswith(b"\x89PNG"):
        return FileKind.PNG_MAP
    if re.match(rb"P[25]\s", data):
        raise InputError(f"{path}: the image of a ROS map; give the YAML file beside it")
    check_text(path, data)
    if is_circles(data):
        return FileKind.CIRCLES
    if _GRAPH_TAG.search(data):
        return FileKind.TORO if _TORO_TAG.search(data) else FileKind.G2O
    if _CARMEN_TAG.search(data):
        return FileKind.CARMEN
    if len(set(_MAP_KEYS.findall(data))) == 2:
        return FileKind.ROS_MAP
    if _CSV_HEADER.match(data):
        return FileKind.CSV
    kind = _table_kind(data)
    if kind is None and path.suffix == ".dat" and is_mrclam(path.parent):
        raise InputError(f"{path}: is one file of an MRCLAM folder; give the folder {path.parent}")
    if kind is None:
        raise InputError(f"{path}: is of no kind that clew reads; {ADVICE}")
    return kind


def _folder_kind(path: Path) -> FileKind:
    if (path / "metadata.yaml").exists():
        text = (path / "metadata.yaml").read_bytes()
        return FileKind.ROS2_MCAP if b"mcap" in text else FileKind.ROS2_SQLITE
    if is_mrclam(path):
        return FileKind.MRCLAM
    if (path / "summary.json").exists() or (path / "graph.g2o").exists():
        return FileKind.OUTPUT
    raise InputError(f"{path}: a folder that is no ROS 2 bag (metadata.yaml), no MRCLAM data (RobotN_Odometry.dat) and "
                     "no output of clew (summary.json); give a file, or one of these")


def _table_kind(data: bytes) -> FileKind | None:
    """What rows of numbers stand for, by their first ones."""
    lines = [line.strip() for line in data.splitlines()[:2000]]
    rows = [line.split() for line in lines if line and not line.startswith(b"#")][:100]
    try:
        numbers = [[float(word) for word in row] for row in rows]
    except ValueError:
        return None
    if len({len(row) for row in numbers}) != 1:
        return None
    table = np.array(numbers)
    if table.shape[1] == 12:
        return FileKind.KITTI
    if table.shape[1] == 8:
        # Eight numbers are a pose with a quaternion, or two times and a pose with angles.
        unit = np.abs(np.linalg.norm(table[:, 4:], axis=1) - 1.0) < 0.01
        return FileKind.TUM if unit.all() else FileKind.RELATIONS
    return None
