"""Descriptors of places."""

from __future__ import annotations

import numpy as np
import pytest

from clew.place import describe, similarity
from clew.place.descriptor import SECTORS
from place.places import CORRIDOR, OTHER, ROOM, points_of


@pytest.mark.parametrize("sectors", [1, 7, 32, 63])
def test_turns_by_whole_sectors_change_nothing(sectors: int) -> None:
    points = points_of(ROOM, np.array([0.3, 0.2, 0.1]), 0).points
    angle = 2 * np.pi * sectors / SECTORS
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert similarity(describe(points @ turn.T), describe(points)) > 0.995  # but for points on a border


def test_any_turn_keeps_more_likeness_than_another_place_has() -> None:
    here = describe(points_of(ROOM, np.zeros(3), 0).points)
    turned = [similarity(here, describe(points_of(ROOM, np.array([0.0, 0.0, a]), 1).points)) for a in (0.5, 1.7, 3.0)]
    beside = similarity(here, describe(points_of(ROOM, np.array([0.4, 0.2, 2.0]), 2).points))
    elsewhere = [similarity(here, describe(points_of(w, np.zeros(3), 3).points)) for w in (OTHER, CORRIDOR)]
    assert min(turned) > 0.95
    assert beside > 0.85
    assert max(elsewhere) < min(beside, *turned)


def test_density_of_the_points_does_not_matter() -> None:
    points = points_of(ROOM, np.zeros(3), 0).points
    np.testing.assert_array_equal(describe(np.repeat(points, 3, axis=0)), describe(points))


def test_descriptors_have_unit_length_and_their_cosine_lies_in_zero_to_one() -> None:
    rng = np.random.default_rng(0)
    many = np.stack([describe(rng.normal(0, 5, (50, 2))) for _ in range(20)])
    np.testing.assert_allclose(np.linalg.norm(many, axis=1), 1.0)
    cosines = similarity(many[:, None], many[None])
    np.testing.assert_allclose(cosines, cosines.T)
    np.testing.assert_allclose(np.diag(cosines), 1.0)
    assert np.all((cosines >= 0) & (cosines <= 1 + 1e-12))


def test_nothing_to_see_is_like_nothing() -> None:
    nothing = describe(np.zeros((0, 2)))
    assert not nothing.any()
    assert not describe(np.array([[0.0, 0.0], [500.0, 0.0]])).any()
    assert similarity(nothing, describe(points_of(ROOM, np.zeros(3), 0).points)) == 0.0
