"""Bridges against the definition, cuts of a path by counting, slip on a drive with a known fault."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from clew.evaluate import bridges, odometry_slip, path_cuts, stretches
from clew.factors import Between, PointObservation
from clew.geometry import SE2, se2
from clew.graph import FactorGraph, Role


def parts(count: int, pairs: np.ndarray) -> int:
    return int(connected_components(coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count)),
                                    directed=False)[0])


@settings(deadline=None, max_examples=80)
@given(st.integers(1, 9).flatmap(lambda n: st.tuples(
    st.just(n), st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=14))))
def test_an_edge_is_a_bridge_if_the_graph_falls_apart_without_it(case: tuple[int, list[tuple[int, int]]]) -> None:
    count, edges = case
    pairs = np.array(edges, dtype=np.int64).reshape(-1, 2)
    expected = [parts(count, np.delete(pairs, row, axis=0)) > parts(count, pairs) for row in range(len(pairs))]
    np.testing.assert_array_equal(bridges(count, pairs), expected)


def test_cuts_of_a_path() -> None:
    graph = FactorGraph()
    keys = np.array([10, 11, 12, 13])
    graph.add_pose(SE2(np.arange(4.0), np.zeros(4), np.zeros(4)), key=keys)
    step = SE2(np.ones(3), np.zeros(3), np.zeros(3))
    graph.add(Between(keys[:-1], keys[1:], step, sigmas=0.5))
    graph.add(Between(13, 11, SE2(-2.0, 0.0, 0.0), sigmas=1.0, role=Role.LOOP))
    cuts = path_cuts(graph, keys)
    np.testing.assert_array_equal(cuts.edges, [1, 2, 2])
    np.testing.assert_allclose(cuts.information, [4.0, 5.0, 5.0])
    backwards = path_cuts(graph, keys[::-1].copy())
    np.testing.assert_array_equal(backwards.edges, [2, 2, 1])
    assert len(path_cuts(graph, keys[:0]).edges) == 0


def test_a_landmark_seen_on_both_sides_of_a_step_ties_it() -> None:
    graph = FactorGraph()
    keys = np.arange(5)
    graph.add_pose(SE2(np.arange(5.0), np.zeros(5), np.zeros(5)), key=keys)
    graph.add(Between(keys[:-1], keys[1:], SE2(np.ones(4), np.zeros(4), np.zeros(4)), sigmas=1.0))
    graph.add_point(np.array([2.0, 1.0]), key=9)
    graph.add_point(np.array([4.0, 1.0]), key=10)
    for pose, sigma in ((3, 1.0), (0, 0.5), (1, 1.0)):  # out of order
        graph.add(PointObservation(pose, 9, np.array([2.0 - pose, 1.0]), sigmas=sigma))
    graph.add(PointObservation(4, 10, np.array([0.0, 1.0]), sigmas=1.0))  # seen once, ties nothing
    cuts = path_cuts(graph, keys)
    np.testing.assert_array_equal(cuts.edges, [2, 2, 2, 1])
    # 4 before and 2 after, then 5 before and 1 after, in series: 4 * 2 / 6 and 5 * 1 / 6.
    np.testing.assert_allclose(cuts.information, 1.0 + np.array([8 / 6, 5 / 6, 5 / 6, 0.0]))


def test_stretches() -> None:
    np.testing.assert_array_equal(stretches(np.array([1, 1, 0, 1, 0], bool)), [[0, 1], [3, 3]])
    assert stretches(np.zeros(0, bool)).shape == (0, 2)


def test_wheels_that_spin_for_a_second() -> None:
    times = np.arange(0.0, 60.0, 0.1)
    estimate = np.column_stack([0.5 * times, np.zeros_like(times), np.zeros_like(times)])
    spun = np.clip(times - 30.0, 0.0, 1.0)  # a metre that the robot did not move
    odometry = estimate + np.column_stack([spun, 0 * spun, 0 * spun])
    turned = se2.compose(np.array([3.0, 4.0, 1.0]), odometry)  # the frames differ
    slip = odometry_slip(times, turned, estimate)
    assert len(slip.events) == 1
    assert 27.5 <= slip.events[0, 0] <= 30.0
    assert 31.0 <= slip.events[0, 1] <= 33.5
    np.testing.assert_allclose(slip.sizes[0], [1.0, 0.0], atol=1e-9)
    assert len(odometry_slip(times, estimate, estimate).events) == 0
    assert len(odometry_slip(times[:1], estimate[:1], estimate[:1]).events) == 0
