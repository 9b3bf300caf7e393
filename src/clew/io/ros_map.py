"""Occupancy maps as ROS's map_server reads them: an image and a YAML file beside it."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.io.atomic import atomic_write, atomic_write_binary, ensure_output_folder
from clew.io.content import read_content

Array = NDArray[np.float64]

OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.196
#: Grey values of map_saver; 205 stands for a probability of 0.19608, just above the threshold of free.
_OCCUPIED, _FREE, _UNKNOWN = 0, 254, 205


@dataclass(frozen=True, eq=False)
class RosMap:
    """An occupancy map read from files.

    Attributes:
        occupancy: ``(rows, columns)`` 1 occupied, 0 free, ``nan`` unknown; row 0 is the lowest y.
        resolution: metres a cell.
        origin: ``(3,)`` x, y (metres) and yaw (radians) of the outer corner of cell (0, 0) in the world.
    """

    occupancy: Array
    resolution: float
    origin: Array


def write_ros_map(path: str | PathLike[str], occupancy: Array | NDArray[np.uint8], resolution: float,
                  origin: Array) -> tuple[Path, Path]:
    """Write ``map.pgm`` and ``map.yaml`` into a folder, or ``<stem>.pgm`` and ``<stem>.yaml``.

    Args:
        path: an existing folder, or a file name whose ending (if any) is replaced.
        occupancy: ``(rows, columns)``, row 0 the lowest y: probabilities in [0, 1] with ``nan`` unknown
            (above 0.65 occupied, below 0.196 free, unknown between), or grey values as uint8, kept.
        resolution: metres a cell.
        origin: ``(2,)`` or ``(3,)`` world position (and yaw) of the outer corner of cell (0, 0).

    Returns:
        The paths of the image and of the YAML file.

    Raises:
        InputError: an argument has a wrong shape or value, or a file cannot be written.
    """
    path = Path(path)
    stem = path / "map" if path.is_dir() else path.with_suffix("")
    origin = np.asarray(origin, dtype=np.float64)
    if occupancy.ndim != 2 or occupancy.size == 0:
        raise InputError(f"{stem}.pgm: a map has rows and columns, not shape {occupancy.shape}")
    if origin.shape not in ((2,), (3,)) or not np.isfinite(origin).all() or not 0 < resolution < math.inf:
        raise InputError(f"{stem}.yaml: resolution {resolution}, origin {origin.tolist()} place no map")
    grey = _grey(occupancy)
    ensure_output_folder(stem.parent)
    image, description = stem.with_name(stem.name + ".pgm"), stem.with_name(stem.name + ".yaml")
    with atomic_write_binary(image) as binary:
        binary.write(f"P5\n{grey.shape[1]} {grey.shape[0]}\n255\n".encode())
        # An image's first row is its top: the largest y.
        binary.write(np.ascontiguousarray(grey[::-1]).tobytes())
    x, y, yaw = (*origin.tolist(), 0.0)[:3]
    with atomic_write(description) as text:
        text.write(f"image: {image.name}\nresolution: {float(resolution)!r}\n"
                   f"origin: [{x!r}, {y!r}, {yaw!r}]\nnegate: 0\n"
                   f"occupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n")
    return image, description


def _grey(occupancy: Array | NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Grey values of probabilities; those that are grey already stay."""
    if occupancy.dtype == np.uint8:
        return occupancy.astype(np.uint8, copy=False)
    with np.errstate(invalid="ignore"):
        return np.select([occupancy > OCCUPIED_THRESHOLD, occupancy < FREE_THRESHOLD],
                         [_OCCUPIED, _FREE], _UNKNOWN).astype(np.uint8)


