"""``clew convert``: a file in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from clew.cli.formats import Format
from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", show_default=False, help="File or folder to read.")],
    target: Annotated[Path, typer.Argument(metavar="OUT", show_default=False, help="File (or folder) to write.")],
    to: Annotated[Format | None, typer.Option(
        "--to", show_default=False, help="Format to write; by default the ending of OUT says.")] = None,
    scan_topic: Annotated[str | None, typer.Option(
        metavar="TOPIC", show_default=False, help="Topic of the scans of a bag.")] = None,
    odometry_topic: Annotated[str | None, typer.Option(
        metavar="TOPIC", show_default=False, help="Topic of the odometry of a bag.")] = None,
    imu_topic: Annotated[str | None, typer.Option(
        metavar="TOPIC", show_default=False, help="Topic of the IMU of a bag.")] = None,
    json: Json = False,
    quiet: Quiet = False,
    log_level: LogLevelOption = LogLevel.WARNING,
) -> None:
    """Write a file in another format, and say what is lost on the way.

    **Graphs**: g2o and TORO (.g2o, .graph; .gz and .bz2 behind them), and from a graph to a trajectory.

    **Trajectories**: TUM, KITTI, CSV (.tum, .kitti or .txt, .csv).

    **Logs**: CARMEN (.log, .clf; .gz, .bz2), ROS 1 bags (.bag), ROS 2 bags (.db3, .mcap, or --to for a folder);
    bags need `pip install 'clew[bags]'`.

    **Maps**: ROS maps (.yaml with .pgm beside it) and PNG images that tell their place (.png).

    What IN is, is told by its content. A file of the name OUT is replaced once the new one is whole.

    **Examples**

    `clew convert graph.g2o graph.graph`

    `clew convert out/trajectory.tum trajectory.csv`

    `clew convert intel.clf.bz2 intel.mcap`

    `clew convert recording.bag folder --to sqlite3`

    `clew convert out/map.yaml map.png`
    """
    import json as json_

    from clew.cli.conversion import convert_file
    from clew.cli.terminal import messages

    done = convert_file(source, target, to, scan_topic, odometry_topic, messages(quiet), imu_topic)
    if json:
        typer.echo(json_.dumps(done.to_dict(), indent=2))
    elif not quiet:
        typer.echo(done.sentence())
