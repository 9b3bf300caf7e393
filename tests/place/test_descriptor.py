"""Descriptors of places, of every kind, and the index of them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.place import Descriptor, DescriptorIndex, PairDistances, RingSpectra, TurnedRings
from clew.scan import ScanPoints
from place.places import CORRIDOR, OTHER, ROOM, points_of

Array = NDArray[np.float64]
KINDS: list[Descriptor] = [TurnedRings(), RingSpectra(), PairDistances()]
kinds = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)


def view(segments: Array, x: float = 0.0, y: float = 0.0, theta: float = 0.0, seed: int = 0) -> ScanPoints:
    return points_of(segments, np.array([x, y, theta]), seed)


def cloud(points: Array) -> ScanPoints:
    count = len(points)
    return ScanPoints(points, np.tile([1.0, 0.0], (count, 1)), np.zeros(count), np.ones(count))


@pytest.mark.parametrize("sectors", [1, 7, 32, 63])
@pytest.mark.parametrize("kind", [TurnedRings(), RingSpectra()], ids=lambda kind: kind.name)
def test_turns_by_whole_sectors_change_nothing(kind: TurnedRings | RingSpectra, sectors: int) -> None:
    points = view(ROOM, 0.3, 0.2, 0.1)
    turned = points.transformed(np.array([0.0, 0.0, 2 * np.pi * sectors / kind.sectors]))
    one, other = kind.describe([points, turned])
    assert kind.compare(one[None], other)[0] > 0.98  # but for points on a border


@kinds
def test_any_turn_keeps_more_likeness_than_another_place_has(kind: Descriptor) -> None:
    here, *others = kind.describe([
        view(ROOM), *(view(ROOM, theta=a, seed=1) for a in (0.5, 1.7, 3.0)), view(ROOM, 0.4, 0.2, 2.0, seed=2),
        view(OTHER, seed=3), view(CORRIDOR, seed=3)])
    likeness = kind.compare(np.array(others), here)
    assert likeness[:3].min() > 0.9
    assert likeness[3] > 0.6
    assert likeness[4:].max() < likeness[:4].min()


@kinds
def test_a_batch_is_its_clouds_one_by_one(kind: Descriptor) -> None:
    clouds = [view(ROOM), cloud(np.zeros((0, 2))), view(OTHER), view(CORRIDOR, theta=1.0)]
    batch = kind.describe(clouds)
    np.testing.assert_allclose(batch, np.concatenate([kind.describe([c]) for c in clouds]))
    assert kind.describe([]).shape == (0, batch.shape[1])


def test_density_of_the_points_does_not_matter() -> None:
    points = view(ROOM).points
    one, other = RingSpectra().describe([cloud(np.repeat(points, 3, axis=0)), cloud(points)])
    np.testing.assert_array_equal(one, other)


@kinds
def test_likeness_is_mutual_and_lies_in_zero_to_one(kind: Descriptor) -> None:
    rng = np.random.default_rng(0)
    many = kind.describe([cloud(rng.normal(0, 5, (50, 2))) for _ in range(20)])
    likeness = np.stack([kind.compare(many, one) for one in many])
    np.testing.assert_allclose(likeness, likeness.T)
    np.testing.assert_allclose(np.diag(likeness), 1.0)
    assert np.all((likeness >= 0) & (likeness <= 1 + 1e-12))


@kinds
def test_nothing_to_see_is_like_nothing(kind: Descriptor) -> None:
    descriptors = kind.describe([cloud(np.zeros((0, 2))), cloud(np.array([[500.0, 0.0], [500.0, 1.0]])), view(ROOM)])
    likeness = kind.compare(descriptors, descriptors[2])
    np.testing.assert_array_equal(likeness[:2], 0.0)
    assert likeness[2] == pytest.approx(1.0)


def test_the_best_turn_is_found_as_by_trying_all() -> None:
    """Against the plain definition: cells of one place rolled by every number of sectors over those of the other."""
    kind = TurnedRings()
    clouds = [view(ROOM, 0.3, 0.1, 0.4), view(OTHER, theta=2.0)]
    cells = []
    for points in (c.points for c in clouds):
        distance, angle = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
        grid = np.zeros((kind.rings, kind.sectors))
        for r, a in zip(distance, angle, strict=True):
            if r < kind.reach:
                grid[int(r / kind.reach * kind.rings), int((a + np.pi) / (2 * np.pi) * kind.sectors) % kind.sectors] = 1
        cells.append(grid / np.linalg.norm(grid))
    best = max(float((cells[0] * np.roll(cells[1], k, axis=1)).sum()) for k in range(kind.sectors))
    described = kind.describe(clouds)
    assert kind.compare(described[:1], described[1])[0] == pytest.approx(best)


def test_the_index_finds_what_comparing_with_each_finds() -> None:
    rng = np.random.default_rng(1)
    table = np.abs(rng.normal(size=(150, 12)))
    table /= np.linalg.norm(table, axis=1, keepdims=True)
    places = rng.permutation(1000)[:150]
    index = DescriptorIndex(RingSpectra())
    for part in np.split(np.arange(150), [1, 70, 100]):
        index.add(places[part].tolist(), table[part])
    asked = table[17]
    assert len(index) == 150
    assert int(places[3]) in index
    assert 1000 not in index
    order = np.argsort(-(table @ asked))[:10]
    found, cosines = index.search(asked, 10)
    np.testing.assert_array_equal(found, places[order])
    np.testing.assert_allclose(cosines, (table @ asked)[order], atol=1e-6)
    np.testing.assert_allclose(index.similarities(places[[5, 2]], asked), table[[5, 2]] @ asked, atol=1e-6)
    assert index.similarities(np.zeros(0, np.int64), asked).shape == (0,)
    assert len(DescriptorIndex(RingSpectra()).search(asked, 3)[0]) == 0


def test_the_index_forgets_places_and_takes_others_in_their_rows() -> None:
    rng = np.random.default_rng(2)
    table = np.abs(rng.normal(size=(30, 5)))
    index = DescriptorIndex(RingSpectra())
    index.add(range(20), table[:20])
    index.remove([0, 19, 7, 8])
    assert len(index) == 16
    assert 7 not in index
    index.add(range(20, 30), table[20:])
    left = np.array([k for k in range(30) if k not in (0, 7, 8, 19)])
    np.testing.assert_allclose(index.similarities(left, table[3]), table[left] @ table[3], rtol=1e-6)
    assert set(index.search(table[3], 100)[0].tolist()) == set(left.tolist())
