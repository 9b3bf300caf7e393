"""Small CARMEN logs, written line by line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

DATA = Path(__file__).parents[2] / "shared" / "data"


def flaser(time: float, ranges: Sequence[float | str], laser: Sequence[float] = (0, 0, 0),
           robot: Sequence[float] = (0, 0, 0)) -> str:
    """One FLASER line."""
    fields = [len(ranges), *ranges, *laser, *robot, f"{time:.6f}", "nohost", f"{time - 100:.6f}"]
    return "FLASER " + " ".join(str(field) for field in fields)


def robotlaser(time: float, ranges: Sequence[float | str], *, start: float = -1.570796,
               view: float = 3.141593, resolution: float = 0.017453, maximum: float = 80.0,
               remissions: Sequence[float] | None = (),
               laser: Sequence[float] = (0, 0, 0), robot: Sequence[float] = (0, 0, 0)) -> str:
    """One ROBOTLASER1 line; without the remissions and the turn axis, as the first ones, for ``None``."""
    fields = [0, start, view, resolution, maximum, 0.01, 0, len(ranges), *ranges]
    if remissions is not None:
        fields += [len(remissions), *remissions]
    fields += [*laser, *robot, 0.1, 0.2, 0.3, 0.4]
    if remissions is not None:
        fields += [1e6]
    return "ROBOTLASER1 " + " ".join(str(field) for field in [*fields, f"{time:.6f}", "nohost", "0.5"])


def odom(time: float, pose: Sequence[float] = (0, 0, 0)) -> str:
    """One ODOM line."""
    return "ODOM " + " ".join(str(v) for v in [*pose, 0.0, 0.0, 0.0, f"{time:.6f}", "nohost", "0.5"])


def write(folder: Path, *lines: str, name: str = "log.clf") -> Path:
    """A log of these lines."""
    path = folder / name
    path.write_text("".join(line + "\n" for line in lines))
    return path
