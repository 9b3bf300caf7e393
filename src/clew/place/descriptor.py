"""Appearance of places, whichever way the robot faces: descriptors behind one protocol, and an index of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from clew.scan import ScanPoints, merge_surfels

Array = NDArray[np.float64]
FloatArray = NDArray[np.floating[Any]]


class Descriptor(Protocol):
    """What a place looks like as a row of numbers, and how much alike two places are, whichever way they are turned.

    Likeness lies in [0, 1]: 1 for a place with itself, 0 between any place and one without points.
    """

    @property
    def name(self) -> str:
        """For reports."""
        ...

    def describe(self, clouds: Sequence[ScanPoints]) -> Array:
        """``(N, d)`` descriptors of ``N`` clouds, each about the origin of its frame."""
        ...

    def compare(self, table: FloatArray, one: FloatArray) -> Array:
        """Likeness ``(N,)`` of descriptors ``(N, d)`` with one ``(d,)``."""
        ...


@dataclass(frozen=True)
class TurnedRings:
    """Occupied sectors of rings, laid over each other at the turn that fits best.

    The plane is cut into rings and sectors (Kim & Kim, "Scan Context", IROS 2018); two places are as alike as their
    occupied cells correlate at the best of all turns, found for all at once by the Fourier transform over the sectors,
    which is what the rows hold (real and imaginary parts). Occupied cells count, not points, so that density of the
    beams does not matter.

    Attributes:
        rings, sectors: of the plane.
        reach: radius of the outermost ring, metres.
    """

    rings: int = 12
    sectors: int = 64
    reach: float = 12.0
    name: str = "turned rings"

    def describe(self, clouds: Sequence[ScanPoints]) -> Array:
        """As in `Descriptor`."""
        occupied = _occupied(clouds, self.rings, self.sectors, self.reach)
        cells = _unit(occupied.reshape(len(clouds), self.rings * self.sectors)).reshape(occupied.shape)
        spectrum = np.fft.rfft(cells, axis=2)
        return np.asarray(spectrum.view(np.float64).reshape(len(clouds), 2 * self.rings * (self.sectors // 2 + 1)))

    def compare(self, table: FloatArray, one: FloatArray) -> Array:
        """As in `Descriptor`."""
        shape = (-1, self.rings, self.sectors // 2 + 1, 2)
        parts, other = table.reshape(shape), one.reshape(shape)
        spectra, turned = parts[..., 0] + 1j * parts[..., 1], other[..., 0] - 1j * other[..., 1]
        correlation = np.fft.irfft((spectra * turned).sum(axis=1), n=self.sectors, axis=1)
        return np.asarray(np.clip(correlation.max(axis=1, initial=0.0), 0.0, 1.0), dtype=np.float64)


@dataclass(frozen=True)
class RingSpectra:
    """Occupied sectors of rings, as magnitudes of their Fourier coefficients.

    Rings and sectors are those of `TurnedRings`; what is kept of each ring are the magnitudes of its Fourier
    coefficients over the sectors, which a turn does not change. Vectors of unit length, compared by their cosine.

    Attributes:
        rings, sectors: of the plane.
        reach: radius of the outermost ring, metres.
        harmonics: coefficients that are kept of each ring.
    """

    rings: int = 12
    sectors: int = 64
    reach: float = 12.0
    harmonics: int = 17
    name: str = "ring spectra"

    def describe(self, clouds: Sequence[ScanPoints]) -> Array:
        """As in `Descriptor`."""
        occupied = _occupied(clouds, self.rings, self.sectors, self.reach)
        spectrum = np.abs(np.fft.rfft(occupied, axis=2))[..., : self.harmonics]
        return _unit(spectrum.reshape(len(clouds), self.rings * self.harmonics))

    def compare(self, table: FloatArray, one: FloatArray) -> Array:
        """As in `Descriptor`: the cosine."""
        return np.asarray(table @ one, dtype=np.float64)


@dataclass(frozen=True)
class PairDistances:
    """How far surfaces are from each other, and how they are turned to each other.

    A histogram over all pairs of surfels: their distance, and the angle between their normals (as the histograms of
    pairs of landmarks of Kallasi & Rizzini, "Efficient loop closure based on FALKO lidar features", IROS 2016, with
    surfels for landmarks). Compared by the Bhattacharyya coefficient: the cosine of square roots.

    Attributes:
        reach: surfels further from the origin are left out, metres.
        voxel: side of a surfel, metres.
        distances, angles: bins.
    """

    reach: float = 12.0
    voxel: float = 0.4
    distances: int = 40
    angles: int = 4
    name: str = "pair distances"

    def describe(self, clouds: Sequence[ScanPoints]) -> Array:
        """As in `Descriptor`."""
        return _unit(np.stack([np.zeros(self.distances * self.angles), *map(self._histogram, clouds)])[1:])

    def compare(self, table: FloatArray, one: FloatArray) -> Array:
        """As in `Descriptor`: the cosine."""
        return np.asarray(table @ one, dtype=np.float64)

    def _histogram(self, cloud: ScanPoints) -> Array:
        near = np.hypot(cloud.points[:, 0], cloud.points[:, 1]) < self.reach
        thin = merge_surfels(
            ScanPoints(cloud.points[near], cloud.normals[near], cloud.along[near], cloud.weights[near]), self.voxel
        )
        if len(thin) < 2:
            return np.zeros(self.distances * self.angles)
        apart = pdist(thin.points) / (2 * self.reach) * self.distances
        facing = np.clip(1.0 - 0.5 * pdist(thin.normals, "sqeuclidean"), -1.0, 1.0)
        bins = np.minimum(apart, self.distances - 1).astype(np.int64) * self.angles + np.minimum(
            np.arccos(facing) / np.pi * self.angles, self.angles - 1
        ).astype(np.int64)
        return np.sqrt(np.bincount(bins, minlength=self.distances * self.angles))


class DescriptorIndex:
    """Descriptors of one kind by number of their place, compared all at once."""

    def __init__(self, kind: Descriptor) -> None:
        self._kind = kind
        self._rows: dict[int, int] = {}
        self._table = np.zeros((0, 0), dtype=np.float32)

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, place: int) -> bool:
        return place in self._rows

    def add(self, places: Sequence[int], descriptors: Array) -> None:
        """Take descriptors ``(N, d)`` of new places."""
        count, grown = len(self._rows), len(self._rows) + len(places)
        if grown > len(self._table):
            table = np.zeros((max(2 * len(self._table), grown, 64), descriptors.shape[1]), dtype=np.float32)
            table[:count, : self._table.shape[1]] = self._table[:count]
            self._table = table
        self._table[count:grown] = descriptors
        self._rows.update({int(place): count + i for i, place in enumerate(places)})

    def remove(self, places: Sequence[int]) -> None:
        """Forget places; the last ones move into their rows, so that the table stays as small as it can be."""
        for place in places:
            row = self._rows.pop(int(place))
            last = len(self._rows)
            if row != last:
                self._table[row] = self._table[last]
                self._rows[next(other for other, r in reversed(self._rows.items()) if r == last)] = row

    def similarities(self, places: NDArray[np.int64], descriptor: Array) -> Array:
        """Likeness ``(N,)`` in [0, 1] of known places with a descriptor ``(d,)``."""
        rows = np.array([self._rows[int(place)] for place in places], dtype=np.int64)
        if not len(rows):
            return np.zeros(0)
        return self._kind.compare(self._table[rows], descriptor.astype(np.float32))

    def search(self, descriptor: Array, count: int) -> tuple[NDArray[np.int64], Array]:
        """The places that look most like a descriptor ``(d,)``, at most `count`, with their likeness, best first."""
        places = np.fromiter(self._rows, dtype=np.int64, count=len(self._rows))
        alike = self.similarities(places, descriptor)
        best = np.argsort(-alike, kind="stable")[:count]
        return places[best], alike[best]


def _occupied(clouds: Sequence[ScanPoints], rings: int, sectors: int, reach: float) -> Array:
    """``(N, rings, sectors)``: 1 where a cloud has a point, 0 elsewhere."""
    points = np.concatenate([np.zeros((0, 2)), *(cloud.points for cloud in clouds)])
    owner = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    distance = np.hypot(points[:, 0], points[:, 1])
    inside = (distance < reach) & (distance > 1e-6)
    ring = np.minimum(distance[inside] / reach * rings, rings - 1).astype(np.int64)
    angle = np.arctan2(points[inside, 1], points[inside, 0])
    sector = np.floor((angle + np.pi) / (2 * np.pi) * sectors).astype(np.int64) % sectors
    occupied = np.zeros((len(clouds), rings, sectors))
    occupied[owner[inside], ring, sector] = 1.0
    return occupied


def _unit(descriptors: Array) -> Array:
    """Rows of unit length; a row of zeros stays."""
    norm = np.linalg.norm(descriptors, axis=1, keepdims=True)
    return np.asarray(descriptors / np.where(norm > 0, norm, 1.0), dtype=np.float64)