def write_png_map(path: str | PathLike[str], grid: RosMap) -> None:
    """Write a map as one PNG image in the grey values of map_saver; its texts tell resolution and origin.

    Raises:
        InputError: the file cannot be written.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    about = PngInfo()
    about.add_text("resolution", repr(float(grid.resolution)))
    about.add_text("origin", " ".join(map(repr, grid.origin.tolist())))
    packed = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(_grey(grid.occupancy)[::-1])).save(packed, "PNG", pnginfo=about)
    with atomic_write_binary(path) as file:
        file.write(packed.getvalue())


def read_png_map(path: str | PathLike[str]) -> RosMap:
    """Read what `write_png_map` wrote.

    Raises:
        InputError: it is no PNG image, or its texts do not tell resolution and origin.
    """
    path = Path(path)
    grey, texts = _read_png(path, read_content(path).data)
    try:
        resolution = float(texts["resolution"])
        origin = np.array([float(word) for word in texts["origin"].split()])
    except (KeyError, ValueError):
        raise InputError(f"{path}: the image does not tell resolution and origin, as the maps do that `clew convert` "
                         "writes; give the YAML file of a map that names it as its `image:`") from None
    if origin.shape != (3,) or not np.isfinite(origin).all() or not 0 < resolution < math.inf:
        raise InputError(f"{path}: resolution {resolution}, origin {origin.tolist()} place no map")
    occupancy = np.select([1.0 - grey > OCCUPIED_THRESHOLD, 1.0 - grey < FREE_THRESHOLD], [1.0, 0.0], math.nan)
    return RosMap(np.ascontiguousarray(occupancy[::-1]), resolution, origin)


def _read_yaml(path: Path) -> dict[str, str]:
    """The ``key: value`` lines of a map's YAML file, which has no deeper structure."""
    text = read_content(path).data.decode("utf-8", errors="replace")
    lines = (line.split("#", 1)[0] for line in text.splitlines())
    pairs = (line.split(":", 1) for line in lines if ":" in line)
    fields = {key.strip(): value.strip().strip("'\"") for key, value in pairs}
    for key in ("image", "resolution", "origin"):
        if not fields.get(key):
            raise InputError(f"{path}: has no `{key}:` line; give the YAML file of a ROS map")
    return fields


def _number(path: Path, fields: dict[str, str], key: str, default: str) -> float:
    try:
        value = float(fields.get(key, default))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{path}: `{key}: {fields.get(key)}` is not a number; correct it")
    return value


def _read_image(path: Path) -> Array:
    """Grey values in [0, 1] of a PGM or PNG image, first row on top."""
    data = read_content(path).data
    return _read_png(path, data)[0] if data.startswith(b"\x89PNG") else _read_pgm(path, data)


def _read_png(path: Path, data: bytes) -> tuple[Array, Mapping[str, str]]:
    """Grey values of a PNG image, and the texts that it carries."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data)) as image:
            texts = {name: text for name, text in image.info.items() if isinstance(text, str)}
            return np.asarray(image.convert("L"), dtype=np.float64) / 255.0, texts
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(f"{path}: is a damaged PNG image ({error}); get the file again") from None


def _read_pgm(path: Path, data: bytes) -> Array:
    """Grey values of a binary or plain PGM image."""
    header = re.match(rb"(P[25])(?:\s|#[^\n]*\n)+(\d+)(?:\s|#[^\n]*\n)+(\d+)(?:\s|#[^\n]*\n)+(\d+)\s", data)
    if header is None:
        raise InputError(f"{path}: is no PGM and no PNG image; convert it")
    columns, rows, top = (int(text) for text in header.groups()[1:])
    if not 0 < top < 65536 or rows * columns == 0:
        raise InputError(f"{path}: an image of {columns} x {rows} with maximum {top} is no map")
    body = data[header.end():]
    if header.group(1) == b"P5":
        kind = np.dtype(np.uint8 if top < 256 else ">u2")
        values = np.frombuffer(body, dtype=kind, count=len(body) // kind.itemsize)
    else:
        values = np.array([int(word) for word in re.findall(rb"\d+", body)[: rows * columns]])
    if len(values) < rows * columns:
        raise InputError(f"{path}: ends after {len(values)} of {rows * columns} cells; get the file again")
    return np.asarray(values[: rows * columns], dtype=np.float64).reshape(rows, columns) / top


def read_ros_map(path: str | PathLike[str]) -> RosMap:
    """Read the map that a YAML file describes, as map_server's trinary mode does.

    Raises:
        InputError: a file is missing or damaged, or a field is missing or wrong.
    """
    path = Path(path)
    fields = _read_yaml(path)
    numbers = re.findall(r"[^\s,\[\]]+", fields["origin"])
    try:
        origin = np.array([float(text) for text in numbers])
    except ValueError:
        origin = np.zeros(0)
    resolution = _number(path, fields, "resolution", "nan")
    if origin.shape != (3,) or not np.isfinite(origin).all() or resolution <= 0:
        raise InputError(f"{path}: needs `origin: [x, y, yaw]` and a positive `resolution:`; correct them")
    grey = _read_image(path.parent / fields["image"])
    negate = fields.get("negate", "0").lower() in ("1", "true")
    probability = grey if negate else 1.0 - grey
    occupied = probability > _number(path, fields, "occupied_thresh", str(OCCUPIED_THRESHOLD))
    free = probability < _number(path, fields, "free_thresh", str(FREE_THRESHOLD))
    occupancy = np.select([occupied, free], [1.0, 0.0], math.nan)
    return RosMap(np.ascontiguousarray(occupancy[::-1]), resolution, origin)
