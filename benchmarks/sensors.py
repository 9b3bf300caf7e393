"""One configuration for many sensors: errors against simulated truth, honesty of covariances, sweeps, broken odometry.

    python benchmarks/sensors.py                      # lasers x worlds
    python benchmarks/sensors.py --worlds hall --seeds 1 2 3
    python benchmarks/sensors.py --sweep              # a slow spinning laser, with and without its sweep time told
    python benchmarks/sensors.py --odometry           # as it comes, five times as bad, frozen, noise, none
    python benchmarks/sensors.py --imu                # odometry of several kinds, with and without gyros of several

Everything runs in this process, refinement included where an ATE is given. Normalised errors are those of the steps
between keyframes that the front end hands to the graph: the squared Mahalanobis distance to the truth over its three
degrees of freedom is one where the covariance is right, less where it is cautious; and so many lie within their 95 %
ellipse. "Weak" is the error along the direction of translation that is known worst, as along a corridor.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from clew.evaluate import absolute_trajectory_error
from clew.geometry import se2
from clew.motion import Odometry, TurnRates
from clew.scan import LaserScan
from clew.sim import (
    Drive,
    GyroModel,
    LaserModel,
    OdometryModel,
    SimulatedLog,
    Slips,
    World,
    disturbed,
    drive,
    hall,
    long_corridor,
    office_building,
    simulate,
    tour,
)
from clew.slam import Slam
from lidar import print_table

Array = NDArray[np.float64]
Stream = Iterable[LaserScan | Odometry | TurnRates]

INSIDE = 7.815  # 95 % of chi-squared with three degrees of freedom
WORLDS: dict[str, Callable[[int], World]] = {
    "office": office_building,
    "corridor": long_corridor,
    "bare corridor": lambda seed: long_corridor(seed, length=100.0, features=3),
    "hall": hall,
    "sparse": lambda seed: hall(seed, width=80.0, depth=60.0, pillars=25),
}


@dataclass(frozen=True)
class Sensor:
    """A laser and how often it scans, Hz."""

    laser: LaserModel
    rate: float


def _laser(beams: int, degrees: float, sigma: float, reach: float, rate: float, **more: float) -> Sensor:
    return Sensor(LaserModel(beams, np.radians(degrees), sigma_range=sigma, range_max=reach, **more), rate)


SENSORS = {
    "181 beams, 180°, 1 cm, 80 m, 5 Hz": _laser(181, 180, 0.01, 80, 5, resolution=0.01),
    "361 beams, 180°, 5 mm, 80 m, 5 Hz": _laser(361, 180, 0.005, 80, 5, resolution=0.001),
    "1081 beams, 270°, 1 cm, 30 m, 40 Hz": _laser(1081, 270, 0.01, 30, 40, resolution=0.001),
    "682 beams, 240°, 1 cm, 5.6 m, 10 Hz": _laser(682, 240, 0.01, 5.6, 10, range_min=0.02, resolution=0.001),
    "1800 beams, 360°, 1 cm, 40 m, 10 Hz": _laser(1800, 359.8, 0.01, 40, 10, resolution=0.001),
    "360 beams, 360°, 3 cm, 8 m, 7 Hz": _laser(360, 359, 0.03, 8, 7, resolution=0.001, dropout=0.03),
    "360 beams, 360°, 2 cm, 12 m, 2 Hz": _laser(360, 359, 0.02, 12, 2, resolution=0.001, dropout=0.03),
}

SPINNING = _laser(450, 359.2, 0.01, 12, 10, range_min=0.02, resolution=0.001)


@dataclass(frozen=True)
class Outcome:
    """Attributes: the run, its errors, and its time against that of the log."""

    slam: Slam
    ate: float
    largest: float
    degrees: float
    times_real: float


def estimate(log: SimulatedLog, stream: Stream, odometry: bool = True) -> Outcome:
    """Run the pipeline on a stream of a log's measurements."""
    slam = Slam(use_odometry=odometry)
    began = time.process_time()
    for measurement in stream:
        if odometry or not isinstance(measurement, Odometry):
            slam.add(measurement)
    slam.refine()
    seconds = time.process_time() - began
    run = slam.trajectory
    error = absolute_trajectory_error(log.timestamps, log.T_world_robot, run.timestamps, run.T_world_robot)
    return Outcome(slam, error.translation.rmse, error.translation.max, float(np.degrees(error.rotation.rmse)),
                   log.duration / seconds)


