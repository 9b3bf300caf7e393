"""From a graph to its solution."""

from __future__ import annotations

import time
import weakref
from types import MappingProxyType

from clew.errors import InputError
from clew.graph import FactorGraph
from clew.noise import Kernel
from clew.solve.diagnosis import diagnose
from clew.solve.gauge import Gauge, find_gauge
from clew.solve.initial import initial_guess
from clew.solve.loop import Callback, Stopping, iterate
from clew.solve.posterior import Posterior
from clew.solve.problem import Problem, build_problem, values_of
from clew.solve.search import Dogleg, GaussNewton, LevenbergMarquardt, Search
from clew.solve.second_try import doubtful, second_try
from clew.solve.solution import Solution

_DEFAULT = "levenberg-marquardt"
METHODS: dict[str, type[Search]] = {
    _DEFAULT: LevenbergMarquardt,
    "gauss-newton": GaussNewton,
    "dogleg": Dogleg,
}
GUESSES = ("auto", "file", "tree", "rotation", "joint", "sequential")

# What was compiled last for a graph, as long as its structure and the options of the analysis stand.
_compiled: weakref.WeakKeyDictionary[FactorGraph, tuple[tuple[int, str, int], Problem, Gauge]]
_compiled = weakref.WeakKeyDictionary()


def compile_graph(graph: FactorGraph, ordering: str = "auto", threads: int = 1) -> tuple[Problem, Gauge]:
    """Columns, sparsity and symbolic factor of a graph; kept until its structure changes."""
    name = (graph.structure, ordering, threads)
    known = _compiled.get(graph)
    if known is not None and known[0] == name:
        return known[1], known[2]
    gauge = find_gauge(graph)
    problem = build_problem(graph, gauge.held, ordering, threads)
    _compiled[graph] = (name, problem, gauge)
    return problem, gauge


def optimize(
    graph: FactorGraph,
    *,
    method: str = _DEFAULT,
    init: str = "auto",
    robust: Kernel | None = None,
    max_iterations: int = 100,
    cost_tolerance: float = 1e-10,
    step_tolerance: float = 1e-10,
    gradient_tolerance: float = 1e-11,
    threads: int = 1,
    ordering: str = "auto",
    callback: Callback | None = None,
    update: bool = False,
) -> Solution:
    """Find the values that explain the measurements best.

    Args:
        graph: variables and factors; its values are left alone unless `update` is set.
        method: "levenberg-marquardt", "gauss-newton" or "dogleg".
        init: initial guess. "file" takes the graph's current values, "tree" composes measurements along a
            spanning tree, "rotation" solves for the rotations first and then for the translations, "joint" finds
            rotations and translations at once (for rotations measured much worse than translations), "sequential"
            lets the graph grow from its first pose and corrects the poses batch by batch (for landmarks that are
            seen again late), "auto" takes the one of them with the lowest cost; where the fit that the default
            method ends with is poor, it also solves from the joint and the sequential guess, by the dogleg.
        robust: kernel of all factors without one of their own, priors excepted.
        max_iterations: limit on the steps tried.
        cost_tolerance: relative decrease of the cost that is not worth another iteration.
        step_tolerance: largest change of a coordinate that is not.
        gradient_tolerance: largest entry of the gradient that counts as zero.
        threads: threads of the factorisation.
        ordering: elimination ordering, "auto", "amd", "metis" or "natural".
        callback: called with a `Progress` after each step; returning True stops the solve.
        update: write the solution into the graph.

    Returns:
        The solution; its status says how the solve ended. A graph that nothing ties to the world is solved
        with the first pose of each connected part held, and the solution says so.

    Raises:
        InputError: an option that does not exist.
    """
    if method not in METHODS:
        raise InputError(f"method is {method!r}; choose {', '.join(METHODS)}")
    if init not in GUESSES:
        raise InputError(f"init is {init!r}; choose {', '.join(GUESSES)}")
    if max_iterations < 0:
        raise InputError(f"max_iterations is {max_iterations}; it must not be negative")
    start = time.perf_counter()
    problem, gauge = compile_graph(graph, ordering, threads)
    if problem.pattern.dim:
        _ = problem.symbolic
    compiled = time.perf_counter()
    values, used = initial_guess(problem, values_of(graph), init, robust)
    start_values = [values]
    del values  # the iteration alone holds them, and lets them go with its first step
    initialised = time.perf_counter()
    stopping = Stopping(max_iterations, cost_tolerance, step_tolerance, gradient_tolerance)
    search = METHODS[method]()
    trace = iterate(problem, start_values.pop(), robust, search, stopping, callback)
    if init == "auto" and method == _DEFAULT and doubtful(problem, trace):
        first = trace, used, search
        trace, used, search = second_try(problem, values_of(graph), first, robust, stopping, callback)
    posterior = Posterior(problem, trace.values, trace.system)
    status, diagnosis = diagnose(posterior, gauge, trace.status, search)
    seconds = {
        "compile": compiled - start,
        "initialise": initialised - compiled,
        **trace.seconds,
        "total": time.perf_counter() - start,
    }
    solution = Solution(
        status,
        tuple(trace.chi2),
        trace.iterations,
        used,
        MappingProxyType(seconds),
        gauge.parts,
        diagnosis,
        posterior,
        graph,
        graph.structure,
    )
    if update:
        solution.apply(graph)
    return solution
