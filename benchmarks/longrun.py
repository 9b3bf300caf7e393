"""A simulated day in one building: cost per scan, keyframes, edges, memory and accuracy, hour by hour.

    python benchmarks/longrun.py                    # eight hours in an office of 70 m, about 29 km
    python benchmarks/longrun.py --hours 2 --every 0.5
    python benchmarks/longrun.py --no-pruning       # for comparison: every keyframe is kept

A robot drives along corridors and into rooms, again and again, in either direction. The drive is simulated in another
process and read back hour by hour, so that memory is that of mapping alone. "ms / scan" is CPU time of the process,
without reading; "ATE" is over all scans so far, after alignment, at the poses of the moment (before the refinement).
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does; before NumPy is loaded

import numpy as np

from clew.cli.process import peak_memory_mb
from clew.evaluate import absolute_trajectory_error
from clew.motion import Odometry
from clew.scan import LaserScan
from clew.sim import LaserModel, OdometryModel, drive, office_building, simulate, tour
from clew.sim.drive import Drive
from clew.slam import Slam, SlamConfig

COLUMNS = ["hour", "scans", "ms / scan", "keyframes taken", "kept", "edges", "closures", "RSS MB", "peak MB", "ATE m",
           "ATE max m", "information lost: nats"]


def record(folder: Path, hours: float, every: float, rate: float, seed: int, people: int, doors: bool) -> None:
    """Simulate the day and write it in pieces of `every` hours."""
    world = office_building(seed)
    laser = LaserModel(beams=181)
    seconds = 3600.0 * hours
    whole = drive(tour(world, seed, 1.3 * seconds), rate=rate, duration=seconds)
    step = round(3600.0 * every * rate)
    T_odom_robot = OdometryModel.medium().reckon(whole.T_world_robot, np.random.default_rng(seed))
    for piece, begin in enumerate(range(0, len(whole.timestamps), step)):
        part = slice(begin, begin + step)
        driven = Drive(whole.timestamps[part], whole.T_world_robot[part])
        log = simulate(world, driven, laser, OdometryModel.medium(), 1000 * seed + piece, people=people, doors=doors)
        np.savez(folder / f"{piece:04d}.npz", timestamps=log.timestamps, ranges=log.ranges.astype(np.float32),
                 truth=log.T_world_robot, odometry=T_odom_robot[part], angles=[laser.angle_min, laser.angle_increment],
                 limits=[laser.range_min, laser.range_max], sensor=laser.T_robot_sensor)


def resident_mb() -> float:
    """Memory of this process now."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return float("nan")


def row(slam: Slam, hour: float, milliseconds: float, times: np.ndarray, truth: np.ndarray) -> list[str]:
    """One line of the table."""
    memory = resident_mb()  # before the trajectory is asked for
    trajectory = slam.trajectory
    error = absolute_trajectory_error(times, truth, trajectory.timestamps, trajectory.T_world_robot)
    pruned = slam.pruned
    return [f"{hour:g}", f"{slam.scan_count}", f"{milliseconds:.2f}", f"{len(slam.keyframes) + pruned.keyframes}",
            f"{len(slam.keyframes)}", f"{slam.graph.factor_count}", f"{slam.closure_count}", f"{memory:.0f}",
            f"{peak_memory_mb() or float('nan'):.0f}", f"{error.translation.rmse:.4f}", f"{error.translation.max:.3f}",
            f"{pruned.information_loss_nats:.0f}"]


def map_day(folder: Path, every: float, config: SlamConfig, refine: bool) -> None:
    """Feed all pieces to one `Slam` and print a line after each."""
    print("| " + " | ".join(COLUMNS) + " |")
    print("| " + " | ".join(["---:"] * len(COLUMNS)) + " |", flush=True)
    slam = Slam(config)
    times, truths = [], []
    files = sorted(folder.glob("*.npz"))
    for piece, path in enumerate(files):
        with np.load(path) as data:
            timestamps, ranges, odometry = data["timestamps"], data["ranges"], data["odometry"]
            angles, limits, sensor = data["angles"].tolist(), data["limits"].tolist(), data["sensor"]
            times.append(timestamps)
            truths.append(data["truth"])
        began = time.process_time()
        for k, timestamp in enumerate(timestamps.tolist()):
            slam.add_odometry(Odometry(timestamp, odometry[k]))
            slam.add_scan(LaserScan(timestamp, ranges[k].astype(np.float64), *angles, *limits, sensor))
        milliseconds = 1e3 * (time.process_time() - began) / len(timestamps)
        del ranges
        cells = row(slam, min((piece + 1) * every, (timestamps[-1] - times[0][0]) / 3600.0), milliseconds,
                    np.concatenate(times), np.concatenate(truths))
        print("| " + " | ".join(cells) + " |", flush=True)
    if refine:
        began = time.process_time()
        slam.refine()
        refined = time.process_time() - began
        cells = row(slam, float("nan"), float("nan"), np.concatenate(times), np.concatenate(truths))
        began = time.process_time()
        grid = slam.map()
        drawn = time.process_time() - began
        print("| " + " | ".join(["refined", *cells[1:]]) + " |")
        print(f"\nrefinement {refined:.1f} s, map of {grid.shape[1]} x {grid.shape[0]} cells {drawn:.1f} s, "
              f"peak {peak_memory_mb() or float('nan'):.0f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=8.0, help="of the drive")
    parser.add_argument("--every", type=float, default=1.0, help="hours a line of the table")
    parser.add_argument("--rate", type=float, default=4.0, help="scans a second")
    parser.add_argument("--seed", type=int, default=1, help="of building, way and noise")
    parser.add_argument("--people", type=int, default=0, help="who walk through the building")
    parser.add_argument("--doors", action="store_true", help="doors open and close")
    parser.add_argument("--no-pruning", action="store_true", help="keep every keyframe")
    parser.add_argument("--no-refine", action="store_true", help="leave out the refinement at the end")
    options = parser.parse_args()
    config = SlamConfig()
    if options.no_pruning:
        config = replace(config, pruning=replace(config.pruning, enabled=False))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        process = multiprocessing.get_context("spawn").Process(target=record, args=(
            folder, options.hours, options.every, options.rate, options.seed, options.people, options.doors))
        process.start()
        process.join()
        if process.exitcode != 0:
            raise SystemExit("the simulation failed")
        map_day(folder, options.every, config, not options.no_refine)


if __name__ == "__main__":
    main()
