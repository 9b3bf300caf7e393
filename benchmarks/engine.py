"""Times the sparse engine on the patterns of real graphs, beside SciPy's SuperLU in the same run.

    python benchmarks/engine.py [--threads N] [--no-scipy] [name ...]

Values are sums of J^T J of random Jacobians, so only the structure is that of the data in ../shared/data;
graphs that are absent are skipped, and a simulated grid world is always there. Times are minima over
repetitions, in milliseconds; `factor` overwrites one factor, as the iterations of a solver do.
"""

from __future__ import annotations

import argparse
import gzip
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from clew.linalg import BlockPattern, analyse

DATA = Path(__file__).parents[2] / "shared" / "data"
GRAPHS = (
    "graphs2d/intel.g2o", "graphs2d/ais2klinik.g2o", "graphs2d/manhattan.g2o", "graphs2d/city10000.g2o",
    "graphs3d/parking-garage.g2o", "graphs3d/sphere2500.g2o", "graphs3d/cubicle.g2o", "graphs3d/torus3D.g2o",
    "landmarks/victoriaPark-full.g2o.gz",
)
EDGE_SIZES = {"EDGE_SE2": (3, 3), "EDGE_SE2_XY": (3, 2), "EDGE_SE3:QUAT": (6, 6)}


class Graph(NamedTuple):
    """Structure of a graph: sizes of the variables and the pairs that edges join."""

    sizes: NDArray[np.int32]
    i: NDArray[np.int64]
    j: NDArray[np.int64]


def read_graph(path: Path) -> Graph:
    """Vertices and edges of a g2o file; what is measured is ignored."""
    with (gzip.open(path, "rt") if path.suffix == ".gz" else path.open()) as file:
        words = [line.split(maxsplit=3)[:3] for line in file if line.startswith("EDGE_")]
    ends = np.array([(int(a), int(b)) for _, a, b in words], dtype=np.int64)
    dims = np.array([EDGE_SIZES[kind] for kind, _, _ in words], dtype=np.int32)
    ids, index = np.unique(ends, return_inverse=True)
    index = index.reshape(ends.shape)
    sizes = np.zeros(ids.size, dtype=np.int32)
    sizes[index.ravel()] = dims.ravel()
    return Graph(sizes, index[:, 0], index[:, 1])


def grid_world(side: int, closures: float, seed: int = 0) -> Graph:
    """A robot that sweeps a square grid row by row and closes a part of the loops to the row before."""
    cells = np.arange(side * side).reshape(side, side)
    cells[1::2] = cells[1::2, ::-1]
    up = np.stack([cells[1:].ravel(), cells[:-1].ravel()])
    up = up[:, np.random.default_rng(seed).random(up.shape[1]) < closures]
    steps = np.stack([np.arange(1, cells.size), np.arange(cells.size - 1)])
    i, j = np.concatenate([steps, up], axis=1)
    return Graph(np.full(cells.size, 3, dtype=np.int32), i, j)


def random_values(pattern: BlockPattern, graph: Graph, seed: int = 0) -> NDArray[np.float64]:
    """Sum of J^T J over edges with random Jacobians, and a faint prior on every variable."""
    rng = np.random.default_rng(seed)
    values = np.zeros(int(pattern.offsets[-1]))
    row, col = np.maximum(graph.i, graph.j), np.minimum(graph.i, graph.j)
    for a in np.unique(pattern.sizes):
        for b in np.unique(pattern.sizes):
            edges = np.flatnonzero((pattern.sizes[row] == a) & (pattern.sizes[col] == b))
            jr = rng.normal(size=(edges.size, max(a, b), a)) + np.eye(max(a, b), a)
            jc = rng.normal(size=(edges.size, max(a, b), b)) - np.eye(max(a, b), b)
            for left, i, right, j in ((jr, row, jr, row), (jc, col, jc, col), (jr, row, jc, col)):
                length = left.shape[2] * right.shape[2]
                block = np.einsum("eki,ekj->eij", left, right).reshape(edges.size, length)
                start = pattern.offsets[pattern.block_index(i[edges], j[edges])]
                np.add.at(values, start[:, None] + np.arange(length), block)
    for d in np.unique(pattern.sizes):
        start = pattern.offsets[pattern.column_starts[:-1][pattern.sizes == d]]
        values[start[:, None] + np.arange(d) * (d + 1)] += 1e-2
    return values


