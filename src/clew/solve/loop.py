"""The iteration that all searches share: linearise, step, retract, judge, stop."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from clew.noise import Kernel
from clew.solve.evaluate import System
from clew.solve.problem import Problem, Values
from clew.solve.search import Search, largest_of
from clew.solve.status import Status


@dataclass(frozen=True)
class Stopping:
    """When to stop.

    Attributes:
        max_iterations: limit on accepted and rejected steps.
        cost: smallest relative decrease of the cost that is worth another iteration.
        step: smallest change of any coordinate (metres, radians) that is.
        gradient: largest entry of the gradient at which the cost counts as flat.
    """

    max_iterations: int = 100
    cost: float = 1e-10
    step: float = 1e-10
    gradient: float = 1e-11


@dataclass(frozen=True)
class Progress:
    """What a callback sees after each step.

    Attributes:
        iteration: counted from 1.
        chi2: cost after the step, or before it if it was rejected.
        accepted: whether the step was taken.
        largest_step: largest entry of the step.
    """

    iteration: int
    chi2: float
    accepted: bool
    largest_step: float


@dataclass(eq=False)
class Trace:
    """What the iteration leaves behind; `system` holds the normal equations at `values`."""

    values: Values
    chi2: list[float]
    system: System
    status: Status = Status.MAX_ITERATIONS
    iterations: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: {"linearise": 0.0, "factorise": 0.0})


Callback = Callable[[Progress], bool | None]


def iterate(
    problem: Problem,
    values: Values,
    robust: Kernel | None,
    search: Search,
    stopping: Stopping,
    callback: Callback | None = None,
) -> Trace:
    """Minimise the cost from `values` on.

    A callback that returns True stops the iteration.
    """
    clock = _Clock()
    system = problem.empty_system()
    trace = Trace(values, [problem.evaluate(values, robust, system)], system)
    del values  # the caller may have let them go, too
    clock.lap(trace, "linearise")
    if problem.pattern.dim == 0:
        trace.status = Status.NOTHING_TO_DO
        return trace
    if not np.isfinite(trace.chi2[0]):
        trace.status = Status.NOT_FINITE
        return trace
    fresh = True
    while trace.iterations < stopping.max_iterations:
        if fresh and largest_of(system.gradient) <= stopping.gradient:
            trace.status = Status.CONVERGED
            break
        step = search.propose(problem, system, fresh)
        clock.lap(trace, "factorise")
        if step is None:
            finite = np.isfinite(system.hessian).all()
            trace.status = Status.UNDERCONSTRAINED if finite else Status.NOT_FINITE
            break
        trace.iterations += 1
        candidate = problem.retract(trace.values, step.delta)
        chi2 = problem.evaluate(candidate, robust, system)
        before = trace.chi2[-1]
        fresh = search.judge(step, before - chi2)
        largest = largest_of(step.delta)
        if fresh:
            trace.values = candidate
            trace.chi2.append(chi2)
        else:  # rejected steps are rare: linearising again costs less than room for a second system
            problem.evaluate(trace.values, robust, system)
        clock.lap(trace, "linearise")
        if callback is not None and callback(Progress(trace.iterations, trace.chi2[-1], fresh, largest)):
            trace.status = Status.STOPPED
            break
        # A step that promises nothing visible ends the search whether or not rounding made it a decrease.
        small = max(abs(before - chi2), step.predicted) <= stopping.cost * before
        if step.full and (small or largest <= stopping.step):
            trace.status = Status.CONVERGED
            break
        if not fresh and search.exhausted:
            trace.status = Status.STALLED if np.isfinite(chi2) else Status.NOT_FINITE
            break
        del step, candidate  # large, and there will be new ones
    if trace.status is not Status.NOT_FINITE and trace.chi2[-1] > 10.0 * trace.chi2[0] + 1e-9:
        trace.status = Status.DIVERGED
    return trace


class _Clock:
    """Adds the time since the last lap to a stage."""

    def __init__(self) -> None:
        self._last = time.perf_counter()

    def lap(self, trace: Trace, stage: str) -> None:
        now = time.perf_counter()
        trace.seconds[stage] += now - self._last
        self._last = now
