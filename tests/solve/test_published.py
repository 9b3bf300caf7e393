"""Published optima of real and standard graphs, reached from the files alone with default options."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import clew
from clew import SE2
from clew.io import read_graph

DATA = Path(__file__).parents[3] / "shared" / "data"
OPTIMA = {
    "graphs2d/CSAIL": 40.5551,
    "graphs2d/manhattan": 3549.04,
    "graphs2d/MIT": 41.1633,
    "graphs2d/intel": 45.0047,
    "graphs2d/city10000": 511.9852,
    "graphs2d/ais2klinik": 172.8156,
    "graphs3d/parking-garage": 1.268384,
    "graphs3d/smallGrid3D": 1033.8944,
    "graphs3d/sphere2500": 1351.3623,
    "graphs3d/torus3D": 24233.019,
}
#: Nobody published these: the lowest of solves by three methods from three guesses each, and from random starts.
LOWEST = {
    "graphs2d/FR079_P_toro.graph": 37.5991159,
    "graphs3d/tinyGrid3D.g2o": 18.6161577,
    "graphs3d/cubicle.g2o": 2729.39851,
}


@pytest.mark.parametrize("name", OPTIMA)
def test_default_options_reach_the_optimum(name: str) -> None:
    path = DATA / f"{name}.g2o"
    if not path.exists():
        pytest.skip(f"needs {path}")
    solution = clew.optimize(read_graph(path).graph)
    assert solution.status.ok
    assert solution.chi2 == pytest.approx(OPTIMA[name], rel=2e-6)
    assert len(solution.free_parts) == 1


@pytest.mark.parametrize("name", LOWEST)
def test_default_options_reach_the_lowest_of_several_starts(name: str) -> None:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs {path}")
    graph = read_graph(path).graph
    solution = clew.optimize(graph)
    assert solution.status.ok
    assert len(solution.free_parts) == 1
    assert solution.chi2 == pytest.approx(LOWEST[name], rel=2e-8)
    for init in ("file", "tree", "rotation"):
        other = clew.optimize(graph, init=init, method="dogleg").chi2
        assert solution.chi2 <= other * (1.0 + 1e-8)
    generator = np.random.default_rng(0)
    start, keys = solution.values(), solution.keys()
    for _ in range(2):
        graph.set_values(keys, start.retract(0.3 * generator.standard_normal((len(keys), start.dim))))
        assert clew.optimize(graph, init="file").chi2 == pytest.approx(solution.chi2, rel=1e-8)


def test_measurements_that_contradict_each_other_get_a_second_try() -> None:
    """With this noise on its headings MIT ends at 326.5 from the rotation and the tree guess alike."""
    path = DATA / "graphs2d/MIT.g2o"
    if not path.exists():
        pytest.skip(f"needs {path}")
    graph, generator = read_graph(path).graph, np.random.default_rng(1)
    known = clew.optimize(graph)
    noisy = clew.FactorGraph()
    noisy.add_pose(known.values(), key=known.keys())
    for block in graph.blocks():
        turned = SE2.from_array(block.measurement).retract([0.0, 0.0, 0.1] * generator.standard_normal((len(block), 3)))
        noisy.add(clew.Between(*block.keys.T, turned, information=block.information, role=block.role))
    best = clew.optimize(noisy, init="file").chi2
    assert clew.optimize(noisy, init="rotation").chi2 > 1.3 * best
    solution = clew.optimize(noisy)
    assert solution.chi2 == pytest.approx(best, rel=1e-6)
    assert solution.init == "sequential"


def test_victoria_park_needs_no_settings() -> None:
    """Odometry alone bends this path so far that every other guess ends above 11,000."""
    path = DATA / "landmarks/victoriaPark-full.g2o.gz"
    if not path.exists():
        pytest.skip(f"needs {path}")
    solution = clew.optimize(read_graph(path).graph)
    assert solution.status.ok
    assert solution.init == "sequential"
    assert solution.chi2 == pytest.approx(389.787423, rel=2e-6)


@pytest.mark.parametrize("method", ["gauss-newton", "dogleg"])
def test_all_methods_and_guesses_agree_on_intel(method: str) -> None:
    path = DATA / "graphs2d/intel.g2o"
    if not path.exists():
        pytest.skip(f"needs {path}")
    graph = read_graph(path).graph
    for init in ("file", "tree", "rotation"):
        assert clew.optimize(graph, method=method, init=init).chi2 == pytest.approx(45.0047, rel=2e-6)


def test_marginals_of_intel_are_those_of_single_solves() -> None:
    path = DATA / "graphs2d/intel.g2o"
    if not path.exists():
        pytest.skip(f"needs {path}")
    solution = clew.optimize(read_graph(path).graph)
    everyone, keys = solution.covariances(), solution.keys()
    for place in (1, 400, 1727):
        np.testing.assert_allclose(everyone[place], solution.covariance(int(keys[place])), rtol=1e-8)
