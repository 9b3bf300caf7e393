"""``clew demo``: the same job on a simulated robot, compared with the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from clew.cli.live import LiveHost, LiveKeep, LiveNoOpen, LiveOption, LiveOptions, LivePort
from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet


def demo(
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Output folder.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Another seed makes another building, way and noise.")] = 1,
    seconds: Annotated[float, typer.Option(help="Length of the drive.")] = 400.0,
    live: LiveOption = None,
    live_host: LiveHost = "127.0.0.1",
    live_port: LivePort = 0,
    no_open: LiveNoOpen = False,
    live_keep: LiveKeep = False,
    json: Json = False,
    quiet: Quiet = False,
    log_level: LogLevelOption = LogLevel.WARNING,
) -> None:
    """Simulate a robot with a laser in an office building, map it, and compare with the truth.

    The robot drives through rooms, round loops and along a bare corridor; its wheels slip, so that dead
    reckoning ends metres off. What it records goes through the same job as a real log (see `clew run --help`).
    The files of `clew run` are written, and truth.tum beside them.

    **Examples**

    `clew demo`

    `clew demo -o other --seed 7`

    `clew demo --live`
    """
    from clew.cli.job import run_demo

    viewing = LiveOptions(live, live_host, live_port, no_open, live_keep)
    run_demo(out, seed, seconds, json, quiet, viewing)
