"""Do closures agree: the loop through both must close."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place import Closure, ConsistencyOptions, Verdict, agree

Array = NDArray[np.float64]
OPTIONS = ConsistencyOptions()
pose = st.tuples(*[st.floats(-20, 20)] * 2, st.floats(-np.pi, np.pi)).map(np.array)


def closure(T_target_source: Array) -> Closure:
    return Closure(9, 1, 1.0, Verdict.WAITING, T_target_source, np.eye(3))


def loop(a_target: Array, b_target: Array, a_source: Array, b_source: Array) -> tuple[Closure, Closure, Array, Array]:
    """Two exact closures between four poses in one frame, and the motions between their ends."""
    return (closure(se2.between(a_target, a_source)), closure(se2.between(b_target, b_source)),
            se2.between(a_source, b_source), se2.between(a_target, b_target))


@given(pose, pose, pose, pose)
def test_an_exact_loop_agrees(a: Array, b: Array, c: Array, d: Array) -> None:
    assert agree(*loop(a, b, c, d), 0.0, OPTIONS)


@given(pose, pose, pose, pose, st.sampled_from([(0.16, 0, 0), (0, -0.16, 0), (0, 0, 0.041), (3, 2, 1), (0, 0, 3.1)]))
def test_a_loop_that_misses_by_more_than_the_tolerance_does_not(a: Array, b: Array, c: Array, d: Array,
                                                                miss: tuple[float, ...]) -> None:
    first, second, T_source, T_target = loop(a, b, c, d)
    wrong = replace(second, T_target_source=se2.compose(second.T_target_source, np.array(miss)))
    assert not agree(first, wrong, T_source, T_target, 0.0, OPTIONS)
    assert not agree(wrong, first, se2.inverse(T_source), se2.inverse(T_target), 0.0, OPTIONS)


@pytest.mark.parametrize("miss", [0.5, 0.95, 1.05, 2.0])
def test_tolerance_grows_with_the_path(miss: float) -> None:
    path = 40.0
    first, second, T_source, T_target = loop(*np.random.default_rng(0).uniform(-3, 3, (4, 3)))
    for error in (np.array([miss * (0.15 + 0.02 * path), 0.0, 0.0]), np.array([0, 0, miss * (0.04 + 0.005 * path)])):
        wrong = replace(second, T_target_source=se2.compose(second.T_target_source, error))
        assert agree(first, wrong, T_source, T_target, path, OPTIONS) == (miss < 1)


@given(pose, pose, pose, pose, st.floats(0, 0.3), st.floats(-np.pi, np.pi))
def test_agreement_is_mutual(a: Array, b: Array, c: Array, d: Array, miss: float, direction: float) -> None:
    """Where the angle is right; the loop of the other order then misses by as much."""
    first, second, T_source, T_target = loop(a, b, c, d)
    error = np.array([miss * np.cos(direction), miss * np.sin(direction), 0.0])
    wrong = replace(second, T_target_source=se2.compose(second.T_target_source, error))
    if abs(miss - 0.15) > 1e-6:
        there = agree(first, wrong, T_source, T_target, 0.0, OPTIONS)
        back = agree(wrong, first, se2.inverse(T_source), se2.inverse(T_target), 0.0, OPTIONS)
        assert there == back == (miss < 0.15)


@pytest.mark.parametrize(("along", "across", "agrees"), [(0.0, 0.0, True), (0.9, 0.0, True), (1.2, 0.0, False),
                                                        (0.0, 0.2, False), (0.9, 0.2, False)])
def test_along_a_bare_corridor_two_agree_as_well_as_the_way_between_them_is_known(along: float, across: float,
                                                                               agrees: bool) -> None:
    first, second, T_source, T_target = loop(*np.random.default_rng(2).uniform(-3, 3, (4, 3)))
    # The corridor runs along x of the second source, half a metre uncertain.
    wrong = replace(second, T_target_source=se2.compose(second.T_target_source, np.array([along, across, 0.0])))
    covariance = np.diag([0.5**2, 0.0, 0.0])
    assert agree(first, wrong, T_source, T_target, 0.0, OPTIONS, covariance) == agrees


def test_headings_agree_as_well_as_they_are_known() -> None:
    first, second, T_source, T_target = loop(*np.zeros((4, 3)))
    wrong = replace(second, T_target_source=np.array([0.0, 0.0, 0.1]))
    assert not agree(first, wrong, T_source, T_target, 0.0, OPTIONS)
    assert agree(first, wrong, T_source, T_target, 0.0, OPTIONS, np.diag([0.0, 0.0, 0.05**2]))
