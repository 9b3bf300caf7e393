"""Another way down where the first one ended badly.

Rotations first, or a spanning tree, start the solve well as long as the measurements agree with each other
roughly. Where they do not, the solve may end in a wrong minimum, or creep through a curved valley. The fit
tells: noise alone gives a cost of about one a degree of freedom. Then the solve starts again from rotations and
translations found at once (`joint_guess`), which costs little, and where the fit is poor from a graph that grows from
its first pose (`sequential_guess`), by the dogleg, which follows curved valleys with fewer steps than
Levenberg-Marquardt.
"""

from __future__ import annotations

from collections.abc import Iterator

from clew.noise import Kernel
from clew.solve.joint import joint_guess
from clew.solve.landmarks import place_landmarks
from clew.solve.loop import Callback, Stopping, Trace, iterate
from clew.solve.problem import Problem, Values
from clew.solve.relations import relations
from clew.solve.search import Dogleg, Search
from clew.solve.sequential import sequential_guess
from clew.solve.status import Status

#: Cost a degree of freedom from which the solve starts again, and from which growing the graph is worth its time.
_DOUBTFUL, _POOR = 1.2, 2.0
_LARGEST = 200_000  # scalars; growing a graph costs several solves


def doubtful(problem: Problem, trace: Trace, iterations: int = 50) -> bool:
    """Whether the solve crept for that many iterations, or the measurements contradict its end."""
    if trace.status not in (Status.CONVERGED, Status.MAX_ITERATIONS, Status.STALLED):
        return False
    crept = trace.status is not Status.CONVERGED and trace.iterations >= iterations
    return crept or (trace.status is not Status.MAX_ITERATIONS and _misfit(problem, trace) > _DOUBTFUL)


def _misfit(problem: Problem, trace: Trace) -> float:
    """Cost a degree of freedom."""
    numbers = sum(block.factor.information[:, 0].size for block in problem.blocks)
    return trace.chi2[-1] / max(numbers - problem.pattern.dim, 1)


def second_try(
    problem: Problem,
    current: Values,
    first: tuple[Trace, str, Search],
    robust: Kernel | None,
    stopping: Stopping,
    callback: Callback | None,
) -> tuple[Trace, str, Search]:
    """The lowest of the first result, its continuation, and the solves from other guesses.

    Args:
        problem: the compiled graph.
        current: values that the graph has.
        first: how the first solve ended, from which guess, and its search.
        robust: kernel of the solve.
        stopping: of each try.
        callback: told about all steps.

    Returns:
        A trace, the name of its guess and its search; iterations of all tries are counted.
    """
    trace, guess, _ = first
    best, spent = first, trace.iterations
    for values, name in _starts(problem, current, trace, guess, robust):
        search = Dogleg()
        again = iterate(problem, values, robust, search, stopping, callback)
        spent += again.iterations
        if again.chi2[-1] < best[0].chi2[-1] * (1.0 - stopping.cost):
            best = again, name, search
        if again.status is Status.STOPPED:
            break
    best[0].iterations = spent
    return best


def _starts(
    problem: Problem, current: Values, trace: Trace, guess: str, robust: Kernel | None
) -> Iterator[tuple[Values, str]]:
    """Values to start from and the names of their guesses, one after the other."""
    if trace.status is not Status.CONVERGED:
        yield trace.values, guess
    found = relations(problem, current)
    if len(found) != 1 or problem.pattern.dim > _LARGEST:
        return
    poses = joint_guess(problem, found[0])
    if poses is not None:
        values = list(current)
        values[found[0].table] = poses
        yield place_landmarks(problem, values), "joint"
    poor = trace.status is not Status.CONVERGED or _misfit(problem, trace) > _POOR
    if poor and guess != "sequential":
        yield sequential_guess(problem, current, found[0], robust), "sequential"
