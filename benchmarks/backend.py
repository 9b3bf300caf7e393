"""Side by side with GTSAM, g2o and Ceres: the same graphs, the same start, one thread each.

    python benchmarks/backend.py                 the table of Gauss-Newton iterations, and marginals
    python benchmarks/backend.py --scaling       Manhattan worlds from 1,000 to 1,000,000 poses
    python benchmarks/backend.py --memory        peak memory of a solve against graph and factor
    python benchmarks/backend.py --threads 2     time by the clock with one and with two threads
    python benchmarks/backend.py --noise         minima of graphs whose rotations were turned by noise

Prints Markdown. A program that is not installed is left out with a line that says so.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import math
import multiprocessing
import os
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import TypeVar

sys.path.insert(0, str(Path(__file__).parent))

from backend_ceres import build_ceres, run_ceres_program
from backend_memory import memory
from backend_noise import noise
from backend_peers import PEERS, Refused, Run, marginals_clew, marginals_gtsam, repeat, run_clew, run_custom
from backend_threads import threads
from backend_worlds import scaling

Result = TypeVar("Result")
DATA = Path(__file__).parents[2] / "shared" / "data"
GRAPHS = {"intel": "graphs2d", "manhattan": "graphs2d", "city10000": "graphs2d", "ais2klinik": "graphs2d",
          "parking-garage": "graphs3d", "sphere2500": "graphs3d", "torus3D": "graphs3d"}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA, help="folder with graphs2d/ and graphs3d/")
    parser.add_argument("--graphs", nargs="*", default=list(GRAPHS))
    parser.add_argument("--iterations", type=int, default=5)
    parser.add_argument("--repeats", type=int, default=3, help="the fastest of these counts")
    parser.add_argument("--scaling", action="store_true", help="Manhattan worlds instead of the table")
    parser.add_argument("--memory", action="store_true", help="peak memory instead of the table")
    parser.add_argument("--sizes", type=int, nargs="*", default=[1_000, 10_000, 100_000, 1_000_000])
    parser.add_argument("--noise", action="store_true", help="minima of noisy graphs instead of the table")
    parser.add_argument("--threads", type=int, default=1, help="one against that many threads instead of the table")
    options = parser.parse_args()
    graphs = {name: GRAPHS[name] for name in options.graphs}
    if options.threads > 1:
        threads(options.data, graphs, options.sizes, options.threads, options.repeats)
        return
    if hasattr(os, "sched_setaffinity"):  # one thread for everybody, whatever their defaults
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    if options.scaling:
        scaling(options.sizes)
        return
    if options.noise:
        noise(options.data, seeds=2)
        return
    if options.memory:
        memory(options.data, graphs, options.sizes)
        return
    with tempfile.TemporaryDirectory() as folder:
        iterations(options, Path(folder))


def iterations(options: argparse.Namespace, folder: Path) -> None:
    """The table of Gauss-Newton iterations, and marginals of sphere2500."""
    available = installed(folder)
    print(f"Milliseconds of one core for one Gauss-Newton iteration, analysis included ({options.iterations} "
          f"iterations from clew's rotation guess, fastest of {options.repeats}), and chi2 at the end.\n")
    header: list[str] | None = None
    ratios: dict[str, list[float]] = {}
    custom = ""
    for name in options.graphs:
        source = options.data / GRAPHS[name] / f"{name}.g2o"
        if not source.exists():
            print(f"{name}: skipped, {source} is not there")
            continue
        solid = GRAPHS[name] == "graphs3d"
        files = start_files(source, folder)
        own = fastest(run_clew, files["radians"], solid, options)
        assert isinstance(own, Run)
        cells = [name, f"{1e3 * own.seconds_per_iteration:.2f}", f"{own.chi2:.7g}"]
        programs = [own.program]
        for peer, run in available.items():
            result = fastest(run, files["g2o" if peer == "g2o" else "radians"], solid, options)
            programs.append(result.program if isinstance(result, Run) else peer)
            if isinstance(result, str):
                cells += [result, ""]
                continue
            ratio = result.seconds_per_iteration / own.seconds_per_iteration
            ratios.setdefault(peer, []).append(ratio)
            cells += [f"{1e3 * result.seconds_per_iteration:.2f} ({ratio:.1f}x)", f"{result.chi2:.7g}"]
        if header is None:
            header = ["graph", *(cell for program in programs for cell in (f"{program}, ms", "chi2"))]
            print("| " + " | ".join(header) + " |\n|" + " --- |" * len(header))
        print("| " + " | ".join(cells) + " |", flush=True)
        if name == "manhattan":
            python = fastest(run_custom, files["radians"], solid, options)
            assert isinstance(python, Run)
            custom = ("\nmanhattan with the between factor written in NumPy: "
                      f"{1e3 * python.seconds_per_iteration:.2f} ms, "
                      f"{python.seconds_per_iteration / own.seconds_per_iteration:.1f}x, chi2 {python.chi2:.7g}.")
    if custom:
        print(custom)
    for peer, values in ratios.items():
        mean = math.exp(sum(map(math.log, values)) / len(values))
        print(f"\n{peer}: geometric mean {mean:.1f} times clew's time over {len(values)} graphs.")
    if "sphere2500" in options.graphs and header is not None:
        path = start_files(options.data / "graphs3d" / "sphere2500.g2o", folder)["radians"]
        own_time = min(alone(marginals_clew, path) for _ in range(options.repeats))
        text = f"\nAll 2,500 marginal covariances of sphere2500: clew {1e3 * own_time:.0f} ms"
        if "gtsam" in available:
            peer_time = alone(marginals_gtsam, path, True, 100)
            text += f", GTSAM {peer_time:.1f} s (from a sample of 100), {peer_time / own_time:.0f}x"
        print(text + ".")


def installed(folder: Path) -> dict[str, Callable[[Path, bool, int], Run]]:
    """The peers that can be imported or compiled; says which cannot, and why."""
    found: dict[str, Callable[[Path, bool, int], Run]] = {}
    for name, run in PEERS.items():
        if importlib.util.find_spec(name) is None:
            print(f"{name}: skipped, missing: pip install '.[bench]'")
        elif reason := import_failure(name):
            print(f"{name}: skipped, incompatible: {reason}")
        else:
            found[name] = run
    program, reason = build_ceres(folder)
    if program is None:
        print(f"ceres: skipped, {reason}")
    else:
        found["ceres"] = partial(run_ceres_program, str(program))
    return found


def import_failure(name: str) -> str:
    """Why a peer that is installed cannot be used, or nothing."""
    try:
        alone(_load, name)
    except BrokenProcessPool:
        return "it crashes"
    except Exception as error:  # a module can raise anything
        return (str(error) or type(error).__name__).splitlines()[0]
    return ""


def _load(name: str) -> None:
    importlib.import_module(name)  # a module cannot be handed back from a process


def start_files(source: Path, folder: Path) -> dict[str, Path]:
    """The graph with clew's initial guess as values, for all programs to start from.

    g2o reads the rotation block of the information in its own units; its file is written in these.
    """
    import clew
    from clew.io import read_graph, write_graph

    files = {unit: folder / f"{source.stem}.{unit}.g2o" for unit in ("radians", "g2o")}
    if not files["g2o"].exists():
        guess = clew.optimize(read_graph(source).graph, init="rotation", max_iterations=0).graph
        for unit, path in files.items():
            write_graph(path, guess, rotation_information=unit)
    return files


def fastest(run: Callable[[Path, bool, int], Run], path: Path, solid: bool,
            options: argparse.Namespace) -> Run | str:
    """The fastest of some runs, or why there is none."""
    try:
        return alone(repeat, run, path, solid, options.iterations, options.repeats)
    except Refused as reason:
        return str(reason)
    except BrokenProcessPool:
        return "crashed"


def alone(function: Callable[..., Result], *arguments: object) -> Result:
    """A call in a process of its own: the programs bring libraries that do not get along."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context) as pool:
        return pool.submit(function, *arguments).result()


if __name__ == "__main__":
    main()
