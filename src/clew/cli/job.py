"""From options to a finished mapping job and its report."""

from __future__ import annotations

import json as json_
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from clew._version import __version__
from clew.cli.description import count
from clew.cli.live import LiveOptions, live_view
from clew.cli.mapping_job import JobOptions, JobResult, map_log
from clew.cli.outputs import write_summary
from clew.cli.terminal import messages
from clew.errors import InputError
from clew.io import Log, Records

Array = NDArray[np.float64]

if TYPE_CHECKING:
    from clew.sim import SimulatedLog

INTERRUPTED = 130
LEAST_RESOLUTION, LARGEST_RESOLUTION = 0.005, 1.0


def run_log(
    path: Path, out: Path, refine: bool, odometry: bool, resolution: float, scan_topic: str | None,
    odometry_topic: str | None, json: bool, quiet: bool, live: LiveOptions, imu: bool = True,
    imu_topic: str | None = None,
) -> None:  # fmt: skip
    """The job of ``clew run``."""
    from clew.io import ensure_output_folder, log_health, open_log

    if not LEAST_RESOLUTION <= resolution <= LARGEST_RESOLUTION:
        raise InputError(
            f"--resolution {resolution:g}: give metres a cell between {LEAST_RESOLUTION:g} and {LARGEST_RESOLUTION:g}"
        )
    begun = time.perf_counter()
    console = messages(quiet)
    with console.status(f"reading {path.name}"):
        log = open_log(path, scan_topic=scan_topic, odometry_topic=odometry_topic, imu_topic=imu_topic)
    if odometry and not log.has_odometry:
        why = _no_gyro(log, imu)
        if why is not None:
            raise InputError(
                f"{path}: {count(log.scan_count, 'scan')} but no odometry{why}: record odometry too, "
                "or estimate the motion from the scans alone with --no-odometry"
            )
        console.print("no odometry: motion is estimated from scans and gyro", highlight=False)
        odometry = False
    ensure_output_folder(out)
    with live_view(live, path.name, log.scan_count, console) as viewer:
        result = map_log(log, JobOptions(out, path.name, refine, odometry, imu, resolution), console, begun,
                         health=lambda: log_health(log), viewer=viewer)
        code = _finish(result, {"log": path.name}, out, log, json, console)
    sys.exit(code)


def _no_gyro(log: Log, imu: bool) -> str | None:
    """Why no gyro can stand in for odometry, in brackets; None where one can."""
    from clew.io import log_health

    if not log.has_gyro:
        left = ", ".join(f"{count(number, 'message')} of {reason}" for reason, number in log.report.skipped.items())
        return f" (left out: {left})" if left else ""
    if not imu:
        return " (its gyro is left out by --no-imu)"
    health = log_health(log)
    if health.gyro is not None and health.gyro.usable:
        return None
    return f" ({'; '.join(problem for problem in health.problems if problem.startswith('gyro'))})"


def run_demo(out: Path, seed: int, seconds: float, json: bool, quiet: bool, live: LiveOptions) -> None:
    """The job of ``clew demo``."""
    from clew.geometry import se2
    from clew.io import ensure_output_folder, log_health
    from clew.sim import simulate_demo
    from clew.slam import Trajectory

    if not 10 <= seconds <= 36000:
        raise InputError(f"--seconds {seconds:g}: give between 10 and 36000")
    if seed < 0:
        raise InputError(f"--seed {seed}: give a number that is not negative")
    ensure_output_folder(out)
    console = messages(quiet)
    with console.status("simulating"):
        log = simulate_demo(seed, duration=seconds)

    def truth(stamps: Array) -> Trajectory:
        poses = log.T_world_robot[np.searchsorted(log.timestamps, stamps)]
        return Trajectory(stamps, se2.between(poses[0], poses))

    title = f"clew demo, seed {seed}"
    with live_view(live, title, log.scan_count, console) as viewer:
        result = map_log(log, JobOptions(out, title), console, health=lambda: log_health(log), truth=truth,
                         viewer=viewer)
        about = _against_truth(result, log, out, seed)
        code = _finish(result, about, out, log, json, console)
    sys.exit(code)


