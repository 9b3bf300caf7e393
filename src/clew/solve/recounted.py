"""A solution whose factors count otherwise in what it is sure of than in how it was found."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from clew.errors import InputError
from clew.graph import Factor
from clew.solve.posterior import Posterior
from clew.solve.problem import kernel_of
from clew.solve.solution import Solution


def recounted(solution: Solution, counted: Sequence[Factor]) -> Solution:
    """The same solution with another Gaussian around it.

    The weights of a robust kernel are right for finding the minimum. As information about it they are too much:
    they are as they would be if it were known which measurements are bad (the complete data of Louis 1982, "Finding the
    observed information matrix when using the EM algorithm").

    Args:
        solution: of a graph that was solved without a kernel for all its factors.
        counted: factors of the graph with the information that they are to count with, without kernels; all factors of
            their type on variables of their kinds, in the order in which the graph has them.

    Raises:
        InputError: measurements that are not those of the graph.
    """
    posterior = solution.posterior
    problem, values = posterior.problem, posterior.values
    system = problem.empty_system()
    for block in problem.blocks:
        factor = block.factor
        others = [other for other in counted if type(other) is type(factor) and other.kinds == factor.kinds]
        if others:
            keys = np.concatenate([other.keys for other in others])
            if not np.array_equal(keys, factor.keys):
                raise InputError(f"recounted: give all {len(factor)} {type(factor).__name__} of the graph in its order")
            twin = copy(factor)
            twin.information, twin.kernel = np.concatenate([other.information for other in others]), None
            block = replace(block, factor=twin)
        block.evaluate(values, kernel_of(block, None), system)
    return replace(solution, posterior=Posterior(problem, values, system))
