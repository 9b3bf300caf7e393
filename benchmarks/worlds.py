"""Simulated buildings of several kinds, three qualities of odometry, many seeds: are closures right, and maps whole?

    python benchmarks/worlds.py                                   # everything, 20 seeds
    python benchmarks/worlds.py alike doors --quality poor worse --seeds 1 2 3
    python benchmarks/worlds.py --jobs 2 --failures               # and tell of each run that is not as it should be

What is counted, all against the truth of the simulation:

- Right closures ("partial": those that are right only in the directions that they claim to know), revisits and recall
  are as in `benchmarks/revisits.py`: within 0.15 m and 2 degrees; stretches of 5 m on which a place is seen again.
- *Doubled* is the relative pose between visits of a revisit in the final trajectory against the truth, 95 % of them
  being better. A map is *broken* if that is more than 0.5 m or 5 degrees, or if the trajectory is off by more than 2 %
  of its length (RMSE).
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from clew.evaluate import absolute_trajectory_error
from clew.geometry import se2
from clew.scan import extract_points
from clew.sim import LaserModel, OdometryModel, simulate_kind
from clew.slam import Slam
from revisits import judge, recall, revisits

#: Kinds of worlds and how long the robot drives there, seconds.
KINDS = {"office": 300.0, "alike": 300.0, "doors": 380.0, "hall": 240.0, "loop": 420.0, "campus": 420.0}
#: `OdometryModel.bad`, and everything about it twice as bad.
WORSE = OdometryModel(0.06, 0.04, 0.006, 0.1, 0.04, 0.08, 0.03)
QUALITIES = {"good": OdometryModel.good(), "poor": OdometryModel.bad(), "worse": WORSE}
LASER = LaserModel(beams=181, range_max=25.0)
RATE = 3.0  # Hz

BROKEN_DISTANCE, BROKEN_ANGLE, BROKEN_SHARE = 0.5, np.radians(5.0), 0.02


@dataclass(frozen=True)
class Outcome:
    """What came of one run.

    Attributes:
        kind, quality, seed: of the world.
        reckoned: ATE of odometry alone, metres.
        ate: of the result, metres.
        doubled: error between visits of a place, metres (95 % are better); 0 without revisits.
        broken: whether the map is.
        right, partial, closures: right closures, those among them that know only some directions, all.
        closed, revisits: stretches.
        wrong, missed: what is to be told of wrong closures and of stretches without a right one.
        seconds: of CPU for the estimate.
    """

    kind: str
    quality: str
    seed: int
    reckoned: float
    ate: float
    doubled: float
    broken: bool
    right: int
    partial: int
    closures: int
    closed: int
    revisits: int
    wrong: tuple[str, ...]
    missed: tuple[str, ...]
    seconds: float


def run(kind: str, quality: str, seed: int) -> Outcome:
    """Simulate a drive, map it with the default configuration, compare with the truth."""
    log = simulate_kind(kind, seed, duration=KINDS[kind], rate=RATE, laser=LASER, odometry=QUALITIES[quality])
    began = time.process_time()
    slam = Slam()
    for measurement in log.measurements():
        slam.add(measurement)
    slam.refine()
    seconds = time.process_time() - began
    stamps = slam.every_keyframe.timestamps
    rows = np.searchsorted(log.timestamps, stamps)
    truth = log.T_world_robot[rows]
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(log.T_world_robot[:, :2], axis=0).T))])[rows]
    right, partial, wrong = judge(slam.closures, truth)
    again, before = revisits(lambda k: extract_points(log.scan(int(rows[k]))).points, truth, path)
    begins = path[[c.source for c, good in zip(slam.closures, right, strict=True) if good]]
    stretches, missed = recall(path, again, begins)
    estimate = slam.every_keyframe.T_world_robot
    miss = se2.between(se2.between(truth[before], truth[again]), se2.between(estimate[before], estimate[again]))
    doubled = float(np.quantile(np.hypot(miss[:, 0], miss[:, 1]), 0.95)) if len(again) else 0.0
    bent = float(np.quantile(np.abs(miss[:, 2]), 0.95)) if len(again) else 0.0
    poses = (log.timestamps, log.T_world_robot)
    ate = absolute_trajectory_error(*poses, slam.trajectory.timestamps, slam.trajectory.T_world_robot).translation.rmse
    reckoned = absolute_trajectory_error(*poses, log.timestamps, log.T_odom_robot).translation.rmse
    broken = doubled > BROKEN_DISTANCE or bent > BROKEN_ANGLE or ate > BROKEN_SHARE * path[-1]
    return Outcome(kind, quality, seed, reckoned, ate, doubled, bool(broken), int(right.sum()), int(partial.sum()),
                   len(right), stretches - len(missed), stretches, tuple(wrong),
                   tuple(f"{a:.0f}-{b:.0f} m" for a, b in missed), seconds)


COLUMNS = ["world", "odometry", "runs", "odometry ATE m", "ATE m: median", "worst", "doubled m: worst",
           "right closures", "partial", "precision %", "recall %", "broken maps", "CPU s"]


def row_of(kind: str, quality: str, outcomes: list[Outcome]) -> list[str]:
    """One line of the table."""
    total = {name: sum(getattr(o, name) for o in outcomes)
             for name in ("right", "partial", "closures", "closed", "revisits", "broken")}
    return [kind, quality, f"{len(outcomes)}", f"{np.median([o.reckoned for o in outcomes]):.2f}",
            f"{np.median([o.ate for o in outcomes]):.3f}", f"{max(o.ate for o in outcomes):.3f}",
            f"{max(o.doubled for o in outcomes):.3f}", f"{total['right']} / {total['closures']}",
            f"{total['partial']}", f"{100 * total['right'] / max(total['closures'], 1):.2f}",
            f"{100 * total['closed'] / max(total['revisits'], 1):.1f}", f"{total['broken']}",
            f"{np.mean([o.seconds for o in outcomes]):.1f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", help=f"of worlds, all by default: {', '.join(KINDS)}")
    parser.add_argument("--quality", nargs="+", choices=list(QUALITIES), default=list(QUALITIES), help="of odometry")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 21)), help="1 to 20 by default")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--failures", action="store_true", help="tell of wrong closures, missed revisits, broken maps")
    options = parser.parse_args()
    if unknown := sorted(set(options.kinds) - set(KINDS)):
        parser.error(f"unknown: {', '.join(unknown)}; there are {', '.join(KINDS)}")
    print("| " + " | ".join(COLUMNS) + " |\n| --- | --- |" + " ---: |" * (len(COLUMNS) - 2), flush=True)
    with ProcessPoolExecutor(options.jobs) as pool:
        asked = {(kind, quality): [pool.submit(run, kind, quality, seed) for seed in options.seeds]
                 for kind in options.kinds or KINDS for quality in options.quality}
        everything: list[Outcome] = []
        for (kind, quality), futures in asked.items():
            outcomes = [future.result() for future in futures]
            everything += outcomes
            print("| " + " | ".join(row_of(kind, quality, outcomes)) + " |", flush=True)
            for o in outcomes if options.failures else []:
                if o.wrong or o.broken or o.missed:
                    print(f"{o.kind} {o.quality} {o.seed}: ATE {o.ate:.3f} m, doubled {o.doubled:.3f} m"
                          f"{', broken' * o.broken}; missed {', '.join(o.missed) or 'nothing'}; "
                          f"wrong: {'; '.join(o.wrong) or 'none'}", file=sys.stderr, flush=True)
    print("| " + " | ".join(row_of("all", "", everything)) + " |")


if __name__ == "__main__":
    main()
