"""The same Gauss-Newton iterations in clew and in other programs.

Each `run_*` reads a g2o file, does some iterations from the file's values and says how long one took, the
analysis of the sparsity included, and what the cost was at the end. Reading is not timed. Times are
those of the processor, so that other work on the machine disturbs them less; Ceres gives wall time only.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path


class Refused(Exception):
    """A program does not do this graph; the text says why in a word or two."""


@dataclass(frozen=True)
class Run:
    """One program on one graph."""

    program: str
    seconds_per_iteration: float
    chi2: float


def run_clew(path: Path, solid: bool, iterations: int) -> Run:
    """clew with one thread; compiling the graph and the diagnosis at the end are included."""
    import clew
    from clew.io import read_graph
    from clew.solve import optimize

    graph = read_graph(path).graph
    start = time.process_time()
    solution = optimize(graph, method="gauss-newton", init="file", max_iterations=iterations,
                             cost_tolerance=0.0, step_tolerance=0.0, gradient_tolerance=0.0)
    spent = time.process_time() - start
    assert solution.iterations == iterations, solution
    return Run(f"clew {clew.__version__}", spent / iterations, solution.chi2)


def run_custom(path: Path, solid: bool, iterations: int) -> Run:
    """clew with the relative poses of the plane written in NumPy, derivatives by forward differentiation."""
    import numpy as np

    import clew
    from clew.geometry import wrap
    from clew.io import read_graph
    from clew.solve import optimize

    def between(a, b, z):  # type: ignore[no-untyped-def]
        ca, sa, cz, sz = np.cos(a[:, 2]), np.sin(a[:, 2]), np.cos(z[:, 2]), np.sin(z[:, 2])
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        ux, uy = ca * dx + sa * dy - z[:, 0], ca * dy - sa * dx - z[:, 1]
        return np.stack([cz * ux + sz * uy, cz * uy - sz * ux, wrap(b[:, 2] - a[:, 2] - z[:, 2])], axis=1)

    given = read_graph(path).graph
    graph = clew.FactorGraph()
    graph.add_pose(given.values(clew.SE2), key=given.keys(clew.SE2))
    graph.set_constant(given.keys(clew.SE2)[:1])
    for block in given.blocks():
        graph.add(clew.CustomFactor(block.keys, between, measurement=block.measurement,
                                    information=block.information, kinds=(clew.SE2, clew.SE2)))
    start = time.process_time()
    solution = optimize(graph, method="gauss-newton", init="file", max_iterations=iterations,
                        cost_tolerance=0.0, step_tolerance=0.0, gradient_tolerance=0.0)
    spent = time.process_time() - start
    assert solution.iterations == iterations, solution
    return Run("clew, factor in NumPy", spent / iterations, solution.chi2)


def run_gtsam(path: Path, solid: bool, iterations: int) -> Run:
    """GTSAM's Gauss-Newton with the faster of its orderings, COLAMD and METIS; the first pose has a prior."""
    import gtsam

    best = None
    for ordering in ("COLAMD", "METIS"):
        graph, values = gtsam.readG2o(str(path), solid)
        first = min(values.keys())
        prior = gtsam.noiseModel.Isotropic.Sigma(6 if solid else 3, 1e-6)
        if solid:
            graph.add(gtsam.PriorFactorPose3(first, values.atPose3(first), prior))
        else:
            graph.add(gtsam.PriorFactorPose2(first, values.atPose2(first), prior))
        parameters = gtsam.GaussNewtonParams()
        parameters.setOrderingType(ordering)
        start = time.process_time()
        optimizer = gtsam.GaussNewtonOptimizer(graph, values, parameters)
        try:
            for _ in range(iterations):
                optimizer.iterate()
        except RuntimeError:  # "Indeterminate linear system", which depends on the ordering
            continue
        spent = (time.process_time() - start) / iterations
        if best is None or spent < best.seconds_per_iteration:
            best = Run(f"GTSAM {version('gtsam')}", spent, 2.0 * graph.error(optimizer.values()))
    if best is None:
        raise Refused("indeterminate")
    return best


def run_g2o(path: Path, solid: bool, iterations: int) -> Run:
    """g2o's Gauss-Newton with Eigen's sparse Cholesky, the best direct solver in the wheel; first pose fixed.

    The wheel's own reader knows no types, so the graph is read here, with the file's numbers as they are.
    The wheel needs NumPy below 2.
    """
    import g2o

    from clew.geometry import se3
    from clew.io import read_graph

    optimizer = g2o.SparseOptimizer()
    solver = (g2o.BlockSolverSE3(g2o.LinearSolverEigenSE3()) if solid
              else g2o.BlockSolverSE2(g2o.LinearSolverEigenSE2()))
    optimizer.set_algorithm(g2o.OptimizationAlgorithmGaussNewton(solver))
    graph = read_graph(path).graph
    variables = next(graph.variables())

    def pose(row: object) -> object:
        return g2o.Isometry3d(se3.matrix(row)) if solid else g2o.SE2(*row)

    vertices = {}
    for key, row in zip(variables.keys.tolist(), variables.values, strict=True):
        vertex = g2o.VertexSE3() if solid else g2o.VertexSE2()
        vertex.set_id(key)
        vertex.set_estimate(pose(row))
        vertex.set_fixed(not vertices)
        optimizer.add_vertex(vertex)
        vertices[key] = vertex
    for block in graph.blocks():
        columns = block.keys.tolist(), block.measurement, block.information
        for (i, j), z, information in zip(*columns, strict=True):
            edge = g2o.EdgeSE3() if solid else g2o.EdgeSE2()
            edge.set_vertex(0, vertices[i])
            edge.set_vertex(1, vertices[j])
            edge.set_measurement(pose(z))
            edge.set_information(information)
            optimizer.add_edge(edge)
    start = time.process_time()
    optimizer.initialize_optimization()
    optimizer.optimize(iterations)
    spent = (time.process_time() - start) / iterations
    optimizer.compute_active_errors()
    return Run(f"g2o-python {version('g2o-python')}", spent, optimizer.active_chi2())