def to_scipy(pattern: BlockPattern, values: NDArray[np.float64]) -> sp.csc_array:
    """The whole symmetric matrix."""
    block = np.repeat(np.arange(pattern.rows.size), np.diff(pattern.offsets))
    within = np.arange(values.size) - pattern.offsets[block]
    cols = pattern.sizes[pattern.cols[block]]
    r = pattern.starts[pattern.rows[block]] + within // cols
    c = pattern.starts[pattern.cols[block]] + within % cols
    lower = sp.coo_array((values, (r, c)), shape=(pattern.dim, pattern.dim)).tocsc()
    return sp.csc_array(sp.tril(lower) + sp.tril(lower, -1).T)


def milliseconds(work: Callable[[], object], budget: float = 0.5) -> float:
    """Shortest of at least three runs, or of as many as fit the budget in seconds."""
    best, spent, runs = float("inf"), 0.0, 0
    while runs < 3 or (spent < budget and runs < 200):
        start = time.perf_counter()
        work()
        taken = time.perf_counter() - start
        best, spent, runs = min(best, taken), spent + taken, runs + 1
    return best * 1e3


def measure(name: str, graph: Graph, threads: int, ordering: str, with_scipy: bool) -> str:
    """One line of the table."""
    pattern = BlockPattern.from_pairs(graph.sizes, graph.i, graph.j)
    values = random_values(pattern, graph)
    rhs = np.random.default_rng(1).normal(size=pattern.dim)
    symbolic = analyse(pattern, ordering=ordering, threads=threads)
    factor = symbolic.factorize(values)
    matrix = to_scipy(pattern, values)
    residual = float(np.abs(matrix @ factor.solve(rhs) - rhs).max())
    times = [
        milliseconds(lambda: BlockPattern.from_pairs(graph.sizes, graph.i, graph.j)),
        milliseconds(lambda: analyse(pattern, ordering=ordering, threads=threads)),
        milliseconds(lambda: symbolic.factorize(values, into=factor)),
        milliseconds(lambda: factor.solve(rhs)),
        milliseconds(factor.marginals),
    ]
    options = {"SymmetricMode": True}
    superlu = np.nan
    if with_scipy:
        superlu = milliseconds(lambda: splu(matrix, "MMD_AT_PLUS_A", 0.0, options=options), 0.0)
    numbers = [f"{t:10.2f}" for t in (*times, superlu)]
    numbers += [f"{symbolic.flops / times[2] / 1e6:8.1f}", f"{symbolic.factor_nonzeros / 1e6:9.2f}",
                f"{symbolic.memory_bytes / 2**20:8.1f}", f"{residual:10.1e}"]
    head = f"{name:18s}{pattern.sizes.size:9d}{pattern.dim:9d}{symbolic.ordering:>7s}"
    return head + "".join(numbers)


def main() -> None:
    """Prints the table."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("names", nargs="*", help="only graphs whose file name contains one of these")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--ordering", default="auto", choices=["auto", "amd", "metis", "natural"])
    parser.add_argument("--no-scipy", action="store_true", help="leave SciPy out")
    parser.add_argument("--large", action="store_true", help="also a grid world of a million poses")
    options = parser.parse_args()
    heads = ("pattern", "analyse", "factor", "solve", "marginals", "splu")
    print(f"{'graph':18s}{'variables':>9s}{'dim':>9s}{'order':>7s}" + "".join(f"{h:>10s}" for h in heads)
          + f"{'GFlop/s':>8s}{'nnz/1e6':>9s}{'MiB':>8s}{'residual':>10s}")
    worlds = {"grid100": 100, "grid1000": 1000} if options.large else {"grid100": 100}
    sources: list[tuple[str, Callable[[], Graph]]] = []
    for file in GRAPHS:
        path = DATA / file
        sources.append((path.name.split(".")[0], lambda path=path: read_graph(path)))
    sources += [(name, lambda side=side: grid_world(side, 0.5)) for name, side in worlds.items()]
    for name, load in sources:
        if options.names and not any(wanted in name for wanted in options.names):
            continue
        try:
            graph = load()
        except FileNotFoundError as missing:
            print(f"{name:18s} skipped: {missing.filename} is absent")
            continue
        print(measure(name, graph, options.threads, options.ordering, not options.no_scipy), flush=True)


if __name__ == "__main__":
    main()
