"""Peak memory of a solve against what it cannot do without: the graph, and the factor of the Hessian.

Growth is the largest resident memory of a fresh process during `optimize` (default options), less what was
resident when it began (the graph, and loaded libraries, pymetis too). A part of it is fixed: pages of code that
are loaded when they are first run. A solve of ten poses in a row goes before and its growth is listed by itself; the
ratio is that of the rest, and the last column that of both. The factor is its panels as they are stored, the graph
its arrays: keys, measurements and information of factors, keys and values of variables. Linux only.
"""

from __future__ import annotations

import gc
import multiprocessing
from pathlib import Path
from typing import TYPE_CHECKING

from backend_worlds import manhattan

if TYPE_CHECKING:
    from clew import FactorGraph, Solution

MEGABYTE = 2.0**20


def memory(data: Path, graphs: dict[str, str], sizes: list[int]) -> None:
    """Print the rows of a Markdown table: graphs of files, then Manhattan worlds."""
    print("| graph | graph, MB | factor, MB | with update matrices, MB | fixed, MB | growth, MB | "
          "growth / (factor + graph) | with fixed |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    context = multiprocessing.get_context("spawn")
    names = [str(data / folder / f"{name}.g2o") for name, folder in graphs.items()]
    for source in [*names, *sizes]:
        if isinstance(source, str) and not Path(source).exists():
            print(f"{source}: skipped, not there")
            continue
        queue: multiprocessing.Queue[tuple[float, ...]] = context.Queue()
        process = context.Process(target=_measure, args=(source, queue))
        process.start()
        graph, factor, work, fixed, growth = queue.get(timeout=1800)
        process.join()
        name = Path(source).stem if isinstance(source, str) else f"{source:,} poses"
        print(f"| {name} | {graph:,.1f} | {factor:,.1f} | {work:,.1f} | {fixed:,.1f} | {growth:,.1f} | "
              f"{growth / (factor + graph):.2f} | {(fixed + growth) / (factor + graph):.2f} |", flush=True)


def _measure(source: str | int, queue: multiprocessing.Queue[tuple[float, ...]]) -> None:
    import importlib.util

    import numpy as np

    import clew
    from clew.io import read_graph

    if importlib.util.find_spec("pymetis"):
        import pymetis  # noqa: F401
    graph = manhattan(source) if isinstance(source, int) else read_graph(source).graph
    held = sum(b.keys.nbytes + b.measurement.nbytes + b.information.nbytes for b in graph.blocks())
    held += sum(table.keys.nbytes + table.values.nbytes for table in graph.variables())
    kind = next(iter(graph.variables())).kind
    row = clew.FactorGraph()
    keys = row.add_pose(kind.identity((10,)))
    row.add(clew.Between(keys[:-1], keys[1:], kind.identity((9,)), information=np.eye(kind.dim)))
    _, fixed = _growth(row)
    solution, growth = _growth(graph)
    symbolic = solution.posterior.problem.symbolic
    sizes = held, symbolic.factor_bytes, symbolic.memory_bytes
    queue.put((*(size / MEGABYTE for size in sizes), fixed, growth))


def _growth(graph: FactorGraph) -> tuple[Solution, float]:
    """A solve, and by how many megabytes the process grew at most."""
    import clew

    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    before = _status("VmRSS")
    solution = clew.optimize(graph)
    return solution, _status("VmHWM") - before


def _status(name: str) -> float:
    """A line of /proc/self/status, megabytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) / 1024
