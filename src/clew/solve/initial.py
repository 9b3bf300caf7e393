"""Where to start: the current values, a spanning tree, rotations first, or a graph that grows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from clew.geometry import SE2, SE3
from clew.noise import Kernel
from clew.solve.joint import joint_guess
from clew.solve.landmarks import place_landmarks
from clew.solve.problem import Problem, Values
from clew.solve.relations import Relations, relations
from clew.solve.rotation import rotation_guess
from clew.solve.sequential import sequential_guess
from clew.solve.tree import tree_guess

Array = NDArray[np.float64]

#: Cost for each number measured above which a guess is poor: noise alone gives about one.
_POOR = 10.0


def initial_guess(problem: Problem, current: Values, init: str, robust: Kernel | None) -> tuple[Values, str]:
    """Values to start from, and the name of the guess that they are.

    A guess that the graph does not admit (no relative poses, a pose that hangs on none) falls back to a
    simpler one.

    Args:
        problem: the compiled graph.
        current: values that the graph has.
        init: "file", "tree", "rotation", "joint", "sequential", or "auto" for the one of lowest cost. The sequential
            guess costs as much as some solves; "auto" tries it where there are landmarks and the others are
            poor. It leaves the joint guess to the second try.
        robust: kernel that the cost is taken with.
    """
    if init == "file" or not problem.pattern.dim:
        return current, "file"
    found = relations(problem, current)
    guesses: dict[str, Callable[[Relations], Array | None]] = {
        "tree": lambda r: tree_guess(r, robust is not None),
        "rotation": lambda r: rotation_guess(problem, r),
        "joint": lambda r: joint_guess(problem, r),
    }
    wanted = ("tree", "rotation") if init == "auto" else (init,)
    candidates = []
    for name, guess in guesses.items():
        poses = [guess(r) for r in found] if name in wanted else []
        if poses and all(p is not None for p in poses):
            values = list(current)
            for relation, array in zip(found, poses, strict=True):
                assert array is not None
                values[relation.table] = array
            candidates.append((place_landmarks(problem, values), name))
    grows = len(found) == 1 and _sees_points(problem)
    if init == "sequential" and grows:
        return sequential_guess(problem, current, found[0], robust), init
    if init == "auto" or not candidates:
        candidates.append((current, "file"))
    if len(candidates) == 1:
        return candidates[0]
    costs = [_cost(problem, values, robust) for values, _ in candidates]
    best = int(np.argmin(costs))
    numbers = sum(block.factor.information[:, 0].size for block in problem.blocks)
    if grows and not problem.evaluate(candidates[best][0], None) <= _POOR * numbers:
        grown = sequential_guess(problem, current, found[0], robust)
        if _cost(problem, grown, robust) < costs[best]:
            return grown, "sequential"
    return candidates[best]


def _cost(problem: Problem, values: Values, robust: Kernel | None) -> float:
    cost = problem.evaluate(values, robust)
    return cost if np.isfinite(cost) else np.inf


def _sees_points(problem: Problem) -> bool:
    return any(set(b.factor.kinds) & {SE2, SE3} and set(b.factor.kinds) - {SE2, SE3} for b in problem.blocks)
