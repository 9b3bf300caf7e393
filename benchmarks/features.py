"""Lines, corners and round things on real logs: how many are found again, and are their covariances honest?

    python benchmarks/features.py                    # the real logs of ../shared/data/lidar
    python benchmarks/features.py mit-csail --pairs 200 --sigma 0.015

A log is mapped and refined; then features are found in the scans of pairs of keyframes that stand near each other
(successive ones, and revisits after 10 m of way), and those of one are carried over by the relative pose of the refined
graph. A feature is to be found again where a return of the other scan lies within 0.3 m of its middle. "Normalised
error" is the squared Mahalanobis distance between the two over its degrees of freedom, with the covariances of both and
of the relative pose: one where they are right, more where features claim too much. Its median is divided by that of
chi-squared, so that things which moved or were taken for another do not count; "inside" is the share within the 95 %
ellipse.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from clew.geometry import se2, wrap
from clew.io import open_log
from clew.scan import (
    CircleOptions,
    LaserScan,
    LineOptions,
    ReturnOptions,
    collinearity_residuals,
    find_circles,
    find_corners,
    find_lines,
    robust_deviation,
)
from clew.slam import Slam
from lidar import DATA, LOGS, print_table

Array = NDArray[np.float64]
Index = NDArray[np.int64]

NEAR, TURNED, LATER = 1.5, np.radians(30.0), 10.0  # metres, radians, and metres of way of a revisit
FOUND = (0.3, 0.15)  # metres and radians between features that are the same at most
SEEN = 0.3  # metres from the middle of a feature to the nearest return of the other scan


@dataclass(frozen=True)
class Features:
    """Features of many scans as rows that can be compared.

    Attributes:
        scan: ``(K,)``.
        values: ``(K, d)`` position or line, then what else.
        covariances: ``(K, d, d)``.
        middles: ``(K, 2)`` where they are.
        carry: takes values ``(n, d)`` over by a pose ``(3,)``; with derivatives by them and by the pose's tangent.
    """

    scan: Index
    values: Array
    covariances: Array
    middles: Array
    carry: Callable[[Array, Array], tuple[Array, Array, Array]]


def carry_line(pose: Array, lines: Array) -> tuple[Array, Array, Array]:
    """Lines ``(n, 2)`` of angle and distance."""
    alpha = lines[:, 0] + pose[2]
    c, s = np.cos(alpha), np.sin(alpha)
    moved = np.column_stack([wrap(alpha), lines[:, 1] + pose[0] * c + pose[1] * s])
    by_line = np.zeros((len(lines), 2, 2))
    by_line[:, 0, 0] = by_line[:, 1, 1] = 1.0
    by_line[:, 1, 0] = pose[1] * c - pose[0] * s
    by_pose = np.zeros((len(lines), 2, 3))  # t <- t + R v, theta <- theta + w
    by_pose[:, 0, 2] = 1.0
    by_pose[:, 1, 0], by_pose[:, 1, 1] = np.cos(lines[:, 0]), np.sin(lines[:, 0])
    by_pose[:, 1, 2] = by_line[:, 1, 0]
    return moved, by_line, by_pose


def carry_point(pose: Array, values: Array) -> tuple[Array, Array, Array]:
    """Points ``(n, 2)``, or points with a radius ``(n, 3)``."""
    moved = values.copy()
    moved[:, :2] = se2.act(pose, values[:, :2])
    c, s = np.cos(pose[2]), np.sin(pose[2])
    rotation = np.array([[c, -s], [s, c]])
    by_value = np.tile(np.eye(values.shape[1]), (len(values), 1, 1))
    by_value[:, :2, :2] = rotation
    by_pose = np.zeros((len(values), values.shape[1], 3))
    by_pose[:, :2, :2] = rotation
    turned = values[:, :2] @ rotation.T
    by_pose[:, 0, 2], by_pose[:, 1, 2] = -turned[:, 1], turned[:, 0]
    return moved, by_value, by_pose


def features_of(scans: list[LaserScan], noise: ReturnOptions) -> dict[str, Features]:
    """All kinds of features, with the noise of returns."""
    lines = find_lines(scans, LineOptions(noise))
    corners, circles = find_corners(lines), find_circles(scans, CircleOptions(noise))
    return {
        "lines": Features(lines.scan, lines.parameters, lines.covariances, lines.ends.mean(axis=1), carry_line),
        "corners": Features(corners.scan, corners.positions, corners.covariances, corners.positions, carry_point),
        "round": Features(circles.scan, np.column_stack([circles.centres, circles.radii]), circles.covariances,
                          circles.centres, carry_point),
    }  # fmt: skip


def map_of(name: str, data: Path) -> tuple[Slam, list[LaserScan]]:
    """A refined map, and the scan of each of its keyframes."""
    slam, scans = Slam(), {}
    for measurement in open_log(data / f"{name}.clf.bz2").measurements():
        if isinstance(measurement, LaserScan):
            if not slam.has_odometry or (slam.scan_count and measurement.timestamp <= slam.time_span[1]):
                continue
            scans[measurement.timestamp] = measurement
        slam.add(measurement)
    slam.refine()
    return slam, [scans[stamp] for stamp in slam.keyframes.timestamps.tolist()]


def pairs_of(poses: Array, most: int) -> dict[str, Index]:
    """Pairs ``(P, 2)`` of keyframes that stand near each other and face the same way."""
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))
    first, second = np.triu_indices(len(poses), 1)
    relative = se2.between(poses[first], poses[second])
    near = (np.hypot(relative[:, 0], relative[:, 1]) < NEAR) & (np.abs(relative[:, 2]) < TURNED)
    kinds = {"successive": near & (second == first + 1), "revisits": near & (way[second] - way[first] > LATER)}
    rng = np.random.default_rng(1)
    pairs = {}
    for kind, chosen in kinds.items():
        rows = np.flatnonzero(chosen)
        rows = np.sort(rng.permutation(rows)[:most])
        pairs[kind] = np.stack([first[rows], second[rows]], axis=1)
    return pairs


def compare(a: Index, b: Index, features: Features, pose: Array, covariance: Array, returns: Array
            ) -> tuple[int, int, Array]:
    """How many of `b` should be found again, how many are, and normalised squared distances of these.

    Args:
        a, b: features of the two scans.
        features: all of them.
        pose, covariance: of scan b seen from a.
        returns: ``(n, 2)`` of scan a.
    """
    if not len(b) or not len(returns):
        return 0, 0, np.zeros(0)
    middles = se2.act(pose, features.middles[b])
    nearest = np.sqrt(((middles[:, None] - returns[None]) ** 2).sum(axis=2).min(axis=1))
    b, middles = b[nearest < SEEN], middles[nearest < SEEN]
    if not len(a) or not len(b):
        return len(b), 0, np.zeros(0)
    moved, by_value, by_pose = features.carry(pose, features.values[b])
    difference = moved[:, None] - features.values[a][None]
    if features.carry is carry_line:
        difference[..., 0] = wrap(difference[..., 0])
        alpha, rho = features.values[a].T
        off = np.abs(middles @ np.stack([np.cos(alpha), np.sin(alpha)]) - rho)
        off = np.where(np.abs(difference[..., 0]) < FOUND[1], off, np.inf)
    else:
        off = np.hypot(difference[..., 0], difference[..., 1])
    best = off.argmin(axis=1)
    mutual = (off.argmin(axis=0)[best] == np.arange(len(b))) & (off[np.arange(len(b)), best] < FOUND[0])
    row, error = np.flatnonzero(mutual), difference[np.arange(len(b)), best][mutual]
    total = features.covariances[a[best[row]]]
    total = total + by_value[row] @ features.covariances[b[row]] @ np.swapaxes(by_value[row], 1, 2)
    total = total + by_pose[row] @ covariance @ np.swapaxes(by_pose[row], 1, 2)
    return len(b), len(row), np.einsum("ni,nij,nj->n", error, np.linalg.inv(total), error)


def rows_of(name: str, slam: Slam, scans: list[LaserScan], most: int, noise: ReturnOptions) -> list[list[str]]:
    """A row for each kind of feature and of pairs."""
    poses, solution = slam.keyframes.T_world_robot, slam.solution()
    keys, points = slam.keyframe_numbers, slam.keyframe_points
    found = features_of(scans, noise)
    of_scan = {kind: [np.flatnonzero(f.scan == k) for k in range(len(scans))] for kind, f in found.items()}
    rows = []
    for visits, pairs in pairs_of(poses, most).items():
        counts = {kind: [0, 0] for kind in found}
        squares: dict[str, list[Array]] = {kind: [] for kind in found}
        for a, b in pairs.tolist():
            pose = se2.between(poses[a], poses[b])
            joint = solution.joint_covariance([int(keys[a]), int(keys[b])])
            by_a = -se2.adjoint(se2.inverse(pose))
            both = np.concatenate([by_a, np.eye(3)], axis=1)
            covariance = both @ joint @ both.T
            for kind, features in found.items():
                expected, again, squared = compare(of_scan[kind][a], of_scan[kind][b], features, pose, covariance,
                                                   points[a])  # fmt: skip
                counts[kind][0] += expected
                counts[kind][1] += again
                squares[kind].append(squared)
        for kind, (expected, again) in counts.items():
            squared = np.concatenate([np.zeros(0), *squares[kind]])
            dim = found[kind].values.shape[1]
            if again < 30:
                rows.append([name, visits, kind, str(expected), str(again), "-", "-", "-"])
                continue
            rows.append([name, visits, kind, str(expected), f"{100 * again / expected:.0f} %",
                         f"{np.median(squared) / chdtri(dim, 0.5):.2f}", f"{np.minimum(squared, 100).mean() / dim:.2f}",
                         f"{100 * np.mean(squared < chdtri(dim, 0.05)):.0f} %"])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", help=f"names of logs; default {' '.join(LOGS)}")
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the logs")
    parser.add_argument("--pairs", type=int, default=300, help="of keyframes, of each kind")
    parser.add_argument("--sigma", type=float, help="deviation of a range, metres; by default found in the scans")
    parser.add_argument("--surface", type=float, default=ReturnOptions.sigma_surface,
                        help="deviation of what the returns of a surface share, metres")
    options = parser.parse_args()
    rows = []
    for name in options.logs or LOGS:
        slam, scans = map_of(name, options.data)
        found = robust_deviation(np.concatenate([collinearity_residuals(scan) for scan in scans[::5]]))
        noise = ReturnOptions(sigma_range=options.sigma or found, sigma_surface=options.surface)
        print(f"{name}: range noise found {1000 * found:.1f} mm, used {1000 * noise.sigma_range:.1f} mm", flush=True)
        rows += rows_of(name, slam, scans, options.pairs, noise)
    print_table(["log", "pairs", "features", "to be found", "found again", "normalised error (median)", "(mean)",
                 "inside"], rows)


if __name__ == "__main__":
    main()
