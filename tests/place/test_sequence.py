"""Matches in a row along a corridor: against enumeration, and against what Gaussians must give."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from clew.place import along_all, blurred, evidence_along, told
from clew.sim.world import box
from place.places import CORRIDOR, points_of, submap_of

OFFSETS = 0.05 * np.arange(-60, 61)


def gaussian(mean: float, variance: float) -> np.ndarray:
    return np.asarray(-0.5 * np.square(OFFSETS - mean) / variance)


def test_probabilities_are_those_of_all_sequences_enumerated() -> None:
    rng = np.random.default_rng(3)
    offsets, evidence, variances = np.arange(-2.0, 3.0), rng.normal(size=(4, 5)), np.array([0.5, 2.0, 1.0])
    steps = [np.exp(-0.5 * np.square(offsets[:, None] - offsets) / v) for v in variances]
    steps = [step / step.sum(axis=1, keepdims=True) for step in steps]
    by_all, by_others = np.zeros((4, 5)), np.zeros((4, 5))
    for way in itertools.product(range(5), repeat=4):
        walk = np.prod([step[a, b] for step, (a, b) in zip(steps, itertools.pairwise(way), strict=True)])
        seen = np.exp(evidence[np.arange(4), way])
        for k, s in enumerate(way):
            by_all[k, s] += walk * seen.prod()
            by_others[k, s] += walk * seen.prod() / seen[k]
    found = along_all(evidence, variances, offsets)
    np.testing.assert_allclose(found[0], by_all / by_all.sum(axis=1, keepdims=True), rtol=1e-9)
    np.testing.assert_allclose(found[1], by_others / by_others.sum(axis=1, keepdims=True), rtol=1e-9)


def test_what_a_match_is_told_to_say_by_itself_is_what_it_said() -> None:
    """Nothing of the others, nor of the way between, may be counted again in the graph."""
    means, variances = [0.3, -0.2, 0.5], [0.09, 0.04, 0.16]
    evidence = np.stack([gaussian(m, v) for m, v in zip(means, variances, strict=True)])
    prior = gaussian(0.0, 1.0)
    for k, (by_all, by_others) in enumerate(zip(*along_all(evidence, [0.05, 0.1], OFFSETS, prior), strict=True)):
        offset, variance = told(by_all, by_others, OFFSETS)
        assert offset == pytest.approx(means[k], abs=0.02)
        assert variance == pytest.approx(variances[k], rel=0.15)


def test_what_is_known_beforehand_is_no_evidence_of_the_first_match() -> None:
    prior = gaussian(0.2, 0.09)
    by_all, by_others = along_all(np.zeros((2, len(OFFSETS))), [0.05], OFFSETS, prior)
    np.testing.assert_allclose(by_all[0], np.exp(prior) / np.exp(prior).sum(), rtol=1e-9)
    assert all(told(a, b, OFFSETS)[1] > 1e6 for a, b in zip(by_all, by_others, strict=True))


def test_a_match_that_says_nothing_is_told_to_say_nothing() -> None:
    evidence = np.stack([gaussian(0.3, 0.04), np.zeros(len(OFFSETS)), gaussian(0.1, 0.04)])
    by_all, by_others = along_all(evidence, [0.1, 0.1], OFFSETS)
    assert told(by_all[1], by_others[1], OFFSETS)[1] > 1e6


def test_blurring_adds_variances() -> None:
    out = np.exp(blurred(gaussian(0.2, 0.04), 0.05, OFFSETS))
    out /= out.sum()
    assert out @ OFFSETS == pytest.approx(0.2, abs=1e-3)
    assert out @ np.square(OFFSETS - 0.2) == pytest.approx(0.09, rel=0.02)


def test_a_cabinet_tells_where_along_the_corridor_and_bare_walls_say_next_to_nothing() -> None:
    T, line, near = np.array([0.4, 0.0, 0.0]), np.array([1.0, 0.0]), OFFSETS[30:91]
    nothing = evidence_along(submap_of(CORRIDOR), points_of(CORRIDOR, T, 9).points, np.zeros(3), line, near)
    assert np.ptp(nothing) < 1.5
    world = np.concatenate([CORRIDOR, box(3.0, -1.2, 3.6, -1.0)])
    evidence = evidence_along(submap_of(world), points_of(world, T, 9).points, np.zeros(3), line, near)
    assert near[np.argmax(evidence)] == pytest.approx(0.4, abs=0.16)
    assert np.all(evidence[np.abs(near - 0.4) > 0.8] < evidence.max() - 2.5)


def test_what_the_submap_has_not_seen_has_no_say() -> None:
    """Returns of a query far beyond it fit nowhere, and would draw the query back to where more of it overlaps."""
    submap = submap_of(CORRIDOR)
    beyond = np.column_stack([np.linspace(22.0, 60.0, 200), np.full(200, 1.2)])
    inside = points_of(CORRIDOR, np.zeros(3), 9).points
    alone, both = (evidence_along(submap, points, np.zeros(3), np.array([1.0, 0.0]), OFFSETS)
                   for points in (inside, np.concatenate([inside, beyond])))
    np.testing.assert_array_equal(alone, both)
    assert not evidence_along(submap, beyond, np.zeros(3), np.array([1.0, 0.0]), OFFSETS).any()
