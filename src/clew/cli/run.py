"""``clew run``: a log in, a map out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from clew.cli.live import LiveHost, LiveKeep, LiveNoOpen, LiveOption, LiveOptions, LivePort
from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet


def run(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG", show_default=False, help="CARMEN log, ROS bag, MRCLAM folder, or file of features."
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", show_default=False, help="Output folder.")],
    refine: Annotated[
        bool, typer.Option("--refine/--no-refine", help="Refine all scans jointly at the end.")
    ] = True,
    odometry: Annotated[
        bool, typer.Option("--odometry/--no-odometry", help="Use the log's odometry, or scans alone.")
    ] = True,
    resolution: Annotated[float, typer.Option(metavar="METRES", help="Side of a cell of the map.")] = 0.05,
    scan_topic: Annotated[
        str | None, typer.Option(metavar="TOPIC", show_default=False, help="Topic of the scans of a bag.")
    ] = None,
    odometry_topic: Annotated[
        str | None, typer.Option(metavar="TOPIC", show_default=False, help="Topic of the odometry of a bag.")
    ] = None,
    imu: Annotated[
        bool, typer.Option("--imu/--no-imu", help="Let the gyro of a bag's IMU tell turns, or leave it out.")
    ] = True,
    imu_topic: Annotated[
        str | None, typer.Option(metavar="TOPIC", show_default=False, help="Topic of the IMU of a bag.")
    ] = None,
    robot: Annotated[
        int | None, typer.Option(metavar="N", show_default=False, help="Robot of an MRCLAM folder; default: all.")
    ] = None,
    identities: Annotated[
        bool, typer.Option("--identities/--no-identities", help="Use identities of landmarks that the log has.")
    ] = True,
    live: LiveOption = None,
    live_host: LiveHost = "127.0.0.1",
    live_port: LivePort = 0,
    no_open: LiveNoOpen = False,
    live_keep: LiveKeep = False,
    json: Json = False,
    quiet: Quiet = False,
    log_level: LogLevelOption = LogLevel.WARNING,
) -> None:
    """Map a robot's log: laser scans and wheel odometry in, trajectory, graph and map out.

    LOG is a CARMEN log (plain, .gz or .bz2) or a ROS bag (ROS 1 .bag; ROS 2 folder, .db3 or .mcap; needs
    `pip install 'clew[bags]'`). Nothing needs to be set: what depends on the sensor is read from the log.
    Ctrl-C stops and writes what has been mapped so far.

    A bag may hold an IMU (sensor_msgs/Imu): its gyro tells the turns, with bias, noise and clock found on the way; one
    that is worse than the wheels is left aside. With it a bag needs no odometry. Transforms or gravity say how the
    IMU is mounted.

    A folder of the UTIAS MRCLAM data (odometry and sightings of landmarks) gives landmarks.csv and landmarks.png in
    place of the map, for one robot or for all of them in one graph; the options of laser logs do not concern it.

    A file of features seen on the way gives the same for landmarks whose identity nobody knows: a g2o file with
    odometry and `DATA_FEATURE_POINTXY` lines, or a `.circles` log (whose identities `--no-identities` disregards).
    Which sightings are of one landmark, and how noisy they are, is found on the way.

    **OUT** receives report.html (look at this first: map, replay, closures with their scans, what to check),
    trajectory.tum (a pose for every scan), keyframes.tum, graph.g2o, map.pgm and map.yaml (for ROS), map.png,
    overview.png, closures.csv and summary.json.

    With --live a page in the browser shows map and graph while they grow (on this machine only; the address that is
    printed holds a key that lets you in). Closing it changes nothing.

    **Examples**

    `clew run intel.clf.bz2 -o out`

    `clew run intel.clf.bz2 -o out --live`

    `clew run recording.bag -o out --scan-topic /front/scan`

    `clew run robot.log -o out --resolution 0.1 --json`

    `clew run MRCLAM_Dataset6 -o out --robot 3`

    `clew run victoriaPark-noassoc.g2o.gz -o out`
    """
    from clew.cli.job import run_log
    from clew.errors import InputError
    from clew.io import is_feature_log, is_mrclam

    if is_mrclam(log):
        if live is not None:
            raise InputError(f"--live: shows runs of laser logs, and {log} is an MRCLAM folder; leave the option out")
        from clew.cli.landmark_job import run_landmarks

        run_landmarks(log, out, robot, json, quiet)
        return
    if robot is None and is_feature_log(log):
        if live is not None:
            raise InputError(f"--live: shows runs of laser logs, and {log} holds features; leave the option out")
        from clew.cli.feature_job import run_features

        run_features(log, out, identities, json, quiet)
        return
    if robot is not None:
        raise InputError(f"--robot {robot}: {log} is no MRCLAM folder; leave the option out")
    viewing = LiveOptions(live, live_host, live_port, no_open, live_keep)
    run_log(log, out, refine, odometry, resolution, scan_topic, odometry_topic, json, quiet, viewing, imu,
            imu_topic)
