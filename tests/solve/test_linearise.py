"""Compiled graphs against NumPy twins: cost, block Hessian and gradient of every kind of factor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import clew
from clew import _native
from clew.solve import compile_graph
from clew.solve.problem import values_of
from solve.dense import dense_hessian, normal_equations
from solve.worlds import random_graph

KERNELS = [
    None,
    clew.Huber(1.0),
    clew.PseudoHuber(1.0),
    clew.Cauchy(1.5),
    clew.GemanMcClure(2.0),
    clew.Welsch(3.0),
    clew.Tukey(4.0),
    clew.DCS(1.0),
]


def compare(graph: clew.FactorGraph, robust: Any = None) -> None:
    problem, gauge = compile_graph(graph)
    assert gauge.parts == ()
    free = [problem.key_of(column) for column in range(len(problem.row_of))]
    cost, hessian, gradient = normal_equations(graph, free, robust)
    system = problem.empty_system()
    scale = np.abs(hessian).max(initial=1.0)
    assert problem.evaluate(values_of(graph), robust, system) == pytest.approx(cost, rel=1e-12)
    assert problem.evaluate(values_of(graph), robust) == pytest.approx(cost, rel=1e-12)
    np.testing.assert_allclose(dense_hessian(problem, system), hessian, atol=1e-7 * scale)
    np.testing.assert_allclose(system.gradient, gradient, atol=1e-7 * scale)


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 10**6),
    st.sampled_from([2, 3]),
    st.integers(1, 6),
    st.integers(0, 4),
    st.sampled_from(KERNELS),
)
def test_normal_equations_agree_with_the_dense_twin(
    seed: int, space: int, poses: int, points: int, kernel: Any
) -> None:
    graph = random_graph(seed, space, poses, points, kernel)
    if points:
        graph.set_constant(graph.keys()[-1])
    if poses > 2:
        graph.set_constant(1 + points // 2)
    compare(graph)


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("kernel", KERNELS[1:], ids=lambda k: type(k).__name__)
def test_a_kernel_for_all_spares_priors_and_blocks_with_their_own(space: int, kernel: Any) -> None:
    compare(random_graph(3, space, 5, 3, clew.Cauchy(0.7)), kernel)


def test_a_factor_between_a_variable_and_itself_counts_fully() -> None:
    graph = clew.FactorGraph()
    a, b = graph.add_pose(clew.SE2(1, 2, 0.5)), graph.add_pose(clew.SE2(2, 1, -0.4))
    graph.add(clew.Prior(a, clew.SE2.identity(), sigmas=1.0))
    graph.add(clew.Between([a, a], [b, a], clew.SE2(1, 0, 0.2), sigmas=1.0))
    compare(graph)


def test_angles_near_pi_and_zero() -> None:
    for angle in (0.0, 1e-9, 1e-4, np.pi - 1e-7, np.pi, -np.pi + 1e-7):
        flat, solid = clew.FactorGraph(), clew.FactorGraph()
        for graph, pose in (
            (flat, clew.SE2(0.3, 0.1, angle)),
            (solid, clew.SE3.exp([0.3, 0.1, 0.2, 0, 0, angle])),
        ):
            identity = type(pose).identity()
            a, b = graph.add_pose(identity), graph.add_pose(pose)
            graph.add(clew.Prior(a, identity, sigmas=1.0))
            graph.add(clew.Between(a, b, type(pose).exp(1e-3 * np.arange(pose.dim)), sigmas=0.5))
            problem, _ = compile_graph(graph)
            system = problem.empty_system()
            chi2 = problem.evaluate(values_of(graph), None, system)
            block = list(graph.blocks())[1]
            values = [pose_.array[None] for pose_ in (identity, pose)]
            e = block.residual(*values, measurement=block.measurement)[0]
            ja, jb = (j[0] for j in block.jacobians(*values, measurement=block.measurement))
            assert chi2 == pytest.approx(4.0 * e @ e, rel=1e-9)
            np.testing.assert_allclose(
                dense_hessian(problem, system)[pose.dim :, : pose.dim], 4.0 * jb.T @ ja, atol=1e-8
            )


@dataclass(frozen=True)
class Bounded:
    """A robust kernel that native code does not know."""

    native_id: ClassVar[int] = -1
    scale: float = 1.0

    def rho(self, s: Any) -> Any:
        return np.arctan(s)

    def weight(self, s: Any) -> Any:
        return 1.0 / (1.0 + s * s)


def test_a_kernel_written_in_python() -> None:
    compare(random_graph(5, 2, 4, 3, Bounded()))


def test_a_factor_written_in_python_is_differentiated() -> None:
    graph = random_graph(1, 2, 4, 2)
    keys = graph.keys(clew.SE2)

    def middle(a: Any, b: Any, c: Any, measurement: Any) -> Any:
        return np.sin(a[:, :2] + c[:, :2]) * b[:, 2:] - measurement

    graph.add(
        clew.CustomFactor(
            (keys[:-2], keys[1:-1], keys[2:]),
            middle,
            kinds=(clew.SE2,) * 3,
            measurement=np.full((2, 2), 0.3),
            sigmas=(0.5, 0.7),
        )
    )
    compare(graph)


@pytest.mark.parametrize("kind", [clew.SE2, clew.SE3])
def test_retract_agrees_with_geometry(kind: Any) -> None:
    generator = np.random.default_rng(0)
    delta = generator.standard_normal((50, kind.dim)) * np.logspace(-9, 0.5, 50)[:, None]
    poses = kind.exp(generator.standard_normal((50, kind.dim)))
    offsets = np.where(np.arange(50) % 7 == 3, -1, kind.dim * np.arange(50)).astype(np.int32)
    out = np.empty_like(poses.array)
    _native.solve.retract(poses.array, offsets, delta.ravel(), out)
    expected = poses.retract(np.where(offsets[:, None] < 0, 0.0, delta)).array
    np.testing.assert_allclose(out, expected, atol=1e-14)


def test_native_code_checks_its_input() -> None:
    graph = random_graph(1, 2, 3, 0)
    problem, _ = compile_graph(graph)
    block = problem.blocks[1]
    system = problem.empty_system()
    arguments: dict[str, Any] = {
        "kind": "between_se2",
        "first": values_of(graph)[0],
        "second": values_of(graph)[0],
        "sensor": None,
        "rows": block.rows,
        "measurement": block.factor.measurement,
        "information": block.factor.information,
        "gradient": block.gradient,
        "plan": block.plan,
        "robust": 0,
        "scale": 1.0,
        "hessian": system.hessian,
        "gradient_values": system.gradient,
    }
    assert _native.solve.linearise(**arguments) > 0
    for name, bad in (
        ("rows", block.rows + 9),
        ("plan", block.plan + 4000),
        ("gradient", block.gradient + 90),
        ("kind", "nothing"),
        ("robust", 99),
        ("scale", 0.0),
        ("measurement", block.factor.measurement[:, :2].copy()),
        ("gradient_values", None),
    ):
        with pytest.raises(ValueError, match=r"."):
            _native.solve.linearise(**{**arguments, name: bad})
