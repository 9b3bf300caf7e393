"""Formats that clew writes, by the ending of a name."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from clew.errors import InputError


class Format(str, Enum):
    """Choices of ``clew convert --to``."""

    G2O = "g2o"
    TORO = "toro"
    TUM = "tum"
    KITTI = "kitti"
    CSV = "csv"
    CARMEN = "carmen"
    ROS1 = "bag"
    SQLITE3 = "sqlite3"
    MCAP = "mcap"
    MAP = "map"
    PNG = "png"


GRAPHS = (Format.G2O, Format.TORO)
TRAJECTORIES = (Format.TUM, Format.KITTI, Format.CSV)
LOGS = (Format.CARMEN, Format.ROS1, Format.SQLITE3, Format.MCAP)
MAPS = (Format.MAP, Format.PNG)
PACKED = (Format.G2O, Format.TORO, Format.CARMEN)  # may have .gz or .bz2 behind

ENDINGS = {
    ".g2o": Format.G2O, ".graph": Format.TORO, ".toro": Format.TORO, ".tum": Format.TUM, ".kitti": Format.KITTI,
    ".txt": Format.KITTI, ".csv": Format.CSV, ".log": Format.CARMEN, ".clf": Format.CARMEN, ".carmen": Format.CARMEN,
    ".bag": Format.ROS1, ".db3": Format.SQLITE3, ".mcap": Format.MCAP, ".yaml": Format.MAP, ".pgm": Format.MAP,
    ".png": Format.PNG,
}  # fmt: skip


def format_of(path: Path, among: tuple[Format, ...]) -> Format:
    """The format that the ending of a name asks for.

    Args:
        path: the name.
        among: formats that make sense.

    Raises:
        InputError: the ending stands for none of them, or is packed where the format cannot be.
    """
    packed = path.suffix.lower() in (".gz", ".bz2")
    ending = (Path(path.stem) if packed else path).suffix.lower()
    wanted = ENDINGS.get(ending)
    if wanted not in among or (packed and wanted not in PACKED):
        names = [f"{end} ({kind.value})" for end, kind in ENDINGS.items() if kind in among]
        with_packing = [end for end, kind in ENDINGS.items() if kind in among and kind in PACKED]
        more = f"; .gz or .bz2 may follow {', '.join(with_packing)}" if with_packing else ""
        raise InputError(f"{path}: the ending {ending + (path.suffix if packed else '')!r} is no format to write here; "
                         f"choose {', '.join(names)}{more}")
    return wanted
