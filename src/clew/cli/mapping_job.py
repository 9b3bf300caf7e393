"""The job of `clew run` and `clew demo`: measurements in, files out."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from clew.cli.interrupt import Interrupt
from clew.cli.live import JobViewer, NoViewer
from clew.cli.outputs import write_outputs
from clew.cli.process import peak_memory_mb
from clew.cli.progress import job_progress
from clew.errors import InputError
from clew.io import LogHealth, Records
from clew.motion import Odometry, TurnRates
from clew.slam import Slam, SlamConfig, Trajectory
from clew.view import report_of_run, write_report

_log = logging.getLogger(__name__)

Array = NDArray[np.float64]

IN_PLANE_95, ON_LINE_95 = 2.4477, 1.9600  # deviations about the mean that hold 95 %, in two coordinates and in one


@dataclass(frozen=True)
class JobOptions:
    """Attributes: what `clew run` was asked for; see its help."""

    out: Path
    title: str
    refine: bool = True
    odometry: bool = True
    imu: bool = True
    resolution: float = 0.05


@dataclass(frozen=True)
class JobResult:
    """The estimate, what `summary.json` says of it, and whether Ctrl-C cut it short."""

    slam: Slam
    summary: dict[str, object]
    interrupted: bool


def map_log(
    log: Records, options: JobOptions, console: Console, begun: float | None = None,
    health: Callable[[], LogHealth] | None = None, truth: Callable[[Array], Trajectory] | None = None,
    viewer: JobViewer | None = None,
) -> JobResult:  # fmt: skip
    """Estimate, refine, map and write everything into the output folder, which exists.

    Args:
        log: what the robot recorded.
        options: see `JobOptions`.
        console: where progress goes.
        begun: `time.perf_counter` when the job began, for its duration; now unless given.
        health: tells the state of the log, when the estimate is done.
        truth: gives the true poses at timestamps, in the frame of the first, where they are known.
        viewer: shows the job while it works.

    Raises:
        InputError: the log holds no usable scan, or a file cannot be written.
    """
    begun = time.perf_counter() if begun is None else begun
    viewer = NoViewer() if viewer is None else viewer
    slam = Slam(SlamConfig(map_resolution=options.resolution), use_odometry=options.odometry, viewer=viewer)
    left_out: Counter[str] = Counter()
    with Interrupt() as interrupt, job_progress(console, log.scan_count) as progress:
        for measurement in log.measurements():
            if interrupt.requested:
                break
            if isinstance(measurement, Odometry):
                slam.add_odometry(measurement)
            elif isinstance(measurement, TurnRates):
                if options.imu:
                    slam.add_turn_rates(measurement)
            elif not slam.has_odometry:
                left_out["scan before any odometry"] += 1
            elif slam.scan_count and measurement.timestamp <= slam.time_span[1]:
                left_out["second scan of one moment"] += 1
            else:
                slam.add_scan(measurement)
                progress.scan(slam)
        stopped = interrupt.requested
        if stopped and not slam.scan_count:
            raise KeyboardInterrupt
        if not slam.scan_count:
            raise InputError(
                f"no odometry before any of the {log.scan_count} scans: give a log with odometry, "
                "or estimate the motion from the scans alone with --no-odometry"
            )
        _log.info("mapped %d scans, %d keyframes, %d closures in %.2f s", slam.scan_count, len(slam.keyframes),
                  len(slam.closures), time.perf_counter() - begun)
        if options.refine and not stopped:
            viewer.stage("refining")
            slam.refine(progress.refining, lambda: interrupt.requested, progress.closing)
        else:
            slam.optimise(progress.closing, lambda: interrupt.requested)
        interrupted = interrupt.requested
        progress.mapped(0, slam.scan_count)
        viewer.stage("writing")
        estimated = time.perf_counter() - begun
        _log.info("the estimate stands after %.2f s; writing to %s", estimated, options.out)
        grid = write_outputs(slam, options.out, options.title, progress.mapped)
        skipped = dict(sorted((log.report.skipped + left_out).items()))
        write_report(options.out / "report.html", report_of_run(
            slam, grid, options.title, health=None if health is None else health(), skipped=skipped,
            complete=not stopped, refined=stopped or not interrupted,
            truth=None if truth is None else truth(slam.trajectory.timestamps)))
    if interrupted:
        viewer.finish("interrupted")
    wall = time.perf_counter() - begun
    stamps = slam.trajectory.timestamps
    log_seconds = float(stamps[-1] - stamps[0])
    summary: dict[str, object] = {
        "scans": slam.scan_count,
        "keyframes": len(slam.keyframes),
        "pruned": {
            "keyframes": slam.pruned.keyframes,
            "information_loss_nats": round(slam.pruned.information_loss_nats, 3),
        },
        "closures_accepted": slam.closure_count,
        "closures_rejected": slam.turned_down_count,
        "closures_redundant": slam.redundant_count,
        "log_seconds": round(log_seconds, 3),
        "wall_seconds": round(wall, 3),
        "estimate_seconds": round(estimated, 3),
        "realtime_factor": round(log_seconds / wall, 2) if wall > 0 else 0.0,
        "chi2": slam.chi2,
        "uncertainty_95": _uncertainty(slam),
        "refined": options.refine and not interrupted,
        "complete": not stopped,
        "map_size_m": [round(side * grid.resolution, 2) for side in grid.shape[::-1]],
        "sensor": slam.sensor,
        "skipped": skipped,
    }
    return JobResult(slam, {**summary, "peak_memory_mb": _rounded(peak_memory_mb())}, interrupted)


def _uncertainty(slam: Slam) -> dict[str, float]:
    """How far keyframes may be off at 95 %, seen from the first: half of the longest axis, metres, and degrees."""
    covariances = slam.covariances()
    position = IN_PLANE_95 * np.sqrt(np.maximum(np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1], 0.0))
    heading = ON_LINE_95 * np.degrees(np.sqrt(covariances[:, 2, 2]))
    return {
        "position_median_m": round(float(np.median(position)), 4),
        "position_largest_m": round(float(position.max()), 4),
        "heading_median_deg": round(float(np.median(heading)), 4),
        "heading_largest_deg": round(float(heading.max()), 4),
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 1)
