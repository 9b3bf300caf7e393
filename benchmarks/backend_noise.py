"""Whether default options find the minimum of graphs whose rotations were turned by noise.

Each measured rotation is turned by noise beyond what its information says, and the values of the file are forgotten.
No program knows the best minimum of such a graph; a solve from the minimum of the graph without that noise comes near.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from clew import FactorGraph

#: Deviations of the noise, radians, for each graph.
NOISE = {
    "graphs2d/manhattan": (0.1, 0.2, 0.3), "graphs2d/intel": (0.05, 0.1, 0.2), "graphs2d/MIT": (0.05, 0.1),
    "graphs2d/CSAIL": (0.05, 0.1), "graphs2d/city10000": (0.2,), "graphs2d/ais2klinik": (0.02, 0.05),
    "graphs3d/sphere2500": (0.3,), "graphs3d/parking-garage": (0.05,), "graphs3d/smallGrid3D": (0.3,),
}


def noise(data: Path, seeds: int) -> None:
    """Print a Markdown table: a row for each graph, noise and seed."""
    import clew
    from clew.io import read_graph

    print("| graph | noise, rad | seed | chi2 from the minimum without noise | chi2 by default | guess | iterations "
          "| s | |")
    print("| --- | ---: | ---: | ---: | ---: | --- | ---: | ---: | --- |")
    reached = []
    for name, levels in NOISE.items():
        path = data / f"{name}.g2o"
        if not path.exists():
            print(f"{path}: skipped, not there")
            continue
        solved = clew.optimize(read_graph(path).graph).graph
        for level, seed in ((level, seed) for level in levels for seed in range(seeds)):
            graph, forgotten = _turned(solved, level, seed)
            near = clew.optimize(graph, init="file")
            start = time.process_time()
            found = clew.optimize(forgotten)
            spent = time.process_time() - start
            reached.append(found.chi2 <= near.chi2 * (1 + 1e-6))
            print(f"| {path.stem} | {level} | {seed} | {near.chi2:.8g} | {found.chi2:.8g} | {found.init} | "
                  f"{found.iterations} | {spent:.2f} | {'' if reached[-1] else 'higher'} |", flush=True)
    print(f"\nThe same cost or a lower one in {sum(reached)} of {len(reached)}.")


def _turned(graph: FactorGraph, level: float, seed: int) -> tuple[FactorGraph, FactorGraph]:
    """The graph with its rotations turned, and the same without values."""
    import clew

    generator = np.random.default_rng(seed)
    kind = next(iter(graph.variables())).kind
    keys, values = graph.keys(kind), graph.values(kind)
    turned, forgotten = clew.FactorGraph(), clew.FactorGraph()
    turned.add_pose(values, key=keys)
    forgotten.add_pose(kind.identity((len(keys),)), key=keys)
    deviation = np.where(np.arange(kind.dim) < kind.space, 0.0, level)
    for block in graph.blocks():
        error = deviation * generator.standard_normal((len(block), kind.dim))
        noisy = kind.from_array(block.measurement).retract(error)
        for out in (turned, forgotten):
            out.add(clew.Between(*block.keys.T, noisy, information=block.information, role=block.role))
    return turned, forgotten
