"""Places in the real logs: which descriptor tells them apart best, and are closures right and complete?

    python benchmarks/places.py                # the logs of ../shared/data/lidar, by their reference trajectories
    python benchmarks/places.py intel

Descriptors: of all pairs of a keyframe's surroundings and older places 15 m of way ago or more, a pair within 2 m is
the same place, one beyond 6 m another; those between do not count. Told are, for the most alike place of each keyframe
that has one to find, how often it is the right one, how many are right above the likeness from which on none is wrong
(recall at 100 % precision), and the time to describe one.

Closures: those of the default configuration, right and complete as in `benchmarks/revisits.py`, the references being
good to some two centimetres. Keyframes without a reference pose are left out.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.evaluate import poses_at
from clew.geometry import se2
from clew.io import open_log, read_tum
from clew.place import Descriptor, PairDistances, RingSpectra, TurnedRings
from clew.scan import LaserScan, ScanPoints, extract_points, merge_surfels
from clew.scan.points import concatenate
from clew.slam import Slam
from revisits import judge, recall, revisits

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "lidar"
LOGS = ("intel", "fr079", "mit-csail")
DESCRIPTORS: list[Descriptor] = [TurnedRings(), RingSpectra(), PairDistances()]
AGO, SAME, OTHER = 15.0, 2.0, 6.0  # metres
BEFORE, ABOUT, EVERY = 8, 8, 4  # keyframes: of a query; about a place; from place to place
VOXEL = 0.05
LEAD = 1.0  # seconds from a pose of the reference to a keyframe


def surroundings(clouds: list[ScanPoints], local: Array, k: int, first: int, last: int) -> ScanPoints:
    """Surfels of keyframes `first` to `last` in the frame of one of them, by the estimate."""
    members = range(max(first, 0), min(last + 1, len(clouds)))
    return merge_surfels(concatenate([clouds[m].transformed(se2.between(local[k], local[m])) for m in members]), VOXEL)


def true_poses(times: Array, reference: Array, slam: Slam) -> tuple[Array, NDArray[np.bool_]]:
    """Poses ``(K, 3)`` of the keyframes by the reference, and which are near one of its poses.

    From the pose of the reference that is nearest in time the estimate leads on, over a second at most.
    """
    stamps = slam.every_keyframe.timestamps
    nearest = np.abs(stamps[:, None] - times).argmin(axis=1)
    at_reference, known = poses_at(slam.trajectory.timestamps, slam.trajectory.T_world_robot, times[nearest], 1e-3)
    planar = np.column_stack([reference[:, :2], 2.0 * np.arctan2(reference[:, 5], reference[:, 6])])[nearest]
    onwards = se2.between(at_reference, slam.every_keyframe.T_world_robot)
    return se2.compose(planar, onwards), known & (np.abs(times[nearest] - stamps) <= LEAD)


def compare(descriptor: Descriptor, queries: list[ScanPoints], places: list[ScanPoints], at: Array, of: Array,
            query_path: Array, place_path: Array) -> list[str]:
    """Cells of a descriptor: the best place right, recall at 100 % precision, time."""
    began = time.process_time()
    asked, known = descriptor.describe(queries), descriptor.describe(places)
    seconds = (time.process_time() - began) / (len(queries) + len(places))
    older = place_path[None] <= query_path[:, None] - AGO
    distance = np.hypot(*(at[:, None, :2] - of[None, :, :2]).transpose(2, 0, 1))
    same, other = older & (distance <= SAME), older & (distance > OTHER)
    alike = np.where(same | other, np.stack([descriptor.compare(known, one) for one in asked]), -1.0)
    best = alike.argmax(axis=1)
    rows = np.flatnonzero(same.any(axis=1))
    right = same[np.arange(len(asked)), best]
    likeness = alike[np.arange(len(asked)), best]
    wrong = np.flatnonzero(~right & (likeness >= 0.0))  # also of keyframes that have nothing to find
    limit = likeness[wrong].max() if len(wrong) else 0.0
    return [descriptor.name, f"{len(rows)}", f"{100 * right[rows].mean():.1f}",
            f"{100 * (right[rows] & (likeness[rows] > limit)).mean():.1f}", f"{1e3 * seconds:.2f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help=f"logs, all by default: {', '.join(LOGS)}")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the logs and their references")
    options = parser.parse_args()
    appearance, closures = [], []
    for name in options.names or LOGS:
        slam, scans = Slam(), {}
        for measurement in open_log(options.data / f"{name}.clf.bz2").measurements():
            slam.add(measurement)
            if isinstance(measurement, LaserScan):
                scans[measurement.timestamp] = measurement
        slam.refine()
        stamps, local = slam.every_keyframe.timestamps, slam.every_keyframe.T_world_robot
        times, reference = read_tum(options.data / f"{name}.reference.tum")
        truth, known = true_poses(times, reference, slam)
        clouds = [extract_points(scans[t]) for t in stamps.tolist()]
        path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(local[:, :2], axis=0).T))])

        rows = np.flatnonzero(known)
        seen_again, _ = revisits(lambda i, c=clouds, r=rows: c[r[i]].points, truth[rows], path[rows])
        judged = [c for c in slam.closures if known[c.source] and known[c.target]]
        right, partial, wrong = judge(judged, truth)
        begins = path[[c.source for c, good in zip(judged, right, strict=True) if good]]
        count, missed = recall(path, rows[seen_again], begins)
        closures.append([name, f"{int(right.sum())} / {len(judged)}", f"{int(partial.sum())}",
                         f"{100 * right.sum() / max(len(judged), 1):.2f}", f"{count - len(missed)} / {count}",
                         f"{100 * (count - len(missed)) / max(count, 1):.1f}"])
        gaps = ", ".join(f"{a:.0f}-{b:.0f} m" for a, b in missed)
        print(f"{name}: wrong {'; '.join(wrong) or 'none'}; missed {gaps or 'nothing'}")

        rows = rows[rows >= BEFORE]
        places = rows[rows % EVERY == 0]
        queries = [surroundings(clouds, local, k, k - BEFORE, k) for k in rows.tolist()]
        about = [surroundings(clouds, local, k, k - ABOUT, k + ABOUT) for k in places.tolist()]
        appearance += [[name, *compare(d, queries, about, truth[rows], truth[places], path[rows], path[places])]
                       for d in DESCRIPTORS]
    for columns, table in (
        (["log", "descriptor", "keyframes", "best place right: %", "recall at 100 % precision: %", "ms"], appearance),
        (["log", "right closures", "partial", "precision %", "revisits closed", "recall %"], closures),
    ):
        print("\n| " + " | ".join(columns) + " |\n| --- |" + " ---: |" * (len(columns) - 1))
        for row in table:
            print("| " + " | ".join(row) + " |")


if __name__ == "__main__":
    main()
