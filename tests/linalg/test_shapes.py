"""Graphs of extreme shapes, and every instruction set."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from clew import _native
from clew.linalg import BlockPattern, FactorStatus, analyse
from linalg.dense_twin import dense, grid_information, random_information


@pytest.mark.parametrize("ordering", ["amd", "natural"])
def test_a_chain_of_a_million_poses_has_no_recursion(ordering: str) -> None:
    n = 1_000_000
    pattern = BlockPattern.from_pairs(np.ones(n, dtype=np.int32), np.arange(1, n), np.arange(n - 1))
    values = np.full(2 * n - 1, -1.0)
    values[pattern.column_starts[:-1]] = 2.0
    factor = analyse(pattern, ordering=ordering).factorize(values)
    # The second difference of k (n + 1 - k) / 2 is -1 everywhere.
    k = np.arange(1, n + 1, dtype=np.float64)
    np.testing.assert_allclose(factor.solve(np.ones(n)), k * (n + 1 - k) / 2, rtol=1e-4)
    np.testing.assert_allclose(factor.marginals(), k * (n + 1 - k) / (n + 1), rtol=1e-4)


@pytest.mark.parametrize("ordering", ["amd", "natural"])
def test_an_arrow(ordering: str) -> None:
    n = 400
    pattern = BlockPattern.from_pairs(np.full(n, 2), np.full(n - 1, n - 1), np.arange(n - 1))
    values = grid_information(pattern)
    factor = analyse(pattern, ordering=ordering).factorize(values)
    inverse = np.linalg.inv(dense(pattern, values))
    np.testing.assert_allclose(factor.solve(np.ones(2 * n)), inverse.sum(axis=1), rtol=1e-10)
    # The hub is eliminated last, so the factor fills in nothing but what makes fronts dense.
    assert factor.pattern.rows.size * 4 * 8 > analyse(pattern, ordering="amd").factor_nonzeros


def test_an_arrow_of_many_landmarks_stays_fast() -> None:
    n = 100_000
    pattern = BlockPattern.from_pairs(np.full(n, 2), np.zeros(n - 1), np.arange(1, n))
    symbolic = analyse(pattern, ordering="amd")
    assert symbolic.permutation[-1] == 0 or symbolic.factor_nonzeros < 100 * n


def test_disconnected_parts_and_lonely_variables() -> None:
    sizes = [3, 2, 6, 1, 3, 3, 2]
    pattern = BlockPattern.from_pairs(sizes, [0, 4], [2, 5])
    values = random_information(pattern, np.random.default_rng(3))
    factor = analyse(pattern).factorize(values)
    inverse = np.linalg.inv(dense(pattern, values))
    np.testing.assert_allclose(factor.joint_covariance(np.arange(7)), inverse, atol=1e-12)


@pytest.mark.parametrize("sizes", [[], [1], [6]])
def test_none_or_one_variable(sizes: list[int]) -> None:
    pattern = BlockPattern.from_pairs(sizes, [], [])
    factor = analyse(pattern).factorize(np.eye(sum(sizes)).ravel() * 4)
    assert factor.status is FactorStatus.OK
    np.testing.assert_allclose(factor.solve(np.ones(sum(sizes))), 0.25)
    np.testing.assert_allclose(factor.marginals(), np.eye(sum(sizes)).ravel() / 4)
    assert factor.solve(np.ones((sum(sizes), 0))).shape == (sum(sizes), 0)
    assert factor.joint_covariance([]).shape == (0, 0)
    assert factor.min_pivot == (1.0 if sizes else np.inf)


ISA_SCRIPT = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
from linalg.dense_twin import dense, grid, grid_information
from clew import _native
from clew.linalg import analyse
assert _native.isa() == sys.argv[2], _native.isa()
for size in (2, 3, 6):
    pattern = grid(16, size, diagonals=True)
    values = grid_information(pattern)
    factor = analyse(pattern, ordering="amd").factorize(values)
    inverse = np.linalg.inv(dense(pattern, values))
    rhs = np.random.default_rng(0).normal(size=(pattern.dim, 6))
    np.testing.assert_allclose(factor.solve(rhs), inverse @ rhs, atol=1e-12)
    np.testing.assert_allclose(factor.solve(rhs[:, 0]), inverse @ rhs[:, 0], atol=1e-12)
    blocks = np.stack([inverse[k:k + size, k:k + size] for k in range(0, pattern.dim, size)])
    np.testing.assert_allclose(factor.marginals(), blocks.ravel(), atol=1e-12)
print("agrees")
"""


@pytest.mark.parametrize("isa", ["base", "avx2"])
def test_every_instruction_set_agrees(isa: str) -> None:
    levels = ["base", "avx2", "avx512"]
    if levels.index(_native.isa()) < levels.index(isa):
        pytest.skip(f"needs a machine with {isa}")
    here = Path(__file__).parent
    environment = {**os.environ, "CLEW_ISA": isa, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", ISA_SCRIPT, str(here), isa], env=environment,
                          capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "agrees", done.stderr
