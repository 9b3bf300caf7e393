"""Plain NumPy twins of the native kernels, written for reading."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.scan import CleaningOptions, LaserScan, ScanPoints

Array = NDArray[np.float64]


def line_of(points: Array) -> tuple[Array, float, float]:
    """Normal, deviation along and deviation across of points, by the eigenvectors of their covariance."""
    values, vectors = np.linalg.eigh(np.cov(points.T, bias=True))
    across, along = np.sqrt(np.maximum(values, 0.0))
    return vectors[:, 0], along, across


def _side(points: Array, beams: Array, i: int, step: int, window: int, radius: float, gap: float) -> int:
    last = i
    for k in range(1, window + 1):
        j = i + step * k
        if not 0 <= j < len(points) or abs(beams[j] - beams[last]) > 2:
            break
        if np.linalg.norm(points[j] - points[last]) > gap:
            break
        if k > 2 and np.linalg.norm(points[j] - points[i]) > radius:
            break
        last = j
    return last


def surface_normals(points: Array, beams: Array, window: int, radius: float, base: float,
                    per_metre: float) -> tuple[Array, Array, Array]:
    """Normals towards the sensor, ratio of deviations, number of neighbours."""
    normals, ratios, support = np.zeros_like(points), np.zeros(len(points)), np.zeros(len(points), dtype=np.int32)
    for i, point in enumerate(points):
        gap = base + per_metre * float(np.linalg.norm(point))
        first, last = (_side(points, beams, i, step, window, radius, gap) for step in (-1, 1))
        support[i] = last - first
        if first == last:
            ratios[i] = 1.0
            continue
        best = line_of(points[first : last + 1])
        limit = 0.6 * best[2]
        for a, b in ((first, i), (i, last)):
            if last - first >= 2 and b - a >= 3:
                side = line_of(points[a : b + 1])
                if side[2] < min(limit, best[2]):
                    best = side
        normals[i] = best[0] if best[0] @ point <= 0 else -best[0]
        ratios[i] = best[2] / best[1] if best[1] > 0 else 1.0
    return normals, ratios, support


def extracted(scan: LaserScan, options: CleaningOptions, window: int) -> tuple[ScanPoints, NDArray[np.int64]]:
    """Returns of a scan with normals in the robot's frame, and their beams."""
    limit = min(scan.range_max, options.range_limit)
    beams = np.flatnonzero((scan.ranges >= scan.range_min) & (scan.ranges <= limit))
    r, angles = scan.ranges[beams], scan.angles[beams]
    points = r[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    normals, ratios, support = surface_normals(points, beams, window, options.radius, options.gap_base,
                                               options.gap_per_metre)
    keep = support > 0
    weights = np.clip(r * abs(scan.angle_increment) / options.spacing, 0.1, 1.0)
    along = np.where(ratios > options.blob, ratios, 0.0)
    cloud = ScanPoints(points[keep], normals[keep], along[keep], weights[keep])
    return cloud.transformed(scan.T_robot_sensor), beams[keep]


def between_returns(cloud: ScanPoints, options: CleaningOptions, flat: float, share_of_weight: float) -> ScanPoints:
    """Points between neighbouring returns on one straight wall."""
    rows: list[tuple[Array, Array, float]] = []
    for i in range(len(cloud) - 1):
        a, b = cloud.points[i], cloud.points[i + 1]
        n, m = cloud.normals[i], cloud.normals[i + 1]
        length = float(np.linalg.norm(b - a))
        if not options.filling < length <= options.gap_base + options.gap_per_metre * np.linalg.norm(a):
            continue
        if max(abs((b - a) @ n), abs((b - a) @ m)) > flat * length or n @ m <= 0:
            continue
        for share in np.linspace(0.0, 1.0, int(np.ceil(length / options.filling)) + 1)[1:-1]:
            normal = (1 - share) * n + share * m
            rows.append((a + share * (b - a), normal / np.linalg.norm(normal), share_of_weight * cloud.weights[i]))
    points, normals, weights = (np.array([row[k] for row in rows]) for k in range(3))
    return ScanPoints(points.reshape(-1, 2), normals.reshape(-1, 2), np.zeros(len(rows)), weights)


def merged(cloud: ScanPoints, voxel: float) -> ScanPoints:
    """Weighted means of the points that share a square and a quadrant of the normal, in order of first appearance."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for i, (point, normal) in enumerate(zip(cloud.points, cloud.normals, strict=True)):
        key = (*(int(c) for c in np.floor(point / voxel)), *(int(v > 0) for v in normal))
        groups.setdefault(key, []).append(i)
    means = [[np.average(values[rows], axis=0, weights=cloud.weights[rows])
              for values in (cloud.points, cloud.normals, cloud.along)] for rows in groups.values()]
    points, normals, along = (np.array([row[k] for row in means]) for k in range(3))
    return ScanPoints(points, normals / np.linalg.norm(normals, axis=1, keepdims=True), along, np.ones(len(groups)))


def deskewed(scan: LaserScan, velocity: Array) -> tuple[Array, Array]:
    """Ranges and directions seen from where the sensor was at the timestamp, through the poses at each beam."""
    sensor = se2.compose(se2.exp(scan.delays[:, None] * velocity), scan.T_robot_sensor)
    ends = scan.ranges[:, None] * np.stack([np.cos(scan.angles), np.sin(scan.angles)], axis=1)
    x, y = se2.act(se2.inverse(scan.T_robot_sensor), se2.act(sensor, ends)).T
    return np.hypot(x, y), np.arctan2(y, x)


def pyramid(points: Array, sigma: float, levels: int, shape: tuple[int, int], origin: Array,
            resolution: float) -> NDArray[np.uint8]:
    """Blur about each point, its place rounded to the middle of a quarter cell; then maxima over squares."""
    height, width = shape
    reach = int(np.ceil(2.5 * sigma / resolution))
    cells = np.zeros((levels, height, width), dtype=np.uint8)
    for g in (points - origin) / resolution:
        if np.any(g < reach) or g[0] >= width - reach or g[1] >= height - reach:
            continue
        x, y = np.floor(g).astype(int)
        middle = (np.floor(4 * (g - [x, y])) + 0.5) / 4 - 0.5
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                squared = ((dx - middle[0]) ** 2 + (dy - middle[1]) ** 2) * resolution**2
                value = np.uint8(np.floor(255 * np.exp(-0.5 * squared / sigma**2) + 0.5))
                cells[0, y + dy, x + dx] = max(cells[0, y + dy, x + dx], value)
    for level in range(1, levels):
        for y in range(height):
            for x in range(width):
                cells[level, y, x] = cells[0, y : y + 2**level, x : x + 2**level].max()
    return cells


def scores(cells: NDArray[np.uint8], origin: Array, resolution: float, points: Array, centre: Array, half: Array,
           step_theta: float, prior: Array | None = None, weight: float = 0.0) -> tuple[Array, Array, Array]:
    """Poses ``(H, 3)`` of the whole window with their likelihoods and scores ``(H,)``."""
    steps = [int(np.ceil(h / s - 1e-9)) for h, s in zip(half, (resolution, resolution, step_theta), strict=True)]
    poses, likelihoods, values = [], [], []
    for k in range(-steps[2], steps[2] + 1):
        turned = se2.act(centre + np.array([0, 0, k * step_theta]), points)
        at = np.floor((turned - origin) / resolution).astype(int)
        for y in range(-steps[1], steps[1] + 1):
            for x in range(-steps[0], steps[0] + 1):
                cell = at + np.array([x, y])
                inside = np.all((cell >= 0) & (cell < cells.shape[:0:-1]), axis=1)
                likelihood = cells[0, cell[inside, 1], cell[inside, 0]].sum(dtype=np.int64) / (255 * max(len(at), 1))
                offset = np.array([x * resolution, y * resolution, k * step_theta])
                cost = 0.0 if prior is None else weight * np.log1p(0.5 * np.sum((offset / prior) ** 2))
                poses.append(centre + offset)
                likelihoods.append(likelihood)
                values.append(likelihood - cost)
    return np.array(poses), np.array(likelihoods), np.array(values)


def partners(target: ScanPoints, source: ScanPoints, pose: Array, radius: float, facing: float) -> NDArray[Any]:
    """Nearest target point of each source point that faces its way, -1 for none; every point against every other."""
    moved = source.transformed(pose)
    if not len(target) or not len(source):
        return np.full(len(source), -1)
    distance = np.linalg.norm(moved.points[:, None] - target.points, axis=2)
    distance[moved.normals @ target.normals.T < facing] = np.inf
    nearest = np.argmin(distance, axis=1)
    return np.where(distance[np.arange(len(source)), nearest] < radius, nearest, -1)


def residuals(target: ScanPoints, source: ScanPoints, pose: Array, partner: NDArray[Any]) -> tuple[Array, Array]:
    """Distances along and across the normals ``(n,)`` of points to fixed partners."""
    d = source.transformed(pose).points - target.points[partner]
    n = target.normals[partner]
    return np.sum(n * d, axis=1), -n[:, 1] * d[:, 0] + n[:, 0] * d[:, 1]
