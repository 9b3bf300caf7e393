"""Peak memory of a solve against what it cannot do without: the graph, and the factor of the Hessian.

Growth is the largest resident memory of a fresh process during `optimize` (default options), less what was
resident when it began (the graph, and loaded libraries, pymetis too). The factor is its panels as they are
stored, the graph its arrays: keys, measurements and information of factors, keys and values of variables.
Linux only.
"""

from __future__ import annotations

import gc
import multiprocessing
from pathlib import Path

from backend_worlds import manhattan

MEGABYTE = 2.0**20


def memory(data: Path, graphs: dict[str, str], sizes: list[int]) -> None:
    """Print the rows of a Markdown table: graphs of files, then Manhattan worlds."""
    print("| graph | graph, MB | factor, MB | with update matrices, MB | growth, MB | growth / (factor + graph) |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    context = multiprocessing.get_context("spawn")
    names = [str(data / folder / f"{name}.g2o") for name, folder in graphs.items()]
    for source in [*names, *sizes]:
        if isinstance(source, str) and not Path(source).exists():
            print(f"{source}: skipped, not there")
            continue
        queue: multiprocessing.Queue[tuple[float, ...]] = context.Queue()
        process = context.Process(target=_measure, args=(source, queue))
        process.start()
        graph, factor, work, growth = queue.get(timeout=1800)
        process.join()
        name = Path(source).stem if isinstance(source, str) else f"{source:,} poses"
        print(f"| {name} | {graph:,.1f} | {factor:,.1f} | {work:,.1f} | {growth:,.1f} | "
              f"{growth / (factor + graph):.2f} |", flush=True)


def _measure(source: str | int, queue: multiprocessing.Queue[tuple[float, ...]]) -> None:
    import importlib.util

    import clew
    from clew.io import read_graph

    if importlib.util.find_spec("pymetis"):
        import pymetis  # noqa: F401
    graph = manhattan(source) if isinstance(source, int) else read_graph(source).graph
    held = sum(b.keys.nbytes + b.measurement.nbytes + b.information.nbytes for b in graph.blocks())
    held += sum(table.keys.nbytes + table.values.nbytes for table in graph.variables())
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    before = _status("VmRSS")
    solution = clew.optimize(graph)
    growth = _status("VmHWM") - before
    symbolic = solution.posterior.problem.symbolic
    queue.put((held / MEGABYTE, symbolic.factor_bytes / MEGABYTE, symbolic.memory_bytes / MEGABYTE, growth))


def _status(name: str) -> float:
    """A line of /proc/self/status, megabytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) / 1024