def _against_truth(result: JobResult, log: SimulatedLog, out: Path, seed: int) -> dict[str, object]:
    """Write the truth beside the estimate, and say how far the two are apart."""
    from clew.evaluate import absolute_trajectory_error
    from clew.io import write_tum

    stamps = result.slam.trajectory.timestamps
    true_poses = log.T_world_robot[np.searchsorted(log.timestamps, stamps)]
    write_tum(out / "truth.tum", stamps, true_poses)
    errors = {
        name: absolute_trajectory_error(stamps, true_poses, stamps, estimate.T_world_robot).translation.rmse
        for name, estimate in (("ate_m", result.slam.trajectory), ("odometry_ate_m", result.slam.odometry))
    }
    return {"log": f"simulated, seed {seed}", **{name: round(error, 4) for name, error in errors.items()}}


def _finish(
    result: JobResult, about: dict[str, object], out: Path, log: Records, json: bool, console: Console
) -> int:
    """Write and print the outcome; returns the exit code."""
    summary = {**about, **result.summary, "version": __version__}
    write_summary(summary, out / "summary.json")
    if json:
        sys.stdout.write(json_.dumps(summary) + "\n")
    _report(summary, out, log, console)
    if result.interrupted:
        console.print("interrupted: the files hold what was mapped so far" if result.summary["complete"] is False
                      else "interrupted: the whole log is mapped, but not refined to the end")
        return INTERRUPTED
    return 0


def sensor_lines(sensor: dict[str, dict[str, object]]) -> list[str]:
    """What the log has told about its sensors, in a few lines."""
    laser = sensor["laser"]
    lines = [
        f"laser: {laser['beams']} beams over {laser['field_of_view_deg']:g} degrees, "
        f"{laser['scans_per_second']} scans a second, range noise {1000 * float(str(laser['range_noise_m'])):.0f} mm"
    ]
    if laser["sweep_known_from"] == "scans":
        found = {"one after the other within": laser["sweep_seconds"],
                 "every second one later by": laser["interlace_seconds"]}
        told = ", ".join(f"{what} {1000 * float(str(value)):.1f} ms" for what, value in found.items() if value)
        lines.append(f"its beams are not of one moment, as scans of the turning robot show: {told}")
    if odometry := sensor.get("odometry"):
        metre, radian = odometry["noise_per_sqrt_metre"], odometry["noise_per_sqrt_radian"]
        assert isinstance(metre, dict)
        assert isinstance(radian, dict)
        lines.append(
            f"odometry: off by {100 * metre['forward']:.1f} cm forwards, {100 * metre['sideways']:.1f} cm sideways and "
            f"{np.degrees(metre['turn']):.2f} degrees after a metre, {np.degrees(radian['turn']):.1f} degrees after a "
            "radian (standard deviations)"
        )
    gyro = sensor.get("gyro")
    if gyro and gyro["turns_along"]:  # of one that does not, a doubt says so
        noise, bias = (np.degrees(float(str(gyro[name]))) for name in
                       ("noise_rad_per_sqrt_second", "bias_rad_per_second"))  # fmt: skip
        aside = int(str(gyro["matches_without_it"]))
        lines.append(
            f"gyro: bias {bias:+.2g} degrees a second, off by {noise:.2g} degrees after a second (standard deviation)"
            + (f"; left aside at {aside} scans, where turns were better told without it" if aside else "")
        )
    return [*lines, *(str(doubt) for doubt in sensor.get("doubts", []))]


def _report(summary: dict[str, object], out: Path, log: Records, console: Console) -> None:
    """The outcome in a few lines."""
    console.print(
        f"{summary['scans']} scans, {summary['keyframes']} keyframes, {summary['closures_accepted']} loop closures "
        f"({summary['closures_rejected']} candidates were turned down)",
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
    console.print(f"look at {out / 'report.html'} (clew view {out}); the rest is beside it", highlight=False)
