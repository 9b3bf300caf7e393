"""clew: graph SLAM as a Python package.

A robot's log goes in, an optimised trajectory with honest uncertainty and a map come out. The names below are
loaded when they are first used, so that ``import clew`` stays quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from clew._version import __version__

# public name -> room that exports it
_EXPORTS = {
    **dict.fromkeys(("SE2", "SE3", "SO2", "SO3", "Point2", "Point3"), "geometry"),
    **dict.fromkeys(("FactorGraph", "Role"), "graph"),
    **dict.fromkeys(
        ("Prior", "Between", "PointObservation", "RangeBearing", "Bearing", "Range", "Position", "CustomFactor"),
        "factors",
    ),
    **dict.fromkeys(
        ("Huber", "PseudoHuber", "Cauchy", "GemanMcClure", "Welsch", "Tukey", "DCS"),
        "noise",
    ),
    **dict.fromkeys(("optimize", "Solution", "Status"), "solve"),
    **dict.fromkeys(("marginalise", "Marginalised"), "reduce"),
    **dict.fromkeys(("Slam", "SlamConfig"), "slam"),
}

__all__ = ["__version__", *_EXPORTS]


def __getattr__(name: str) -> Any:
    room = _EXPORTS.get(name)
    if room is None:
        raise AttributeError(f"module 'clew' has no attribute {name!r}")
    value = getattr(import_module(f"clew.{room}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
