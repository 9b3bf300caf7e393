"""``clew info``: what a file holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet


def info(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", show_default=False,
                                                help="Files or folders of any kind that clew reads.")],
    json: Json = False,
    quiet: Quiet = False,
    log_level: LogLevelOption = LogLevel.WARNING,
) -> None:
    """Tell what a file holds: format, sensors, rates, duration, size, problems.

    The kind is told by the content, not by the name: CARMEN logs (plain, .gz, .bz2), ROS 1 and ROS 2 bags, MRCLAM
    folders, g2o and TORO graphs, TUM, KITTI and CSV trajectories, relations, ROS maps (the YAML file), and output
    folders of clew.

    **Examples**

    `clew info intel.clf.bz2`

    `clew info graph.g2o out/trajectory.tum out`

    `clew info recording.bag --json`
    """
    import json as json_

    from clew.cli.describe import describe
    from clew.cli.terminal import results

    found = [(path, describe(path)) for path in files]
    if json:
        data = [about.data for _, about in found]
        typer.echo(json_.dumps(data[0] if len(data) == 1 else data, indent=2))
    elif not quiet:
        console = results()
        for place, (path, about) in enumerate(found):
            if place:
                console.print()
            about.print(console, str(path))
