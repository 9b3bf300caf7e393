"""From options to a finished mapping job and its report."""

from __future__ import annotations

import json as json_
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console

from clew._version import __version__
from clew.cli.mapping_job import JobOptions, JobResult, Source, map_log
from clew.cli.outputs import write_summary
from clew.errors import InputError

INTERRUPTED = 130
LEAST_RESOLUTION, LARGEST_RESOLUTION = 0.005, 1.0


def run_log(
    path: Path, out: Path, refine: bool, odometry: bool, resolution: float, scan_topic: str | None,
    odometry_topic: str | None, json: bool, quiet: bool,
) -> None:  # fmt: skip
    """The job of ``clew run``."""
    from clew.io import ensure_output_folder, open_log

    if not LEAST_RESOLUTION <= resolution <= LARGEST_RESOLUTION:
        raise InputError(
            f"--resolution {resolution:g}: give metres a cell between {LEAST_RESOLUTION:g} and {LARGEST_RESOLUTION:g}"
        )
    begun = time.perf_counter()
    console = Console(stderr=True, quiet=quiet)
    with console.status(f"reading {path.name}"):
        log = open_log(path, scan_topic=scan_topic, odometry_topic=odometry_topic)
    if odometry and not log.has_odometry:
        raise InputError(
            f"{path}: {log.scan_count} scans but no odometry: record it too, "
            "or estimate the motion from the scans alone with --no-odometry"
        )
    ensure_output_folder(out)
    result = map_log(log, JobOptions(out, path.name, refine, odometry, resolution, quiet), console, begun)
    _finish(result, {"log": path.name}, out, log, json, console)


def run_demo(out: Path, seed: int, seconds: float, json: bool, quiet: bool) -> None:
    """The job of ``clew demo``."""
    from clew.evaluate import absolute_trajectory_error
    from clew.io import ensure_output_folder, write_tum
    from clew.sim import simulate_demo

    if not 10 <= seconds <= 36000:
        raise InputError(f"--seconds {seconds:g}: give between 10 and 36000")
    if seed < 0:
        raise InputError(f"--seed {seed}: give a number that is not negative")
    ensure_output_folder(out)
    console = Console(stderr=True, quiet=quiet)
    with console.status("simulating"):
        log = simulate_demo(seed, duration=seconds)
    result = map_log(log, JobOptions(out, f"clew demo, seed {seed}", quiet=quiet), console)
    stamps = result.slam.trajectory.timestamps
    truth = log.T_world_robot[np.searchsorted(log.timestamps, stamps)]
    write_tum(out / "truth.tum", stamps, truth)
    errors = {
        name: absolute_trajectory_error(stamps, truth, stamps, estimate.T_world_robot).translation.rmse
        for name, estimate in (("ate_m", result.slam.trajectory), ("odometry_ate_m", result.slam.odometry))
    }
    about = {"log": f"simulated, seed {seed}", **{name: round(error, 4) for name, error in errors.items()}}
    _finish(result, about, out, log, json, console)


def _finish(
    result: JobResult, about: dict[str, object], out: Path, log: Source, json: bool, console: Console
) -> None:
    summary = {**about, **result.summary, "version": __version__}
    write_summary(summary, out / "summary.json")
    if json:
        sys.stdout.write(json_.dumps(summary) + "\n")
    _report(summary, out, log, console)
    if result.interrupted:
        console.print("interrupted: the files hold what was mapped so far")
        sys.exit(INTERRUPTED)


def sensor_lines(sensor: dict[str, dict[str, object]]) -> list[str]:
    """What the log has told about its sensors, in a few lines."""
    laser = sensor["laser"]
    lines = [
        f"laser: {laser['beams']} beams over {laser['field_of_view_deg']:g} degrees, "
        f"{laser['scans_per_second']} scans a second, range noise {1000 * float(str(laser['range_noise_m'])):.0f} mm"
    ]
    if odometry := sensor.get("odometry"):
        metre, radian = odometry["noise_per_sqrt_metre"], odometry["noise_per_sqrt_radian"]
        assert isinstance(metre, dict)
        assert isinstance(radian, dict)
        lines.append(
            f"odometry: off by {100 * metre['forward']:.1f} cm forwards, {100 * metre['sideways']:.1f} cm sideways and "
            f"{np.degrees(metre['turn']):.2f} degrees after a metre, {np.degrees(radian['turn']):.1f} degrees after a "
            "radian (standard deviations)"
        )
    return [*lines, *(str(doubt) for doubt in sensor.get("doubts", []))]


def _report(summary: dict[str, object], out: Path, log: Source, console: Console) -> None:
    """The outcome in a few lines."""
    console.print(
        f"{summary['scans']} scans, {summary['keyframes']} keyframes, {summary['closures_accepted']} loop closures "
        f"({summary['closures_rejected']} candidates rejected)",
        highlight=False,
    )
    if "ate_m" in summary:
        console.print(
            f"error against the truth {summary['ate_m']} m; odometry alone {summary['odometry_ate_m']} m (ATE, RMSE)",
            highlight=False,
        )
    console.print(
        f"{summary['log_seconds']} s of log in {summary['wall_seconds']} s, {summary['realtime_factor']} x real time, "
        f"{summary['peak_memory_mb']} MB",
        highlight=False,
    )
    sensor = summary["sensor"]
    assert isinstance(sensor, dict)
    for line in sensor_lines(sensor):
        console.print(line, highlight=False)
    skipped = summary["skipped"]
    assert isinstance(skipped, dict)
    if skipped:
        listed = ", ".join(f"{count} {reason}" for reason, count in skipped.items())
        console.print(f"left out: {listed}", highlight=False)
    console.print(f"look at {out / 'overview.png'}; everything else is beside it", highlight=False)
