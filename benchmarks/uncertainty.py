"""Is the stated uncertainty the true one? Normalised errors against simulated truth, from matches to final poses.

    python benchmarks/uncertainty.py                       # ordinary worlds, three lasers
    python benchmarks/uncertainty.py --worlds office bare --seeds 101 102 103
    python benchmarks/uncertainty.py --lasers fine --runs  # one line a run

The normalised error of a pose is the squared Mahalanobis distance to the truth over its three degrees of freedom: one
in the mean where the covariance is right, less where it is cautious, more where it is too sure. "Inside" is the share
within the 95 % ellipsoid. "Band" is the 95 % interval that the mean falls into with right covariances, for as many
independent errors as these scatter like (`clew.evaluate.effective_count`; errors along a trajectory are alike for a
while). "±" is the standard error of the mean over runs.

matches    poses of scans seen from their keyframe, as the front end tracks them
steps      between successive keyframes, as the front end hands them to the graph
first      final poses of keyframes, seen from the first keyframe
near       final poses seen from a keyframe some 4 m of way before
revisit    final poses seen from the nearest keyframe of an earlier visit
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import chi2

from clew.evaluate import effective_count
from clew.geometry import se2
from clew.sim import (
    LaserModel,
    OdometryModel,
    SimulatedLog,
    World,
    drive,
    hall,
    identical_doors,
    long_corridor,
    loop,
    office_building,
    simulate,
    tour,
)
from clew.slam import Slam, SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.sensor import SensorModel
from clew.slam.tracking import Tracker
from lidar import print_table

Array = NDArray[np.float64]
Index = NDArray[np.int64]

INSIDE = float(chi2.ppf(0.95, 3))
NEAR = 10  # keyframes
AGAIN = 12.0  # metres of way after which a place is seen again
AT = 1.5  # metres
MOST = 150  # keyframes whose poses are compared, evenly spaced: neighbours tell the same

WORLDS: dict[str, Callable[[int], World]] = {
    "office": office_building,
    "alike": lambda seed: office_building(seed, alike=True),
    "hall": hall,
    "corridor": long_corridor,
    "bare": lambda seed: long_corridor(seed, length=100.0, features=3),
    "sparse": lambda seed: hall(seed, width=80.0, depth=60.0, pillars=25),
    "loop": loop,
    "doors": identical_doors,
}
ORDINARY = ("office", "alike", "hall", "corridor", "sparse", "bare")
LASERS: dict[str, tuple[LaserModel, float]] = {
    "default": (LaserModel(), 5.0),
    "coarse": (LaserModel(181, np.radians(180), sigma_range=0.01, range_max=80.0, resolution=0.01), 5.0),
    "fine": (LaserModel(1081, np.radians(270), sigma_range=0.005, range_max=30.0, resolution=0.001), 10.0),
    "noisy": (LaserModel(360, np.radians(359), sigma_range=0.03, range_max=8.0, resolution=0.001, dropout=0.03), 7.0),
}


@dataclass(frozen=True)
class Errors:
    """Attributes: squared Mahalanobis distances ``(n,)``, errors of the position ``(n,)`` and what was stated."""

    squared: Array
    distance: Array
    stated: Array

    @property
    def mean(self) -> float:
        return float(self.squared.mean() / 3) if len(self.squared) else float("nan")

    @property
    def inside(self) -> float:
        return float(np.mean(self.squared <= INSIDE)) if len(self.squared) else float("nan")


def errors_of(T_true: Array, T_found: Array, covariance: Array) -> Errors:
    """Of poses ``(n, 3)`` with covariances ``(n, 3, 3)`` in the tangents at `T_found`."""
    error = se2.between(T_found, T_true)
    squared = np.einsum("mi,mij,mj->m", error, np.linalg.inv(covariance + 1e-10 * np.eye(3)), error)
    stated = np.sqrt(np.trace(covariance[:, :2, :2], axis1=1, axis2=2))
    return Errors(squared, np.hypot(error[:, 0], error[:, 1]), stated)


def front_end(log: SimulatedLog) -> tuple[Errors, Errors]:
    """Single matches, and steps between keyframes."""
    config = SlamConfig()
    keyframes, sensor = KeyframeStore(), SensorModel(config)
    tracker = Tracker(keyframes, config, sensor)
    poses, covariances, begins = [], [], []
    at = 0  # the scan of the last keyframe
    steps = []
    for i in range(log.scan_count):
        sensor.see(log.scan(i))
        tracked = tracker.track(log.scan(i), log.T_odom_robot[i])
        if tracked.is_keyframe and i:
            keyframe = keyframes[tracked.keyframe]
            steps.append((at, i, keyframe.T_previous_this, np.linalg.inv(keyframe.information)))
        elif i:
            poses.append(tracked.T_keyframe_robot)
            covariances.append(tracked.covariance)
            begins.append((at, i))
        if tracked.is_keyframe:
            at = i
    ends = np.array(begins)
    moved = np.abs(np.array(poses)).max(axis=1) > 0
    truth = log.T_world_robot
    matches = errors_of(se2.between(truth[ends[:, 0]], truth[ends[:, 1]])[moved], np.array(poses)[moved],
                        np.array(covariances)[moved])
    first, second, measured, spread = (np.array(column) for column in zip(*steps, strict=True))
    return matches, errors_of(se2.between(truth[first], truth[second]), measured, spread)


def relative_errors(poses: Array, truth: Array, joint: Array, pairs: Index) -> Errors:
    """Of poses ``(n, 3)`` seen from each other, `pairs` ``(p, 2)``, by their joint covariance ``(3 n, 3 n)``."""
    n = len(poses)
    blocks = joint.reshape(n, 3, n, 3).transpose(0, 2, 1, 3)
    a, b = pairs.T
    by_a, by_b = se2.local_jacobians(poses[a], poses[b])
    cross = by_a @ blocks[a, b] @ by_b.transpose(0, 2, 1)
    relative = (by_a @ blocks[a, a] @ by_a.transpose(0, 2, 1) + by_b @ blocks[b, b] @ by_b.transpose(0, 2, 1)
                + cross + cross.transpose(0, 2, 1))
    turn = by_b.transpose(0, 2, 1)  # from the axes of the first to those of the second
    return errors_of(se2.between(truth[a], truth[b]), se2.between(poses[a], poses[b]),
                     turn @ relative @ turn.transpose(0, 2, 1))


def final_errors(log: SimulatedLog, slam: Slam) -> list[Errors]:
    """Poses of keyframes seen from the first, from the way just before, from an earlier visit."""
    keyframes, numbers = slam.keyframes, slam.keyframe_numbers
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(log.T_world_robot[:, :2], axis=0).T))])
    scans = np.searchsorted(log.timestamps, keyframes.timestamps)
    chosen = np.unique(np.linspace(0, len(numbers) - 1, min(MOST, len(numbers))).round().astype(np.int64))
    chosen = np.union1d(chosen, np.maximum(chosen - NEAR, 0))
    poses, truth, path = keyframes.T_world_robot[chosen], log.T_world_robot[scans][chosen], way[scans][chosen]
    joint = slam.solution().joint_covariance(numbers[chosen])
    count = len(chosen)
    later = np.arange(1, count)
    first = np.stack([np.zeros_like(later), later], axis=1)
    place = np.searchsorted(chosen, chosen - NEAR)
    ok = (chosen >= NEAR) & (chosen[np.minimum(place, count - 1)] == chosen - NEAR)
    near = np.stack([place, np.arange(count)], axis=1)[ok]
    close = cKDTree(truth[:, :2]).query_pairs(AT, output_type="ndarray")
    close = close[path[close[:, 1]] - path[close[:, 0]] >= AGAIN] if len(close) else close.reshape(0, 2)
    apart = np.hypot(*(truth[close[:, 0], :2] - truth[close[:, 1], :2]).T)
    close = close[np.lexsort((apart, close[:, 1]))]
    again = close[np.unique(close[:, 1], return_index=True)[1]]
    return [relative_errors(poses, truth, joint, pairs) for pairs in (first, near, again)]


def measure(world: World, laser: LaserModel, rate: float, seed: int, duration: float) -> dict[str, Errors]:
    """All errors of one drive."""
    log = simulate(world, drive(tour(world, seed, 1.2 * duration), rate=rate, duration=duration), laser,
                   OdometryModel.medium(), seed)
    out = dict(zip(("matches", "steps"), front_end(log), strict=True))
    slam = Slam()
    for measurement in log.measurements():
        slam.add(measurement)
    slam.optimise()
    for stage in ("", "refined "):
        if stage:
            slam.refine()
        for name, errors in zip(("first", "near", "revisit"), final_errors(log, slam), strict=True):
            out[stage + name] = errors
    return out


def cells(runs: list[Errors]) -> list[str]:
    """Mean and its standard error over runs, its band, share inside, root mean square error and what was stated."""
    runs = [run for run in runs if len(run.squared) > 1]
    if not runs:
        return ["-"] * 4
    means = np.array([run.mean for run in runs])
    deviation = f"{means.std(ddof=1) / np.sqrt(len(means)):.2f}" if len(means) > 1 else "-"
    freedom = 3 * sum(effective_count(run.squared) for run in runs)
    low, high = chi2.ppf([0.025, 0.975], freedom) / freedom
    names = ("squared", "distance", "stated")
    total = Errors(*(np.concatenate([getattr(run, name) for run in runs]) for name in names))
    true, stated = (100 * float(np.sqrt(np.mean(np.square(v)))) for v in (total.distance, total.stated))
    return [f"{means.mean():.2f} ± {deviation}", f"{low:.2f} to {high:.2f}", f"{100 * total.inside:.0f}",
            f"{true:.2f} / {stated:.2f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", nargs="+", choices=list(WORLDS), default=list(ORDINARY))
    parser.add_argument("--lasers", nargs="+", choices=list(LASERS), default=["default", "coarse", "noisy"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102, 103])
    parser.add_argument("--duration", type=float, default=150.0, help="of the drives, seconds")
    parser.add_argument("--runs", action="store_true", help="a line a run as well")
    options = parser.parse_args()
    rows = []
    for world in options.worlds:
        for laser in options.lasers:
            found = []
            for seed in options.seeds:
                found.append(measure(WORLDS[world](seed), *LASERS[laser], seed, options.duration))
                if options.runs:
                    print(world, laser, seed, {k: f"{e.mean:.2f} {100 * e.inside:.0f}" for k, e in found[-1].items()},
                          flush=True)
            for name in found[0]:
                rows.append([f"{world}, {laser}", name, *cells([run[name] for run in found])])
    print_table(["world, laser", "poses", "normalised error", "band", "inside: %", "true / stated: cm"], rows)


if __name__ == "__main__":
    main()
