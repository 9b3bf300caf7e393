"""Merging simulated robots: how exact relative poses are, and how often robots without overlap are merged.

    python benchmarks/fleet.py                 # 1,000 pairs without overlap, 40 fleets of five with overlap
    python benchmarks/fleet.py --pairs 100 --fleets 5

Pairs without overlap drive in different worlds (or in two halves of one). Landmarks are scattered at random, stand in
rows like an orchard or the columns of a hall, or in clumps; in some worlds a part of them carries identities, which
the other world does not share. A wrong merge is any relative pose that is found.

The relative pose of two robots is judged by their trajectories: each estimated trajectory is fitted rigidly to the true
one; how far these fits differ in the middle of the other robot's trajectory, and by what angle, is the error.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.fleet import MergedFleet, RobotGraph, Verdict, graphs_of_fleet, merge, relative_pose
from clew.geometry import se2
from clew.sim import FleetModel, LandmarkWorld, MeetingModel, RobotRun, SightingModel, landmark_field, simulate_fleet

Array = NDArray[np.float64]

LAYOUTS = ("scattered", "rows", "clumps", "halves")
#: Of the relative pose, metres and degrees (the target of the issue).
TARGET = (0.10, 1.0)


def world_of(layout: str, seed: int, identified: float, first_identity: int) -> LandmarkWorld:
    """A world of about 40 landmarks on 40 x 30 m."""
    world = landmark_field(40, (40.0, 30.0), seed=seed, identified=identified, first_identity=first_identity)
    rng = np.random.default_rng(seed)
    positions = world.positions
    if layout == "rows":
        spacing = np.array([4.0, 5.0]) if seed % 2 else 3.0 + 3.0 * rng.random(2)
        grid = np.stack(np.meshgrid(np.arange(8), np.arange(5)), axis=-1).reshape(-1, 2) * spacing + 2.0
        positions = grid + 0.15 * rng.standard_normal(grid.shape)
        positions += (rng.random((40, 1)) < 0.1) * rng.standard_normal((40, 2))
    elif layout == "clumps":
        centres = rng.random((8, 2)) * (34, 24) + 3
        positions = np.repeat(centres, 5, axis=0) + rng.standard_normal((40, 2))
    return replace(world, positions=positions)


def strangers(seed: int) -> list[RobotGraph]:
    """Two robots that never saw the same landmark."""
    layout = LAYOUTS[seed % len(LAYOUTS)]
    identified = (0.0, 0.0, 0.3)[seed % 3]
    model = FleetModel(sightings=SightingModel(sigma_bearing=np.radians(2.0) if seed % 5 == 0 else np.radians(1.0)))
    if layout == "halves":
        world = landmark_field(80, (80.0, 30.0), seed=seed, identified=identified)
        runs = simulate_fleet(world, 2, seed=seed, model=model, areas=[(0, 0, 30, 30), (50, 0, 80, 30)])
    else:
        worlds = [world_of(layout, 2 * seed + k, identified, 1 + 1000 * k) for k in range(2)]
        runs = [simulate_fleet(w, 1, seed=2 * seed + k, model=model)[0] for k, w in enumerate(worlds)]
    return graphs_of_fleet(runs, model.sightings)


def errors(merged: MergedFleet, runs: list[RobotRun]) -> tuple[Array, Array]:
    """Errors of the poses of all robots but the first relative to the first, metres and radians."""
    fits = [_rigid(run.T_world_robot[:, :2], merged.poses(k).array[:, :2]) for k, run in enumerate(runs)]
    distance, angle = [], []
    for fit, run in zip(fits[1:], runs[1:], strict=True):
        middle = run.T_world_robot[:, :2].mean(axis=0)
        distance.append(np.hypot(*(se2.act(fit, middle) - se2.act(fits[0], middle))))
        angle.append(abs(se2.between(fits[0], fit)[2]))
    return np.array(distance), np.array(angle)


def _rigid(source: Array, target: Array) -> Array:
    """Pose that takes points best to others (Arun, Huang & Blostein 1987)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    theta = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    turned = se2.act(np.array([0.0, 0.0, theta]), source.mean(axis=0))
    return np.array([*(target.mean(axis=0) - turned), theta])


def without_overlap(pairs: int) -> None:
    """Count wrong merges."""
    verdicts: dict[str, Counter[str]] = {layout: Counter() for layout in LAYOUTS}
    least, start = 0.0, time.perf_counter()
    for seed in range(pairs):
        found = relative_pose(*strangers(seed))
        verdicts[LAYOUTS[seed % len(LAYOUTS)]][found.verdict.name.lower()] += 1
        least = min(least, np.nan_to_num(found.log10_false_alarms))
    wrong = sum(counts["found"] for counts in verdicts.values())
    print(f"## {pairs} pairs without overlap: {wrong} wrong merges (target 0)\n")
    print("| landmarks | " + " | ".join(v.name.lower() for v in Verdict) + " |\n|" + " --- |" * (len(Verdict) + 1))
    for layout, counts in verdicts.items():
        print(f"| {layout} | " + " | ".join(str(counts[v.name.lower()]) for v in Verdict) + " |")
    print(f"\nleast log10 of expected false alarms {least:.1f}; {time.perf_counter() - start:.0f} s\n")


def with_overlap(fleets: int) -> None:
    """Errors of relative poses of five robots in one world."""
    print(f"## {fleets} fleets of five robots in one world (target {TARGET[0]} m, {TARGET[1]} deg)\n")
    print("| landmarks | merged | refused | worst m | mean m | worst deg | s a fleet |\n|" + " --- |" * 7)
    areas = [(0, 0, 26, 30), (14, 0, 40, 30), (0, 0, 40, 18), (0, 12, 40, 30), (8, 5, 32, 25)]
    kinds = {"with identity": (1.0, 0.0), "half with identity": (0.5, 0.0), "without identity": (0.0, 0.0),
             "without, robots see each other": (0.0, 6.0)}
    for name, (identified, reach) in kinds.items():
        model = FleetModel(meetings=MeetingModel(range_max=reach))
        distances, angles, refused, start = [], [], 0, time.perf_counter()
        for seed in range(fleets):
            world = landmark_field(60, (40.0, 30.0), seed=seed, identified=identified)
            runs = simulate_fleet(world, 5, seed=seed, model=model, areas=areas)
            try:
                merged = merge(graphs_of_fleet(runs, model.sightings, model.meetings if reach else None))
            except InputError:
                refused += 1
                continue
            distance, angle = errors(merged, runs)
            distances.append(distance)
            angles.append(angle)
        spent = (time.perf_counter() - start) / fleets
        far, turned = (np.concatenate([*columns, [0.0]]) for columns in (distances, angles))
        print(f"| {name} | {fleets - refused} | {refused} | {far.max():.3f} | {far.mean():.3f} | "
              f"{np.degrees(turned.max()):.2f} | {spent:.1f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=1000)
    parser.add_argument("--fleets", type=int, default=40)
    options = parser.parse_args()
    without_overlap(options.pairs)
    with_overlap(options.fleets)


if __name__ == "__main__":
    main()
