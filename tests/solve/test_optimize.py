"""Solutions of tiny graphs with answers worked out by hand, and of random ones against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import clew
from clew.errors import InputError
from clew.solve import Progress, Status
from solve.dense import normal_equations
from solve.worlds import consistent_graph, random_graph

METHODS = ["levenberg-marquardt", "gauss-newton", "dogleg"]


def square() -> clew.FactorGraph:
    """Four sides of a square, each measured a metre and a quarter turn; the last one says 1.4 m instead."""
    graph = clew.FactorGraph()
    corners = graph.add_pose(clew.SE2.from_array([(0, 0, 0), (1.1, 0, 1.5), (1, 0.9, 3.1), (0.1, 1, -1.6)]))
    graph.add(clew.Between(corners[:3], corners[1:], clew.SE2(1, 0, np.pi / 2), sigmas=(1, 1, 0.001)))
    graph.add(
        clew.Between(corners[3], corners[0], clew.SE2(1.4, 0, np.pi / 2), sigmas=(1, 1, 0.001), role="loop")
    )
    return graph


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("init", ["auto", "file", "tree", "rotation"])
def test_the_error_of_a_loop_is_shared_by_its_sides(method: str, init: str) -> None:
    # The headings are all but fixed, so each of the four displacements takes a quarter of the 0.4 m in y that
    # are missing to a closed loop; with unit sigmas chi2 = 4 * 0.1^2.
    solution = clew.optimize(square(), method=method, init=init)
    assert solution.status is Status.CONVERGED
    assert solution.chi2 == pytest.approx(0.04, rel=1e-4)
    np.testing.assert_allclose(
        solution.values().array[:, :2], [(0, 0), (1, 0.1), (1, 1.2), (0, 1.3)], atol=1e-3
    )
    assert [part.anchor for part in solution.free_parts] == [0]
    assert "key 0 was held" in str(solution)


@pytest.mark.parametrize("method", METHODS)
def test_a_linear_problem_takes_its_weighted_mean(method: str) -> None:
    # One point, measured at 0 with sigma 1 and at 3 with sigma 1/sqrt(2): mean 2, variance 1/3, chi2 4 + 2 *
    # 1.
    graph = clew.FactorGraph()
    point = graph.add_point((9.0, 9.0))
    graph.add(clew.Prior(point, clew.Point2(0, 0), sigmas=1.0))
    graph.add(clew.Prior(point, clew.Point2(3, 0), sigmas=np.sqrt(0.5)))
    solution = clew.optimize(graph, method=method)
    np.testing.assert_allclose(solution.value(point).array, (2, 0), atol=1e-10)
    np.testing.assert_allclose(solution.covariance(point), np.eye(2) / 3, atol=1e-12)
    assert solution.chi2 == pytest.approx(6.0)


@settings(max_examples=15, deadline=None)
@given(
    st.integers(0, 10**6),
    st.sampled_from([2, 3]),
    st.integers(2, 6),
    st.integers(0, 3),
    st.sampled_from(METHODS),
)
def test_no_step_lowers_the_cost_of_a_converged_solution(
    seed: int, space: int, poses: int, points: int, method: str
) -> None:
    solution = clew.optimize(consistent_graph(seed, space, poses, points), method=method)
    assert solution.status is Status.CONVERGED
    graph = solution.graph
    cost, hessian, gradient = normal_equations(graph, graph.keys().tolist())
    assert cost == pytest.approx(solution.chi2, rel=1e-9)
    decrease = gradient @ np.linalg.lstsq(hessian, gradient, rcond=1e-12)[0]
    assert decrease < 1e-7 * cost + 1e-10
    if method != "gauss-newton":
        assert np.all(np.diff(solution.chi2_history) <= 0)


@pytest.mark.parametrize("method", ["levenberg-marquardt", "dogleg"])
@pytest.mark.parametrize("seed", [0, 4, 6])
def test_a_step_that_raises_the_cost_is_taken_back(method: str, seed: int) -> None:
    seen: list[Progress] = []
    graph = random_graph(seed, 2, 6, 3)  # measurements that contradict each other wildly
    solution = clew.optimize(graph, method=method, init="rotation", max_iterations=60, callback=seen.append)
    assert not all(progress.accepted for progress in seen)
    assert np.all(np.diff(solution.chi2_history) < 0)
    assert len(solution.chi2_history) == 1 + sum(progress.accepted for progress in seen)
    cost, _, _ = normal_equations(solution.graph, [])
    assert cost == pytest.approx(solution.chi2, rel=1e-9)


@pytest.mark.parametrize("space", [2, 3])
def test_covariances_are_the_dense_inverse(space: int) -> None:
    solution = clew.optimize(consistent_graph(11, space, 5, 3))
    graph, problem = solution.graph, solution.posterior.problem
    keys = [problem.key_of(column) for column in range(len(problem.row_of))]
    _, hessian, _ = normal_equations(graph, keys)
    inverse = np.linalg.inv(hessian)
    np.testing.assert_allclose(solution.joint_covariance(keys), inverse, atol=1e-8 * np.abs(inverse).max())
    starts = np.cumsum([0, *(graph.kind(key).dim for key in keys)])
    for kind in graph.kinds:
        for key, marginal in zip(solution.keys(kind), solution.covariances(kind), strict=True):
            span = slice(starts[keys.index(key)], starts[keys.index(key) + 1])
            np.testing.assert_allclose(marginal, inverse[span, span], atol=1e-8 * np.abs(inverse).max())
            np.testing.assert_allclose(
                solution.covariance(key), inverse[span, span], atol=1e-8 * np.abs(inverse).max()
            )


def test_a_chain_gets_less_certain_along_the_way() -> None:
    # Straight chain of n steps from a held pose: variance of x is n sx^2, of the heading n st^2, and of y
    # n sy^2 + st^2 (1^2 + 2^2 + ... + (n-1)^2), in the frame of the last pose.
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE2.from_array([(i, 0, 0) for i in range(5)]))
    graph.add(clew.Between(keys[:-1], keys[1:], clew.SE2(1, 0, 0), sigmas=(0.1, 0.2, 0.03)))
    graph.set_constant(keys[0])
    solution = clew.optimize(graph)
    assert solution.free_parts == ()
    np.testing.assert_allclose(
        np.diag(solution.covariance(keys[4])),
        (4 * 0.01, 4 * 0.04 + 0.0009 * (1 + 4 + 9), 4 * 0.0009),
        rtol=1e-9,
    )
    assert not solution.covariance(keys[0]).any()
    assert not solution.joint_covariance([keys[0], keys[4]])[:3].any()


def test_constant_variables_stay_and_the_rest_follows() -> None:
    graph = square()
    graph.set_constant(2)
    before = graph.value(2).array
    solution = clew.optimize(graph)
    assert solution.free_parts == ()
    assert np.array_equal(solution.value(2).array, before)
    assert solution.chi2 == pytest.approx(0.04, rel=1e-4)
    graph.set_constant([0, 1, 2, 3])
    solution = clew.optimize(graph)
    assert solution.status is Status.NOTHING_TO_DO
    assert np.array_equal(solution.values().array, graph.values(clew.SE2).array)
    assert clew.optimize(clew.FactorGraph()).status is Status.NOTHING_TO_DO


def test_the_input_is_left_alone_unless_asked() -> None:
    graph = square()
    before = graph.values(clew.SE2).array
    solution = clew.optimize(graph)
    assert np.array_equal(graph.values(clew.SE2).array, before)
    assert np.array_equal(solution.graph.values(clew.SE2).array, solution.values().array)
    clew.optimize(graph, update=True)
    np.testing.assert_allclose(graph.values(clew.SE2).array, solution.values().array, atol=1e-12)
    assert clew.optimize(graph, init="file").chi2_initial == pytest.approx(solution.chi2)


def test_a_solution_has_no_graph_once_the_graph_is_another() -> None:
    graph = square()
    early, late = clew.optimize(graph), clew.optimize(graph)
    assert early.graph is early.graph
    graph.remove(0)
    assert early.graph.factor_count == 4
    with pytest.raises(InputError, match="has changed"):
        _ = late.graph
    late.apply(graph)
    assert np.array_equal(graph.values(clew.SE2).array, late.values().array)


def test_editing_a_graph_between_solves_is_noticed() -> None:
    graph = square()
    assert clew.optimize(graph).chi2 == pytest.approx(0.04, rel=1e-4)
    graph.remove(3)  # the side that is too long
    assert clew.optimize(graph).chi2 == pytest.approx(0.0, abs=1e-12)
    graph.add(clew.Between(3, 0, clew.SE2(1.2, 0, np.pi / 2), sigmas=(1, 1, 0.001)))
    assert clew.optimize(graph).chi2 == pytest.approx(0.01, rel=1e-4)


def test_a_robust_kernel_sets_a_false_closure_aside() -> None:
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE2.from_array([(i, 0, 0) for i in range(10)]))
    graph.add(clew.Between(keys[:-1], keys[1:], clew.SE2(1, 0, 0), sigmas=0.1))
    graph.add(clew.Between(keys[0], keys[9], clew.SE2(9, 0, 0), sigmas=0.1, role="loop"))
    graph.add(clew.Between(keys[0], keys[7], clew.SE2(1, 5, 2), sigmas=0.1, role="loop"))
    honest = np.stack([np.arange(10), np.zeros(10), np.zeros(10)], axis=1)
    assert np.abs(clew.optimize(graph).values().array - honest).max() > 0.5
    robust = clew.optimize(graph, robust=clew.GemanMcClure(1.0))
    assert robust.status is Status.CONVERGED
    np.testing.assert_allclose(robust.values().array, honest, atol=1e-2)


def test_a_callback_sees_each_step_and_can_stop() -> None:
    seen: list[Progress] = []
    solution = clew.optimize(square(), init="file", callback=seen.append)
    assert [progress.iteration for progress in seen] == list(range(1, solution.iterations + 1))
    assert seen[-1].chi2 == solution.chi2
    stopped = clew.optimize(square(), init="file", callback=lambda progress: progress.iteration == 1)
    assert stopped.status is Status.STOPPED
    assert stopped.iterations == 1


def test_options_that_do_not_exist_are_named() -> None:
    for options, message in (
        ({"method": "newton"}, "levenberg"),
        ({"init": "odometry"}, "rotation"),
        ({"max_iterations": -1}, "negative"),
        ({"ordering": "magic"}, "amd"),
    ):
        with pytest.raises(InputError, match=message):
            clew.optimize(square(), **options)
    with pytest.raises(InputError, match="no variable with key 77"):
        clew.optimize(square()).value(77)