def normalised_errors(log: SimulatedLog, slam: Slam) -> tuple[float, float, float]:
    """Of the steps between keyframes: mean over three, share inside the 95 % ellipse, mean in the weakest direction."""
    edges = next(block for block in slam.graph.blocks() if block.role.name == "ODOMETRY")
    stamps = slam.keyframes.timestamps
    truth = log.T_world_robot[np.searchsorted(log.timestamps, stamps)]
    first, second = edges.keys.T
    error = se2.between(se2.between(truth[first], truth[second]), np.asarray(edges.measurement).reshape(-1, 3))
    squared = np.einsum("mi,mij,mj->m", error, edges.information, error)
    values, vectors = np.linalg.eigh(np.linalg.inv(edges.information)[:, :2, :2])
    weak = np.einsum("mi,mi->m", error[:, :2], vectors[:, :, 1]) ** 2 / values[:, 1]
    return float(squared.mean() / 3), float(np.mean(squared <= INSIDE)), float(weak.mean())


def record(world: World, sensor: Sensor, odometry: OdometryModel, seed: int, duration: float,
           gyro: GyroModel | None = None) -> SimulatedLog:
    """A drive through a world."""
    driven: Drive = drive(tour(world, seed, 1.2 * duration), rate=sensor.rate, duration=duration)
    return simulate(world, driven, sensor.laser, odometry, seed, gyro=gyro)


def sensors(worlds: list[str], seeds: list[int], duration: float) -> None:
    """All lasers in all worlds."""
    rows = []
    for name, sensor in SENSORS.items():
        for kind in worlds:
            for seed in seeds:
                log = record(WORLDS[kind](seed), sensor, OdometryModel.medium(), seed, duration)
                run = estimate(log, log.measurements())
                mean, inside, weak = normalised_errors(log, run.slam)
                noise = float(str(run.slam.sensor["laser"]["range_noise_m"]))  # type: ignore[index]
                rows.append([f"{name}; {kind} {seed}", f"{run.ate:.4f}", f"{run.largest:.3f}", f"{run.degrees:.3f}",
                             f"{100 * noise:.2f}", f"{mean:.2f}", f"{100 * inside:.0f}", f"{weak:.2f}",
                             f"{run.times_real:.0f}"])
    print_table(["laser; world", "ATE m", "max m", "deg", "range noise found: cm", "normalised errors", "inside: %",
                 "weak", "× real time (CPU)"], rows)


def sweeps(worlds: list[str], seeds: list[int], duration: float) -> None:
    """A laser that takes the whole time between two scans for its turn."""
    rows = []
    for kind in worlds:
        for seed in seeds:
            for told, odometry in product(("none", "not told", "told", "told, with a gyro"), (True, False)):
                laser = replace(SPINNING.laser, sweep=0.0 if told == "none" else 0.1)
                gyro = GyroModel() if told.endswith("gyro") else None
                log = record(WORLDS[kind](seed), Sensor(laser, SPINNING.rate), OdometryModel.medium(), seed, duration,
                             gyro)  # fmt: skip
                stream = untold(log.measurements()) if told == "not told" else log.measurements()
                run = estimate(log, stream, odometry)
                found = run.slam.sensor["laser"]["sweep_seconds"]  # type: ignore[index]
                rows.append([f"{kind} {seed}", "yes" if odometry else "no", told, f"{1000 * found:.1f}",
                             f"{run.ate:.4f}", f"{run.largest:.3f}", f"{run.degrees:.3f}",
                             *(at_middle(log, run.slam) if told == "not told" else ("-", "-"))])
    print_table(["world", "odometry", "sweep of 0.1 s", "found or told: ms", "ATE m", "max m", "deg",
                 "about the middle: ATE m", "deg"], rows)


def at_middle(log: SimulatedLog, slam: Slam) -> tuple[str, str]:
    """ATE and heading error against the truth half a period after each timestamp, in the middle of the scan."""
    poses = log.T_world_robot
    middle = se2.compose(poses[:-1], se2.exp(0.5 * se2.log(se2.between(poses[:-1], poses[1:]))))
    run = slam.trajectory
    error = absolute_trajectory_error(log.timestamps[:-1], middle, run.timestamps, run.T_world_robot)
    return f"{error.translation.rmse:.4f}", f"{np.degrees(error.rotation.rmse):.3f}"


def untold(stream: Stream) -> Iterator[LaserScan | Odometry | TurnRates]:
    """Scans without the time between their beams."""
    for m in stream:
        yield replace(m, time_increment=0.0, moments=None) if isinstance(m, LaserScan) else m


def frozen(stream: Stream) -> Iterator[LaserScan | Odometry | TurnRates]:
    """Odometry that stands still."""
    for m in stream:
        yield Odometry(m.timestamp, np.zeros(3)) if isinstance(m, Odometry) else m


def noise(stream: Stream) -> Iterator[LaserScan | Odometry | TurnRates]:
    """Odometry that is noise of a metre and a radian."""
    rng = np.random.default_rng(1)
    for m in stream:
        yield Odometry(m.timestamp, rng.standard_normal(3)) if isinstance(m, Odometry) else m


