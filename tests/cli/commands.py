"""The command in this process and in one of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

import clew
from clew.cli import main
from clew.sim import LaserModel, SimulatedLog, simulate_kind

FILES = ("trajectory.tum", "keyframes.tum", "graph.g2o", "closures.csv", "map.pgm", "map.yaml", "map.png",
         "overview.png", "report.html", "summary.json")
PROGRAM = [sys.executable, "-c", "from clew.cli import main; main()"]


@dataclass
class Outcome:
    """Exit code and what was printed."""

    code: int
    out: str
    err: str


Command = Callable[..., Outcome]


@cache
def drive(seconds: float = 15.0) -> SimulatedLog:
    """A short drive through an office."""
    return simulate_kind("office", 5, duration=seconds, rate=3.0, laser=LaserModel(beams=181))


def in_process(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: object) -> Outcome:
    """What ``clew ARGUMENTS`` does, without starting a process."""
    monkeypatch.setattr(sys, "argv", ["clew", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        main()
    captured = capsys.readouterr()
    code = caught.value.code
    return Outcome(int(code or 0), captured.out, captured.err)


def environment() -> dict[str, str]:
    """One in which a new process finds the package that is tested here."""
    return {**os.environ, "PYTHONPATH": str(Path(clew.__file__).parents[1]), "NO_COLOR": "1", "COLUMNS": "100"}


def as_process(*arguments: object) -> Outcome:
    """What ``clew ARGUMENTS`` does in a process of its own."""
    done = subprocess.run([*PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=120,
                          env=environment(), check=False)
    return Outcome(done.returncode, done.stdout, done.stderr)
