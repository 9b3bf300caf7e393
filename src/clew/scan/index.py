"""Clouds of points with an index for nearest-neighbour search, one or many at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.scan.points import ScanPoints, concatenate

Array = NDArray[np.float64]

CELL = 0.25  # metres; least side of a bucket, about the radius of the search
CELLS_PER_POINT = 8.0  # at most; the buckets of a sparse cloud are larger


@dataclass(frozen=True)
class IndexedClouds:
    """``C`` clouds one after the other, each in its own frame, their points sorted into buckets.

    Attributes:
        cloud: all points; those of cloud ``i`` are ``offsets[i] : offsets[i + 1]``.
        offsets: ``(C + 1,)``.
        starts, starts_offsets, entries, origins, shapes, cells: the buckets, as the native search reads them; `entries`
            ``(n, 5)`` are the points once more, bucket by bucket, with normals and `along`.
    """

    cloud: ScanPoints
    offsets: NDArray[np.int64]
    starts: NDArray[np.int32]
    starts_offsets: NDArray[np.int64]
    entries: Array
    origins: Array
    shapes: NDArray[np.int32]
    cells: Array

    def as_sources(self) -> SourceClouds:
        """The same clouds, to be moved."""
        return SourceClouds(self.cloud, self.offsets)


@dataclass(frozen=True)
class SourceClouds:
    """Clouds that are moved onto others, one after the other; cloud ``i`` is ``offsets[i] : offsets[i + 1]``."""

    cloud: ScanPoints
    offsets: NDArray[np.int64]

    @staticmethod
    def single(cloud: ScanPoints) -> SourceClouds:
        """A batch of one cloud."""
        return SourceClouds(cloud, np.array([0, len(cloud)], dtype=np.int64))

    def moments(self) -> Array:
        """Weighted means ``(C, 3)`` of x, y and the squared distance of each cloud's points, metres; zero of none."""
        w, (x, y) = self.cloud.weights, self.cloud.points.T
        sums = np.concatenate([np.zeros((1, 4)), np.cumsum(np.stack([w, w * x, w * y, w * (x**2 + y**2)], 1), axis=0)])
        total = np.diff(sums[self.offsets], axis=0)
        return np.asarray(total[:, 1:] / np.maximum(total[:, :1], 1e-12))


def index_cloud(cloud: ScanPoints) -> IndexedClouds:
    """One cloud with its index."""
    n = len(cloud)
    low = cloud.points.min(axis=0) if n else np.zeros(2)
    high = cloud.points.max(axis=0) if n else np.zeros(2)
    cell = max(CELL, float(np.sqrt(np.prod(high - low) / (CELLS_PER_POINT * max(n, 1)))))
    shape = np.floor((high - low) / cell).astype(np.int32) + 1
    starts, entries = _native.scan.sort_into_buckets(
        cloud.points, cloud.normals, cloud.along, float(low[0]), float(low[1]), cell, int(shape[0]), int(shape[1])
    )
    return IndexedClouds(
        cloud,
        np.array([0, n], dtype=np.int64),
        starts,
        np.array([0, starts.shape[0]], dtype=np.int64),
        entries,
        low[None, :],
        shape[None, :],
        np.array([cell]),
    )


def join(indexed: list[IndexedClouds]) -> IndexedClouds:
    """Several indexed clouds as one batch."""

    def offsets(parts: list[NDArray[np.int64]]) -> NDArray[np.int64]:
        lengths = np.concatenate([np.diff(p) for p in parts])
        return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)

    return IndexedClouds(
        concatenate([i.cloud for i in indexed]),
        offsets([i.offsets for i in indexed]),
        np.concatenate([i.starts for i in indexed]),
        offsets([i.starts_offsets for i in indexed]),
        np.concatenate([i.entries for i in indexed]),
        np.concatenate([i.origins for i in indexed]),
        np.concatenate([i.shapes for i in indexed]),
        np.concatenate([i.cells for i in indexed]),
    )


def merge_surfels(cloud: ScanPoints, voxel: float) -> ScanPoints:
    """Points of several scans that lie in one square and face the same way, averaged to one.

    Averaging takes the noise of single returns out of the surface; `weights` are kept at one.
    """
    points, normals, along = _native.scan.merge_surfels(cloud.points, cloud.normals, cloud.along, cloud.weights, voxel)
    return ScanPoints(points, normals, along, np.ones(len(along)))