def odometries(worlds: list[str], seeds: list[int], duration: float) -> None:
    """Odometry of all kinds, one laser."""
    sensor = SENSORS["361 beams, 180°, 5 mm, 80 m, 5 Hz"]
    medium = OdometryModel.medium()
    more = OdometryModel(sigma_distance=5 * medium.sigma_distance, sigma_side=5 * medium.sigma_side,
                         sigma_turn=5 * medium.sigma_turn, sigma_drift=5 * medium.sigma_drift)
    rows = []
    for kind in worlds:
        for seed in seeds:
            log = record(WORLDS[kind](seed), sensor, medium, seed, duration)
            conditions: dict[str, tuple[Stream, bool]] = {
                "as it comes": (log.measurements(), True),
                "five times as bad, with slips": (disturbed(log, more, seed, Slips()), True),
                "frozen": (frozen(log.measurements()), True),
                "noise": (noise(log.measurements()), True),
                "none": (log.measurements(), False),
            }
            for name, (stream, used) in conditions.items():
                run = estimate(log, stream, used)
                found = run.slam.sensor.get("odometry")
                forward, unused = "-", "-"
                if isinstance(found, dict):
                    forward = f"{100 * found['noise_per_sqrt_metre']['forward']:.1f}"
                    unused = str(found["matches_without_it"])
                rows.append([f"{kind} {seed}", name, f"{run.ate:.4f}", f"{run.largest:.3f}", f"{run.degrees:.3f}",
                             forward, unused, f"{run.slam.scan_count}"])
    print_table(["world", "odometry", "ATE m", "max m", "deg", "noise found: cm after a metre", "matches without it",
                 "scans"], rows)


def with_rates(
    stream: Stream, change: Callable[[Array, Array], Array] | None
) -> Iterator[LaserScan | Odometry | TurnRates]:
    """The turn rates changed, given their times; or none at all."""
    for m in stream:
        if not isinstance(m, TurnRates):
            yield m
        elif change is not None:
            yield TurnRates(m.timestamps, change(m.timestamps, m.rates))


GYROS: dict[str, tuple[GyroModel, Callable[[Array, Array], Array] | None]] = {
    "none": (GyroModel(), None),
    "good": (GyroModel(density=0.0005, bias=0.005), lambda _, rates: rates),
    "cheap, 20 ms late": (GyroModel(density=0.005, bias=0.04, bias_walk=2e-4, scale=0.02, delay=0.02),
                          lambda _, rates: rates),
    "stuck": (GyroModel(), lambda _, rates: np.zeros_like(rates)),
    "upside down": (GyroModel(), lambda _, rates: -rates),
    "dies after 50 s": (GyroModel(), lambda times, rates: np.where(times < 50.0, rates, 0.02)),
}


def imus(worlds: list[str], seeds: list[int], duration: float) -> None:
    """Gyros of all kinds with odometry of some."""
    sensor = SENSORS["361 beams, 180°, 5 mm, 80 m, 5 Hz"]
    medium, bad = OdometryModel.medium(), OdometryModel.bad()
    rows = []
    for kind in worlds:
        for odometry in ("as it comes", "worn, slips in turns", "none"):
            for name, (gyro, change) in GYROS.items():
                runs, errors = [], []
                for seed in seeds:
                    log = record(WORLDS[kind](seed), sensor, medium, seed, duration, gyro)
                    stream: Stream = log.measurements()
                    if odometry.startswith("worn"):
                        stream = disturbed(log, bad, seed, Slips(per_metre=0.1, turn=0.3))
                    run = estimate(log, with_rates(stream, change), odometry != "none")
                    runs.append(run)
                    found = run.slam.sensor.get("gyro")
                    if isinstance(found, dict) and change is not None:
                        errors.append(abs(found["bias_rad_per_second"] - gyro.bias))
                aside = sum(run.slam.sensor["gyro"]["matches_without_it"]  # type: ignore[index]
                            for run in runs if "gyro" in run.slam.sensor)
                broken = name in ("stuck", "upside down", "dies after 50 s", "none")
                rows.append([kind, odometry, name, f"{np.mean([run.ate for run in runs]):.4f}",
                             f"{max(run.largest for run in runs):.3f}",
                             f"{np.mean([run.degrees for run in runs]):.3f}",
                             "-" if broken else f"{np.degrees(np.mean(errors)):.3f}", str(aside)])
    print_table(["world", "odometry", "gyro", "ATE m (mean)", "max m", "deg", "bias off by: deg/s",
                 "left aside: scans"], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", nargs="+", choices=list(WORLDS), default=list(WORLDS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--duration", type=float, default=150.0, help="of the drives, seconds")
    table = parser.add_mutually_exclusive_group()
    table.add_argument("--sweep", action="store_true", help="a slow spinning laser")
    table.add_argument("--odometry", action="store_true", help="odometry of all kinds")
    table.add_argument("--imu", action="store_true", help="gyros of all kinds")
    options = parser.parse_args()
    show = sweeps if options.sweep else odometries if options.odometry else imus if options.imu else sensors
    show(options.worlds, options.seeds, options.duration)


if __name__ == "__main__":
    main()
