"""Stated uncertainty of landmark SLAM in simulated drives whose errors are known. Prints Markdown.

Errors are white and Gaussian (nothing of the model beyond that must be found), heavy-tailed, or those and all that real
ones have: views that err as a whole, ranges whose errors grow with their square, marks that differ, drifting wheels.
Run: ``python benchmarks/landmark_noise.py [--seeds 20 21 22]``.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.evaluate import align, consistency, normalised_squares
from clew.geometry import se2, wrap
from clew.io import SightingLog, Sightings, Velocities
from clew.io.log import ReadReport
from clew.slam.landmarks import map_landmarks
from clew.solve import aligned_covariances

Array = NDArray[np.float64]
SIZE, MARKS, PERIOD, SECONDS = np.array([10.0, 6.0]), 15, 0.1, 900.0
RANGE, BEARING = 0.02, 0.003  # scales of the errors of each sighting, metres and radians
MOTION = np.array([0.04, 0.04, 0.02])  # a root metre along, across and of the heading
TURNING = 0.09  # a root radian


@dataclass(frozen=True)
class Errors:
    """What is wrong with the measurements beside noise; see the fields of the models of `clew.slam.landmarks`."""

    tails: bool = False
    view: tuple[float, float] = (0.0, 0.0)
    growth: float = 0.0
    mark: float = 0.0
    drift: float = 0.0


CASES = {
    "white, Gaussian": Errors(),
    "white, heavy tails": Errors(tails=True),
    "all of it": Errors(tails=True, view=(0.01, 0.002), growth=0.15, mark=0.003, drift=0.08),
}


def simulate(errors: Errors, seed: int) -> SightingLog:
    """A robot that drives between random places and sees marks ahead of it."""
    rng = np.random.default_rng(seed)
    marks = rng.random((MARKS, 2)) * SIZE
    too_far = 1.0 + errors.mark * rng.standard_normal(MARKS)
    count = int(SECONDS / PERIOD)
    truth, controls = np.zeros((count, 4)), np.zeros((count, 2))
    pose, goal, scales = np.array([*SIZE / 2, 0.0]), rng.random(2) * SIZE, np.ones(2)
    for k in range(count):
        if k % 100 == 0:
            scales = 1.0 + errors.drift * rng.standard_normal(2)
        truth[k] = [k * PERIOD, *pose]
        to_goal = goal - pose[:2]
        if np.hypot(*to_goal) < 0.4:
            goal = rng.random(2) * SIZE
        off = float(wrap(np.arctan2(to_goal[1], to_goal[0]) - pose[2]))
        controls[k] = [0.15 if abs(off) < 0.6 else 0.0, np.clip(off, -0.5, 0.5)]
        step = PERIOD * controls[k] * scales
        sigmas = MOTION * np.sqrt(step[0])
        sigmas[2] = np.hypot(sigmas[2], TURNING * np.sqrt(abs(step[1])))
        pose = se2.compose(pose, se2.exp(np.array([step[0], 0.0, step[1]])) + sigmas * rng.standard_normal(3))
    rows, last, bias = [], np.full(MARKS, -np.inf), np.zeros((MARKS, 2))
    for stamp, *at in truth[::4].tolist():
        q = se2.act(se2.inverse(np.array(at)), marks)
        distance, bearing = np.hypot(*q.T), np.arctan2(q[:, 1], q[:, 0])
        for j in np.flatnonzero((np.abs(bearing) < 0.45) & (distance < 6.0) & (distance > 0.3)).tolist():
            if stamp - last[j] > 2.0:
                bias[j] = np.array(errors.view) * rng.standard_normal(2)
            last[j] = stamp
            e = rng.standard_t(4.0, 2) if errors.tails else rng.standard_normal(2)
            larger = np.hypot(1.0, errors.growth * distance[j] ** 2)
            rows.append((stamp, 6 + j, distance[j] * too_far[j] + larger * (RANGE * e[0] + bias[j, 0]),
                         bearing[j] + BEARING * e[1] + bias[j, 1]))  # fmt: skip
    t, identity, distance, bearing = np.array(rows).T
    none = Sightings(*(np.empty(0, kind) for kind in (float, np.int64, float, float)))
    return SightingLog(
        Path("simulated"), 1, Velocities(truth[:, 0], controls[:, 0], controls[:, 1]),
        Sightings(t, identity.astype(np.int64), distance, bearing), none, truth, ReadReport(),
    )  # fmt: skip


def row(name: str, errors: Errors, seed: int) -> str:
    log = simulate(errors, seed)
    assert log.truth is not None
    found = map_landmarks([log])
    (robot,) = found.robots
    truth = np.stack([np.interp(robot.timestamps, log.truth[:, 0], c) for c in (*log.truth[:, 1:3].T,
                     np.unwrap(log.truth[:, 3]))], axis=1)  # fmt: skip
    moved = se2.compose(align(truth[:, :2], robot.T_world_robot[:, :2]), robot.T_world_robot)
    middle = truth[:, :2].mean(axis=0)
    arms = moved[:, :2] - middle
    size = float(np.sum(arms * (truth[:, :2] - middle)) / np.sum(arms**2))
    moved[:, :2] = middle + size * arms
    error = se2.local(moved, truth)
    covariances = aligned_covariances(found.solution, robot.keys, scale=True).poses
    squares = consistency(normalised_squares(error[:, :2], covariances[:, :2, :2]), 2)
    noise = robot.model.landmarks
    return (
        f"| {name} | {seed} | {len(log.landmarks)} | {100 * np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))):.1f} | "
        f"{squares.mean:.2f} | {squares.low:.2f} to {squares.high:.2f}: {squares.verdict} | {100 * (size - 1):+.1f} | "
        f"{100 * noise.range:.1f}, {1e3 * noise.bearing:.1f} | {100 * noise.range_bias:.1f}, "
        f"{1e3 * noise.bearing_bias:.1f} | {noise.growth:.2f} | {1e3 * found.marks.landmarks.share:.1f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[20, 21, 22])
    options = parser.parse_args()
    print("| errors | seed | sightings | off cm | NEES position (2) | 95 % band | scale % | noise cm, mrad | "
          "of views cm, mrad | growth 1/m^2 | marks per mille |\n" + "| --- " * 11 + "|")  # fmt: skip
    for name, errors in CASES.items():
        for seed in options.seeds:
            print(row(name, errors, seed), flush=True)


if __name__ == "__main__":
    main()
