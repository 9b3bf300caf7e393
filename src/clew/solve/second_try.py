"""Another way down where the first one ended badly.

Rotations first, or a spanning tree, start the solve well as long as the measurements agree with each other
roughly. Where they do not, the solve may end in a wrong minimum, or creep through a curved valley. The fit
tells: noise alone gives a cost of about one a degree of freedom. Then a graph that grows from its first pose
(`sequential_guess`) is solved as well, by the dogleg, which follows curved valleys with fewer steps than
Levenberg-Marquardt.
"""

from __future__ import annotations

from clew.noise import Kernel
from clew.solve.loop import Callback, Stopping, Trace, iterate
from clew.solve.problem import Problem, Values
from clew.solve.relations import relations
from clew.solve.search import Dogleg, Search
from clew.solve.sequential import sequential_guess
from clew.solve.status import Status

_POOR = 3.0  # cost a degree of freedom
_LARGEST = 200_000  # scalars; growing a graph costs several solves


def doubtful(problem: Problem, trace: Trace, iterations: int = 50) -> bool:
    """Whether the solve crept for that many iterations, or the measurements contradict its end."""
    if trace.status not in (Status.CONVERGED, Status.MAX_ITERATIONS, Status.STALLED):
        return False
    numbers = sum(block.factor.information[:, 0].size for block in problem.blocks)
    poor = trace.chi2[-1] > _POOR * max(numbers - problem.pattern.dim, 1)
    crept = trace.status is not Status.CONVERGED and trace.iterations >= iterations
    return crept or (poor and trace.status is not Status.MAX_ITERATIONS)


def second_try(
    problem: Problem,
    current: Values,
    first: tuple[Trace, str, Search],
    robust: Kernel | None,
    stopping: Stopping,
    callback: Callback | None,
) -> tuple[Trace, str, Search]:
    """The lowest of the first result, its continuation, and the solve of a graph that grew.

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
    starts = [] if trace.status is Status.CONVERGED else [(trace.values, guess)]
    found = relations(problem, current)
    if len(found) == 1 and guess != "sequential" and problem.pattern.dim <= _LARGEST:
        starts.append((sequential_guess(problem, current, found[0], robust), "sequential"))
    best, spent = first, trace.iterations
    for values, name in starts:
        search = Dogleg()
        again = iterate(problem, values, robust, search, stopping, callback)
        spent += again.iterations
        if again.chi2[-1] < best[0].chi2[-1] * (1.0 - stopping.cost):
            best = again, name, search
        if again.status is Status.STOPPED:
            break
    best[0].iterations = spent
    return best
