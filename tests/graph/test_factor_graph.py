"""The factor graph: adding, looking up, editing, and keeping factors of one kind together."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import clew
from clew.errors import InputError
from clew.graph import FactorGraph, Role

SIGMAS = (0.1, 0.1, 0.02)


def step(a: object, b: object, **options: object) -> clew.Between:
    return clew.Between(a, b, clew.SE2(1, 0, 0), sigmas=SIGMAS, **options)


def chain(count: int) -> FactorGraph:
    graph = FactorGraph()
    keys = graph.add_pose(clew.SE2.from_array([(i, 0, 0) for i in range(count)]))
    graph.add(step(keys[:-1], keys[1:]))
    return graph


def test_keys_count_up_and_values_come_back_as_they_went_in() -> None:
    graph = FactorGraph()
    a = graph.add_pose(clew.SE2(1, 2, 3))
    batch = graph.add_pose(clew.SE2.from_array([(4, 5, 0), (6, 7, 0)]))
    tree = graph.add_point((8, 9))
    rocks = graph.add_point([(1, 2, 3), (4, 5, 6)])
    assert (a, batch.tolist(), tree, rocks.tolist()) == (0, [1, 2], 3, [4, 5])
    assert np.array_equal(graph.value(2).array, (6, 7, 0))
    assert isinstance(graph.value(tree), clew.Point2)
    assert isinstance(graph.value(5), clew.Point3)
    assert graph.kind(0) is clew.SE2
    assert graph.kinds == (clew.SE2, clew.Point2, clew.Point3)
    assert graph.keys().tolist() == [0, 1, 2, 3, 4, 5]
    assert graph.keys(clew.Point3).tolist() == [4, 5]
    assert np.array_equal(graph.values([2, 0]).array, [(6, 7, 0), (1, 2, 3)])
    assert np.array_equal(graph.values(clew.Point3).array, [(1, 2, 3), (4, 5, 6)])
    assert len(graph) == 6
    assert 5 in graph
    assert 6 not in graph


def test_own_keys_of_any_size_and_order() -> None:
    graph = FactorGraph()
    big = 8646911284551352615
    graph.add_pose(clew.SE2.from_array([(0, 0, 0), (1, 0, 0), (2, 0, 0)]), key=[7, big, -3])
    graph.add(step([7, big] * 20, [big, -3] * 20))  # more than a handful: the sorted look-up
    graph.add(step(-3, 7))
    graph.add_pose(clew.SE2(3, 0, 0), key=40)  # after a batch look-up
    graph.add(step([40] * 20, [big] * 20))
    assert graph.value(big).array[0] == 1
    assert graph.positions([-3, 7]).tolist() == [2, 0]
    assert graph.add_pose(clew.SE2(0, 0, 0)) == big + 1
    with pytest.raises(InputError, match="key 7 is in use"):
        graph.add_pose(clew.SE2(0, 0, 0), key=7)
    with pytest.raises(InputError, match="key 9 occurs twice"):
        graph.add_pose(clew.SE2.identity((2,)), key=[9, 9])


def test_singles_of_one_kind_share_a_block() -> None:
    graph = FactorGraph()
    keys = [graph.add_pose(clew.SE2(i, 0, 0)) for i in range(200)]
    for a, b in pairwise(keys):
        graph.add(step(a, b))
    graph.add(step(0, 50, role="loop"))
    graph.add(step(0, 60, role="loop", kernel=clew.Huber(1.0)))
    graph.add(step(0, 70, role="loop", kernel=clew.Huber(1.0)))
    graph.add(step(0, 80, role="loop", kernel=clew.Huber(2.0)))
    assert [len(block) for block in graph.blocks()] == [199, 1, 2, 1]
    assert [len(block) for block in graph.blocks(Role.LOOP)] == [1, 2, 1]
    first = next(graph.blocks())
    assert isinstance(first, clew.Between)
    assert np.array_equal(first.keys, np.stack([keys[:-1], keys[1:]], axis=1))
    assert not first.measurement.flags.writeable
    assert graph.counts == {"SE2": 200, "odometry": 199, "loop": 4}


def test_sensors_in_different_places_keep_their_own_blocks() -> None:
    graph = FactorGraph()
    pose, tree = graph.add_pose(clew.SE2(0, 0, 0)), graph.add_point((1, 1))
    for place in (None, clew.SE2(1, 0, 0), clew.SE2(1, 0, 0), clew.SE2(2, 0, 0)):
        graph.add(clew.PointObservation(pose, tree, (1, 1), sigmas=0.1, T_robot_sensor=place))
    assert [len(block) for block in graph.blocks()] == [1, 2, 1]


def test_factors_are_checked_against_their_variables() -> None:
    graph = FactorGraph()
    pose, tree = graph.add_pose(clew.SE2(0, 0, 0)), graph.add_point((1, 1))
    with pytest.raises(InputError, match="unknown key 5"):
        graph.add(step(pose, 5))
    with pytest.raises(InputError, match="unknown key 5"):
        graph.add(step([pose, 5], [5, pose]))
    with pytest.raises(InputError, match="needs a SE2 as variable 2, but key 1 is a Point2"):
        graph.add(step(pose, tree))
    with pytest.raises(InputError, match="needs a SE2 as variable 1, but key 1 is a Point2"):
        graph.add(step([pose, tree], [pose, pose]))
    assert graph.factor_count == 0


def test_bad_variables_are_refused() -> None:
    graph = FactorGraph()
    with pytest.raises(InputError, match="not Point2"):
        graph.add_pose(clew.Point2(0, 0))
    with pytest.raises(InputError, match="shape"):
        graph.add_point((1, 2, 3, 4))
    with pytest.raises(InputError, match="not finite"):
        graph.add_point((np.nan, 0))
    with pytest.raises(InputError, match="3 keys for 2 values"):
        graph.add_pose(clew.SE2.identity((2,)), key=[1, 2, 3])
    with pytest.raises(InputError, match="must be integers"):
        graph.add_pose(clew.SE2(0, 0, 0), key=1.5)
    with pytest.raises(InputError, match="no variable with key 4"):
        graph.value(4)
    assert len(graph) == 0


def test_factors_are_removed_by_their_ids() -> None:
    graph = chain(5)
    loops = graph.add(step([0, 1], [3, 4], role="loop"))
    graph.remove(loops[0])
    assert [block.keys.tolist() for block in graph.blocks(Role.LOOP)] == [[[1, 4]]]
    with pytest.raises(InputError, match=f"no factor has the id {loops[0]}"):
        graph.remove(loops)
    graph.remove(loops[1])
    assert graph.factor_count == 4
    assert list(graph.blocks(Role.LOOP)) == []


def test_a_removed_variable_takes_its_factors_along() -> None:
    graph = chain(5)
    graph.remove_variable(2)
    assert graph.keys().tolist() == [0, 1, 3, 4]
    assert next(graph.blocks()).keys.tolist() == [[0, 1], [3, 4]]
    assert graph.positions([3, 4]).tolist() == [2, 3]
    assert 2 not in graph
    assert graph.add_pose(clew.SE2(9, 9, 0), key=2) == 2
    assert np.array_equal(graph.value(2).array, (9, 9, 0))
    assert graph.keys().tolist() == [0, 1, 3, 4, 2]


def test_values_can_be_replaced() -> None:
    graph = chain(3)
    tree = graph.add_point((0, 0))
    graph.set_value(1, clew.SE2(5, 6, 0.5))
    graph.set_value(tree, (7, 8))
    graph.set_values([0, 2], clew.SE2.from_array([(1, 1, 0), (2, 2, 0)]))
    assert np.array_equal(graph.values(clew.SE2).array, [(1, 1, 0), (5, 6, 0.5), (2, 2, 0)])
    assert np.array_equal(graph.value(tree).array, (7, 8))
    with pytest.raises(InputError, match="cannot give it a SE3"):
        graph.set_value(0, clew.SE3.identity())
    with pytest.raises(InputError, match="not finite"):
        graph.set_value(tree, (np.inf, 0))
    with pytest.raises(InputError, match="one kind"):
        graph.values([0, tree])


def test_structure_changes_with_structure_and_not_with_values() -> None:
    graph = chain(3)
    seen = {graph.structure}
    graph.set_value(1, clew.SE2(5, 6, 0.5))
    assert graph.structure in seen
    for edit in (
        lambda: graph.set_constant(0),
        lambda: graph.add(step(0, 2)),
        lambda: graph.remove(0),
        lambda: graph.remove_variable(2),
        lambda: graph.add_point((0, 0)),
    ):
        edit()
        assert graph.structure not in seen
        seen.add(graph.structure)


def test_a_copy_is_independent() -> None:
    graph = chain(4)
    twin = graph.copy()
    twin.remove_variable(3)
    twin.set_value(0, clew.SE2(9, 9, 0))
    twin.add(step(0, 2))
    twin.add_pose(clew.SE2(1, 1, 1))
    twin.set_constant(1)
    assert graph.counts == {"SE2": 4, "odometry": 3}
    assert graph.value(0).array[0] == 0
    assert not graph.is_constant(1)
    assert twin.is_constant(1)
    assert twin.counts == {"SE2": 4, "odometry": 3}


def test_text_says_what_is_inside() -> None:
    graph = chain(4)
    graph.set_constant(0)
    assert repr(graph) == "<FactorGraph: 4 SE2; 3 odometry factors>"
    assert "4 SE2 (1 held constant)" in str(graph)
    assert "3 Between of SE2, SE2: odometry" in str(graph)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(["pose", "factor", "drop factor", "drop pose"]), st.integers(0, 10**6)),
        max_size=400,
    ),
    st.integers(1, 3),
)
def test_any_order_of_edits_agrees_with_a_plain_dictionary(edits: list[tuple[str, int]], stride: int) -> None:
    graph = FactorGraph()
    poses: dict[int, float] = {}
    factors: dict[int, tuple[int, int]] = {}
    made = 0
    for action, number in edits * 3:
        keys = list(poses)
        if action == "pose" or len(keys) < 2:
            key = made * stride  # stride 1 keeps keys equal to slots, others do not
            made += 1
            graph.add_pose(clew.SE2(number, 0, 0), key=key)
            poses[key] = number
        elif action == "factor":
            pair = keys[number % len(keys)], keys[number // 7 % len(keys)]
            factors[int(graph.add(step(*pair))[0])] = pair
        elif action == "drop factor" and factors:
            chosen = list(factors)[number % len(factors)]
            graph.remove(chosen)
            del factors[chosen]
        elif action == "drop pose":
            gone = keys[number % len(keys)]
            graph.remove_variable(gone)
            del poses[gone]
            factors = {i: pair for i, pair in factors.items() if gone not in pair}
    assert graph.keys().tolist() == list(poses)
    assert [graph.value(key).array[0] for key in poses] == list(poses.values())
    assert graph.positions(list(poses)).tolist() == list(range(len(poses)))
    found = {
        int(i): tuple(pair)
        for ids, block in zip(graph.block_ids(), graph.blocks(), strict=True)
        for i, pair in zip(ids, block.keys.tolist(), strict=True)
    }
    assert found == factors