def run_ceres(path: Path, solid: bool, iterations: int) -> Run:
    """Ceres' own time for linear algebra.

    The wheel has no relative-pose cost in C++. The one here is a Python callback, for the plane, and is not
    counted.
    """
    import numpy as np
    import pyceres

    from clew import SE2
    from clew.io import read_graph

    if solid:
        raise Refused("plane only")
    graph = read_graph(path).graph
    values = {int(key): row.copy() for key, row in zip(graph.keys(SE2), graph.values(SE2).array, strict=True)}

    class Between(pyceres.CostFunction):  # type: ignore[misc]  # a C++ class
        def __init__(self, factor: object, z: object, root: object) -> None:
            pyceres.CostFunction.__init__(self)
            self.factor, self.z, self.root = factor, z[None], root
            self.set_num_residuals(3)
            self.set_parameter_block_sizes([3, 3])

        def Evaluate(self, parameters, residuals, jacobians):  # type: ignore[no-untyped-def]
            a, b = (np.array(p)[None] for p in parameters)
            residuals[:] = self.root @ self.factor.residual(a, b, measurement=self.z)[0]
            if jacobians is not None:
                found = self.factor.jacobians(a, b, measurement=self.z)
                for out, pose, jacobian in zip(jacobians, (a, b), found, strict=True):
                    if out is not None:  # Ceres adds in the world's frame, clew retracts in the pose's
                        c, s = np.cos(pose[0, 2]), np.sin(pose[0, 2])
                        out[:] = (self.root @ jacobian[0] @ [[c, s, 0], [-s, c, 0], [0, 0, 1]]).ravel()
            return True

    problem = pyceres.Problem()
    for block in graph.blocks():
        roots = np.swapaxes(np.linalg.cholesky(block.information), 1, 2)
        for (i, j), z, root in zip(block.keys.tolist(), block.measurement, roots, strict=True):
            problem.add_residual_block(Between(block, z, root), None, [values[i], values[j]])
    problem.set_parameter_block_constant(values[min(values)])
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.SPARSE_NORMAL_CHOLESKY
    options.max_num_iterations, options.num_threads = iterations, 1
    options.initial_trust_region_radius = 1e16  # so that Levenberg-Marquardt takes Gauss-Newton steps
    options.function_tolerance = options.gradient_tolerance = options.parameter_tolerance = 0.0
    options.minimizer_progress_to_stdout = False
    summary = pyceres.SolverSummary()
    pyceres.solve(options, problem, summary)
    steps = max(1, summary.num_successful_steps + summary.num_unsuccessful_steps)
    spent = summary.linear_solver_time_in_seconds + summary.preprocessor_time_in_seconds
    return Run(f"pyceres {version('pyceres')} (linear solver)", spent / steps, 2.0 * summary.final_cost)


def repeat(run: Callable[[Path, bool, int], Run], path: Path, solid: bool, iterations: int,
           repeats: int) -> Run:
    """The fastest of some runs in one process."""
    return min((run(path, solid, iterations) for _ in range(repeats)), key=lambda r: r.seconds_per_iteration)


PEERS: dict[str, Callable[[Path, bool, int], Run]] = {
    "gtsam": run_gtsam, "g2o": run_g2o, "pyceres": run_ceres,
}


def marginals_clew(path: Path) -> float:
    """Seconds for the covariances of all poses, linearisation and factorisation included."""
    import clew
    from clew.io import read_graph

    solution = clew.optimize(read_graph(path).graph, init="file")
    start = time.process_time()
    solution.covariances()
    return time.process_time() - start


def marginals_gtsam(path: Path, solid: bool, sample: int) -> float:
    """Seconds for the covariances of all poses, from those of an evenly spaced sample."""
    import gtsam

    graph, values = gtsam.readG2o(str(path), solid)
    keys = sorted(values.keys())
    noise = gtsam.noiseModel.Isotropic.Sigma(6 if solid else 3, 1e-6)
    prior = (gtsam.PriorFactorPose3(keys[0], values.atPose3(keys[0]), noise) if solid
             else gtsam.PriorFactorPose2(keys[0], values.atPose2(keys[0]), noise))
    graph.add(prior)
    start = time.process_time()
    marginals = gtsam.Marginals(graph, values)
    ready = time.process_time()
    chosen = keys[::max(1, len(keys) // sample)]
    for key in chosen:
        marginals.marginalCovariance(key)
    return (ready - start) + (time.process_time() - ready) * len(keys) / len(chosen)
