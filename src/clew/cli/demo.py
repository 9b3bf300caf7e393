"""``clew demo``: the same job on a simulated robot, compared with the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def demo(
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Output folder.")] = Path("demo"),
    seed: Annotated[int, typer.Option(help="Another seed makes another building, way and noise.")] = 1,
    seconds: Annotated[float, typer.Option(help="Length of the drive.")] = 400.0,
    json: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Simulate a robot with a laser in an office building, map it, and compare with the truth.

    The robot drives through rooms, round loops and along a bare corridor; its wheels slip, so that dead
    reckoning ends metres off. What it records goes through the same job as a real log (see `clew run --help`).
    The files of `clew run` are written, and truth.tum beside them.

    **Examples**

    `clew demo`

    `clew demo -o other --seed 7`
    """
    from clew.cli.job import run_demo

    run_demo(out, seed, seconds, json, quiet)
