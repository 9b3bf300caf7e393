"""What `threads=` brings: one factorisation and a whole default solve, by the clock on the wall.

Runs with one and with more threads take turns, and the fastest of each counts, for other work on the machine can only
make them slower. Solutions must be the same to the last bit.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from backend_worlds import manhattan

if TYPE_CHECKING:
    from clew import FactorGraph

_PATIENCE = 60.0  # seconds for a row's repetitions, after the first


def threads(data: Path, graphs: dict[str, str], sizes: list[int], count: int, repeats: int) -> None:
    """Print a Markdown table: graphs of files, then Manhattan worlds, with one and with `count` threads."""
    from clew.io import read_graph

    print(f"| graph | factorisation, ms | {count} threads | times | default solve, ms | {count} threads | times |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for source in [*(data / folder / f"{name}.g2o" for name, folder in graphs.items()), *sizes]:
        if isinstance(source, Path) and not source.exists():
            print(f"{source}: skipped, not there")
            continue
        graph = manhattan(source) if isinstance(source, int) else read_graph(source).graph
        factorised, solved = _row(graph, count, repeats)
        name = f"{source:,} poses" if isinstance(source, int) else source.stem
        cells = [f"{1e3 * one:.1f} | {1e3 * more:.1f} | {one / more:.2f}" for one, more in (factorised, solved)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def _row(graph: FactorGraph, count: int, repeats: int) -> tuple[list[float], list[float]]:
    """Seconds with one and with more threads: of a factorisation, and of a solve."""
    import clew
    from clew.linalg import analyse

    solutions = []

    def solve(number: int) -> Callable[[], None]:
        def run() -> None:
            solution = clew.optimize(graph.copy(), threads=number)  # a copy is compiled anew
            solutions.append(solution.values(kind).array.tobytes())

        return run

    kind = next(iter(graph.variables())).kind
    solved = _fastest([solve(1), solve(count)], repeats)
    assert len(set(solutions)) == 1, "threads changed the solution"

    posterior = clew.optimize(graph, init="file", max_iterations=1).posterior
    known, values = posterior.problem.symbolic, posterior.system.hessian
    runs = []
    for number in (1, count):
        symbolic = analyse(known.pattern, ordering=known.ordering, threads=number, order=known.permutation)
        factor = symbolic.factorize(values)
        runs.append(lambda symbolic=symbolic, factor=factor: symbolic.factorize(values, into=factor))
    return _fastest(runs, 5 * repeats), solved


def _fastest(runs: list[Callable[[], object]], repeats: int) -> list[float]:
    """The fastest of some rounds for each, run in turns."""
    best = [float("inf")] * len(runs)
    begun = time.perf_counter()
    for round_ in range(repeats):
        if round_ and time.perf_counter() - begun > _PATIENCE:
            break
        for k, run in enumerate(runs):
            start = time.perf_counter()
            run()
            best[k] = min(best[k], time.perf_counter() - start)
    return best
