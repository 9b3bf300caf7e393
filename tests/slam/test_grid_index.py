"""The index of keyframes against going through all of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from clew.slam.grid_index import GridIndex

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def even(numbers: Index) -> NDArray[np.bool_]:
    return numbers % 2 == 0


class Plain:
    """The same by brute force."""

    def __init__(self) -> None:
        self.points: dict[int, Array] = {}

    def within(self, point: Array, radius: float) -> list[int]:
        return sorted(k for k, p in self.points.items() if np.hypot(*(p - point)) <= radius)

    def nearest(self, point: Array, count: int) -> list[float]:
        return sorted(float(np.hypot(*(p - point))) for k, p in self.points.items() if k % 2 == 0)[:count]


@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([0.5, 4.0, 100.0]), rounds=st.integers(1, 6))
def test_it_answers_as_a_look_at_all_points_after_adding_moving_and_removing(
    seed: int, size: float, rounds: int
) -> None:
    rng = np.random.default_rng(seed)
    index, plain = GridIndex(4.0), Plain()
    for _ in range(rounds):
        numbers = rng.choice(60, size=rng.integers(1, 40), replace=False)
        points = rng.normal(0.0, size, (len(numbers), 2))
        index.put(numbers, points)
        plain.points.update(zip(numbers.tolist(), points, strict=True))
        gone = rng.choice(80, size=rng.integers(0, 20), replace=False)
        index.remove(gone)
        for number in gone.tolist():
            plain.points.pop(number, None)
        assert len(index) == len(plain.points)
        point = rng.normal(0.0, size, 2)
        radius = float(rng.exponential(size))
        assert index.within(point, radius).tolist() == plain.within(point, radius)
        count = int(rng.integers(1, 15))
        nearest = index.nearest(point, count, even)
        assert (nearest % 2 == 0).all()
        distances = [float(np.hypot(*(plain.points[k] - point))) for k in nearest.tolist()]
        assert distances == pytest.approx(plain.nearest(point, count), abs=1e-12)


def test_an_empty_one_has_nothing_near() -> None:
    index = GridIndex(1.0)
    assert len(index.within(np.zeros(2), 10.0)) == 0
    assert len(index.nearest(np.zeros(2), 3, even)) == 0
    index.remove(np.array([4]))
    assert len(index) == 0


def test_points_far_from_what_is_asked_cost_nothing() -> None:
    index = GridIndex(1.0)
    index.put(np.arange(10_000), np.stack([np.arange(10_000.0), np.zeros(10_000)], axis=1))
    asked: list[int] = []

    def accept(numbers: Index) -> NDArray[np.bool_]:
        asked.append(len(numbers))
        return np.ones(len(numbers), dtype=np.bool_)

    assert index.nearest(np.array([5000.1, 0.2]), 3, accept).tolist() == [5000, 5001, 4999]
    assert sum(asked) < 20
