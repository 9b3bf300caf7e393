"""Plain NumPy twins of the native kernels, written for reading."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.scan import ScanPoints

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
