"""Where to start: the current values, a spanning tree, or rotations first."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from clew.noise import Kernel
from clew.solve.landmarks import place_landmarks
from clew.solve.problem import Problem, Values
from clew.solve.relations import Relations, relations
from clew.solve.rotation import rotation_guess
from clew.solve.tree import tree_guess

Array = NDArray[np.float64]


def initial_guess(problem: Problem, current: Values, init: str, robust: Kernel | None) -> tuple[Values, str]:
    """Values to start from, and the name of the guess that they are.

    A guess that the graph does not admit (no relative poses, a pose that hangs on none) falls back to a
    simpler one.

    Args:
        problem: the compiled graph.
        current: values that the graph has.
        init: "file", "tree", "rotation", or "auto" for the one of lowest cost.
        robust: kernel that the cost is taken with.
    """
    if init == "file" or not problem.pattern.dim:
        return current, "file"
    found = relations(problem, current)
    guesses: dict[str, Callable[[Relations], Array | None]] = {
        "tree": lambda r: tree_guess(r, robust is not None),
        "rotation": lambda r: rotation_guess(r, problem.ordering, problem.threads),
    }
    candidates = []
    for name, guess in guesses.items():
        poses = [guess(r) for r in found] if init in (name, "auto") else []
        if poses and all(p is not None for p in poses):
            values = list(current)
            for relation, array in zip(found, poses, strict=True):
                assert array is not None
                values[relation.table] = array
            candidates.append((place_landmarks(problem, values), name))
    if init == "auto" or not candidates:
        candidates.append((current, "file"))
    if len(candidates) == 1:
        return candidates[0]
    costs = [problem.evaluate(values, robust) for values, _ in candidates]
    return candidates[int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))]
