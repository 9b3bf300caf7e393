"""`clew run` on laser logs, one configuration for all: accuracy, closures, time and memory as Markdown tables.

    python benchmarks/lidar.py                       # the real logs of ../shared/data/lidar
    python benchmarks/lidar.py intel --output out    # one of them; everything that the runs wrote is kept in out/
    python benchmarks/lidar.py --no-odometry         # from the scans alone
    python benchmarks/lidar.py --odometry-noise 2    # noise and slips that make the log's odometry twice as bad
    python benchmarks/lidar.py --simulated           # worlds with known truth
    python benchmarks/lidar.py --simulated office loop --seeds 1 2 3
    python benchmarks/lidar.py --simulated office --people 10 --doors

Real logs are measured by relations between reference poses that are close to each other
(`clew.evaluate.relations_from_reference`): successive ones, and revisits after 10 m of way or more. The reference is
another program's estimate, good to some two centimetres. The columns "own scans" need no reference (`clew evaluate
--self`): relative poses between visits against the alignment of the two scans, and the spread of returns about walls.
Wall time and memory are those of the whole process.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.spatial import cKDTree

from clew.cli.mapping_job import JobOptions, map_log
from clew.cli.self_evaluation import SelfEvaluation, evaluate_self, in_plane
from clew.evaluate import (
    PairErrors,
    RelationErrors,
    absolute_trajectory_error,
    poses_at,
    relation_errors,
    relations_from_reference,
)
from clew.geometry import se2
from clew.io import Log, open_log, read_tum
from clew.mapping import MovingOptions, moving_returns
from clew.motion import Odometry
from clew.scan import LaserScan
from clew.sim import KINDS, OdometryModel, SimulatedLog, Slips, disturbed, simulate_kind, write_carmen

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "lidar"
LOGS = ("intel", "fr079", "mit-csail")
#: A closure is right when its relative pose agrees with the truth within these.
RIGHT_DISTANCE, RIGHT_ANGLE = 0.3, np.radians(5.0)
MEGABYTE = 2**20 if sys.platform == "darwin" else 2**10  # in the units of ru_maxrss


@dataclass(frozen=True)
class Run:
    """What one run of the command left behind.

    Attributes:
        folder: with all outputs.
        summary: its summary.json.
        wall_seconds: of the whole process.
        peak_memory_mb: largest resident memory of the process.
    """

    folder: Path
    summary: dict[str, Any]
    wall_seconds: float
    peak_memory_mb: float

    @property
    def cells(self) -> list[str]:
        """Closures, wall time, times real time, memory."""
        summary = self.summary
        return [f"{summary['keyframes']}", f"{summary['closures_accepted']} / {summary['closures_rejected']}",
                f"{self.wall_seconds:.1f}", f"{summary['log_seconds'] / self.wall_seconds:.0f}",
                f"{self.peak_memory_mb:.0f}"]


RUN_COLUMNS = ["keyframes", "closures accepted / rejected", "wall s", "× real time", "peak MB"]


def run_clew(log: Path, folder: Path, *options: str) -> Run:
    """Run `clew run` on a log in a process of its own; ends the benchmark with its message where it fails."""
    folder.mkdir(parents=True, exist_ok=True)
    messages = folder / "messages.txt"
    command = [sys.executable, "-c", "from clew.cli import main; main()", "run", str(log), "-o", str(folder),
               *options]
    with messages.open("wb") as file:
        began = time.perf_counter()
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)  # the usage of this child alone
        wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"clew run {log} failed with {process.returncode}:\n{messages.read_text()[-2000:]}")
    return Run(folder, json.loads((folder / "summary.json").read_text()), wall, usage.ru_maxrss / MEGABYTE)


class Disturbed:
    """A recorded log whose odometry is so many times as bad as a run of it as it is has found it to be."""

    def __init__(self, log: Log, worse: float, found: dict[str, Any], seed: int = 1) -> None:
        metre, radian = found["noise_per_sqrt_metre"], found["noise_per_sqrt_radian"]
        more = (worse**2 - 1) ** 0.5  # variances add up
        self._noise = OdometryModel(sigma_distance=more * metre["forward"], sigma_side=more * metre["sideways"],
                                    sigma_turn=more * radian["turn"], sigma_drift=more * metre["turn"])
        self._log, self._seed = log, seed

    def __getattr__(self, name: str) -> Any:
        return getattr(self._log, name)

    def measurements(self) -> Iterator[LaserScan | Odometry]:
        return disturbed(self._log, self._noise, self._seed, Slips())


def run_disturbed(log: Path, folder: Path, worse: float) -> Run:
    """Run a log with worse odometry, in this process; time and memory are not those of the command."""
    plain = run_clew(log, folder / "plain")
    result = map_log(Disturbed(open_log(log), worse, plain.summary["sensor"]["odometry"]),
                     JobOptions(folder, log.name), Console(quiet=True))
    return Run(folder, result.summary, float(str(result.summary["wall_seconds"])), float("nan"))


def closure_precision(folder: Path, log: SimulatedLog) -> tuple[int, int]:
    """Right closures and all that were believed, those of keyframes that have been pruned since among them."""
    with (folder / "closures.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["verdict"] == "confirmed"]
    if not rows:
        return 0, 0

    def truth(end: str) -> Array:
        poses, known = poses_at(log.timestamps, log.T_world_robot, np.array([float(row[end]) for row in rows]), 1e-3)
        if not known.all():
            raise SystemExit(f"{folder}/closures.csv: {int((~known).sum())} keyframes at times without a scan")
        return poses

    measured = np.array([[float(row[name]) for name in ("x", "y", "theta")] for row in rows])
    error = se2.between(se2.between(truth("target_time"), truth("source_time")), measured)
    right = (np.hypot(error[:, 0], error[:, 1]) <= RIGHT_DISTANCE) & (np.abs(error[:, 2]) <= RIGHT_ANGLE)
    return int(right.sum()), len(rows)


def print_table(columns: list[str], rows: list[list[str]]) -> None:
    """Print a Markdown table."""
    print("| " + " | ".join(columns) + " |")
    print("| --- |" + " ---: |" * (len(columns) - 1))
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


def translation_cell(errors: RelationErrors) -> str:
    return f"{errors.translation.mean:.4f} ± {errors.translation.std:.4f}"


def rotation_cell(errors: RelationErrors | PairErrors) -> str:
    return f"{np.degrees(errors.rotation.mean):.3f} ± {np.degrees(errors.rotation.std):.3f}"


SELF_COLUMNS = ["pairs", "own scans: cm", "own scans: deg", "spread median: cm"]


def self_cells(of_itself: SelfEvaluation) -> list[str]:
    """Pairs used, mean errors against the alignment of their scans, spread of returns."""
    pairs = of_itself.pairs
    return [f"{pairs.used} of {pairs.used + pairs.unused}",
            f"{100 * pairs.translation.mean:.2f} ± {100 * pairs.translation.std:.2f}", rotation_cell(pairs),
            f"{100 * of_itself.spread.median:.2f}"]


def real_logs(names: list[str], data: Path, output: Path, worse: float, odometry: bool) -> None:
    """Print the table of the real logs."""
    rows = []
    for name in names:
        reference = data / f"{name}.reference.tum"
        log = data / f"{name}.clf.bz2"
        for path in (reference, log):
            if not path.is_file():
                raise SystemExit(f"{path} is missing: give the folder of the logs with --data")
        if worse > 1.0:
            run = run_disturbed(log, output / name, worse)
        else:
            run = run_clew(log, output / name, *([] if odometry else ["--no-odometry"]))
        trajectory = read_tum(run.folder / "trajectory.tum")
        relations = relations_from_reference(*read_tum(reference))
        kinds = {"all": relations, "near": relations.select(~relations.revisit),
                 "revisits": relations.select(relations.revisit)}
        of_itself = evaluate_self(trajectory[0], in_plane(trajectory[1]), open_log(log))
        errors = {kind: relation_errors(*trajectory, chosen) for kind, chosen in kinds.items()}
        unused = errors["all"].unused
        rows.append([name, f"{errors['near'].used} + {errors['revisits'].used}" + f" ({unused} unused)" * bool(unused),
                     *(cell(errors[kind]) for kind in kinds for cell in (translation_cell, rotation_cell)),
                     *self_cells(of_itself), *run.cells])
    print_table(["log", "relations near + revisits", "all: m", "all: deg", "near: m", "near: deg", "revisits: m",
                 "revisits: deg", *SELF_COLUMNS, *RUN_COLUMNS], rows)


def moving_found(folder: Path, log: SimulatedLog) -> tuple[float, float, float, float]:
    """Shares of the returns of people, of doors that are not open, of those of them whose place was ever seen through,
    and of what stays, that count as moving.

    At the poses of the run. A leaf that stands wide open, as doors mostly do here, is part of the building.
    """
    poses, known = poses_at(*read_tum(folder / "trajectory.tum"), log.timestamps, 1e-3)
    rows = np.flatnonzero(known)
    scans = [log.scan(int(i)) for i in rows]
    found = np.stack(moving_returns(scans, in_plane(poses[rows])))
    seen_through = np.stack(moving_returns(scans, in_plane(poses[rows]), options=MovingOptions(looks=1, seen=1.0)))
    door, moving, returned = log.door[rows], log.moving[rows], np.isfinite(log.ranges[rows])
    scan, beam = np.nonzero(door)
    T_world_sensor = se2.compose(log.T_world_robot[rows[scan]], np.array(log.laser.T_robot_sensor))
    heading = T_world_sensor[:, 2] + log.laser.angles[beam]
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    points = T_world_sensor[:, :2] + log.ranges[rows[scan], beam][:, None] * direction
    nearest = np.zeros(0, np.int64) if not len(scan) else cKDTree(log.world.doors[:, 0]).query(points)[1]
    not_open = log.door_share[rows[scan], nearest] < 0.9
    of_doors = found[scan[not_open], beam[not_open]]
    opened = seen_through[scan[not_open], beam[not_open]]
    kinds = (found[moving & ~door], of_doors, of_doors[opened], found[returned & ~moving])
    people, doors, doors_opened, still = (float(kind.mean()) if len(kind) else float("nan") for kind in kinds)
    return people, doors, doors_opened, still


MOVING_COLUMNS = ["people found: %", "doors found: %", "of those ever seen open: %", "still removed: %"]


def moving_cells(folder: Path, log: SimulatedLog) -> list[str]:
    """Shares of `moving_found` in percent, a dash where there is none of a kind."""
    return ["-" if np.isnan(share) else f"{100 * share:.2f}" for share in moving_found(folder, log)]


def simulated_logs(
    kinds: list[str], seeds: list[int], duration: float, people: int, doors: bool, output: Path
) -> None:
    """Print the table of simulated worlds."""
    rows = []
    for kind in kinds:
        for seed in seeds:
            folder = output / f"{kind}-{seed}"
            folder.mkdir(parents=True, exist_ok=True)
            log = simulate_kind(kind, seed, duration=duration, people=people, doors=doors)
            write_carmen(log, folder / "simulated.log")
            run = run_clew(folder / "simulated.log", folder)
            truth = (log.timestamps, log.T_world_robot)
            error = absolute_trajectory_error(*truth, *read_tum(folder / "trajectory.tum"))
            reckoned = absolute_trajectory_error(*truth, log.timestamps, log.T_odom_robot)
            right, closures = closure_precision(folder, log)
            rows.append([f"{kind} {seed}", f"{error.used}" + f" ({error.unused} unused)" * bool(error.unused),
                         f"{reckoned.translation.rmse:.2f}", f"{error.translation.rmse:.4f}",
                         f"{error.translation.max:.3f}", f"{np.degrees(error.rotation.rmse):.3f}",
                         f"{right} / {closures}", *moving_cells(folder, log), *run.cells])
    print_table(["world", "poses", "odometry: ATE m", "ATE m", "ATE max m", "ATE deg", "right closures",
                 *MOVING_COLUMNS, *RUN_COLUMNS], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help=f"real logs ({', '.join(LOGS)}), all by default; "
                        f"with --simulated kinds of worlds ({', '.join(KINDS)})")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the real logs and their references")
    parser.add_argument("--output", type=Path, help="keep what the runs write in this folder")
    parser.add_argument("--simulated", action="store_true", help="simulated worlds instead of real logs")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2], help="of the simulated worlds")
    parser.add_argument("--duration", type=float, default=400.0, help="of the simulated drives, seconds")
    parser.add_argument("--people", type=int, default=0, help="who walk through the simulated worlds")
    parser.add_argument("--doors", action="store_true", help="doors of the simulated offices open and close")
    parser.add_argument("--odometry-noise", type=float, default=1.0, metavar="TIMES",
                        help="make the odometry of the real logs so many times as bad")
    parser.add_argument("--no-odometry", dest="odometry", action="store_false", help="real logs from scans alone")
    options = parser.parse_args()
    available = KINDS if options.simulated else LOGS
    names = options.names or list(available)
    if unknown := sorted(set(names) - set(available)):
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(available)}")
    with tempfile.TemporaryDirectory() as temporary:
        output = options.output or Path(temporary)
        if options.simulated:
            simulated_logs(names, options.seeds, options.duration, options.people, options.doors, output)
        else:
            real_logs(names, options.data, output, options.odometry_noise, options.odometry)


if __name__ == "__main__":
    main()
