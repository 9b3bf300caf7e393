"""What the measurements leave open, in words: which variables, which directions, what would help."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import SE2, SE3
from clew.solve.gauge import Gauge
from clew.solve.nullspace import WIDTH, flat_directions, local_directions, looks_singular
from clew.solve.posterior import Posterior
from clew.solve.problem import Problem
from clew.solve.search import Search
from clew.solve.status import Status

Array = NDArray[np.float64]

_SHOWN = 5
_AXES = {
    2: ("x", "y", "heading"),
    3: ("x", "y", "z", "rotation about x", "rotation about y", "rotation about z"),
}


def diagnose(
    posterior: Posterior, gauge: Gauge, status: Status, search: Search
) -> tuple[Status, tuple[str, ...]]:
    """The status after a look at what is left open, and sentences about it.

    Args:
        posterior: the Gaussian at the values where the solve ended.
        gauge: the parts of the graph that nothing ties down.
        status: how the iteration ended.
        search: with its last factor.
    """
    held = [str(part) for part in gauge.parts if part.held]
    sentences = _first(held, "parts of the graph")
    if len(held) > 1:
        sentences.append(
            f"These {len(held)} parts share no measurement, so how they lie to each other is arbitrary; add a "
            "measurement between them, or a Prior in each."
        )
    open_parts = [part for part in gauge.parts if not part.held]
    problem = posterior.problem
    if not problem.pattern.dim or status is Status.NOT_FINITE:
        return status, tuple(sentences)
    singular = status is Status.UNDERCONSTRAINED or bool(open_parts)
    if not singular and looks_singular(problem, posterior.system, search.factor, search.damping):
        singular = looks_singular(problem, posterior.system, posterior.factor, 0.0)
    if not singular:
        return status, tuple(sentences)
    flat = flat_directions(problem, posterior.system)
    if flat.shape[1]:
        status = Status.UNDERCONSTRAINED
        sentences += _first([str(part) for part in open_parts], "parts of the graph")
        if flat.shape[1] > sum(len(part.directions) for part in open_parts):
            sentences += _name(problem, flat)
    elif status is Status.UNDERCONSTRAINED:
        sentences.append(
            "The Hessian is not positive definite although no direction is free: some information "
            "matrix is indefinite."
        )
    return status, tuple(sentences)


def _name(problem: Problem, flat: Array) -> list[str]:
    """Sentences about the variables that the flat directions move."""
    factors, residuals = _involvement(problem)
    sentences = []
    for column, directions in local_directions(problem, flat):
        kind = problem.kind_of(column)
        what = "Pose" if kind in (SE2, SE3) else "Landmark"
        count, rows = int(factors[column]), int(residuals[column])
        if rows < kind.dim:
            why = (
                f"it has {kind.dim} coordinates, but {count} factor{'s' * (count != 1)} with {rows} "
                f"number{'s' * (rows != 1)} in all"
            )
            cure = "add another measurement of it, or a Prior"
        else:
            why = f"its {count} factors do not see this"
            cure = "add a measurement that does, or a Prior"
        if len(directions) == kind.dim:
            where = "in every direction"
        else:
            where = " and ".join("along " + _direction(d, kind.space) for d in directions)
        sentences.append(f"{what} {problem.key_of(column)} ({kind.__name__}) is free {where}: {why}; {cure}.")
    total = f"at least {WIDTH}" if flat.shape[1] == WIDTH else str(flat.shape[1])
    return [*_first(sentences, "variables"), f"Free directions in all: {total}."]


def _direction(direction: Array, space: int) -> str:
    """A tangent direction as its axes with their shares."""
    direction = direction * np.sign(direction[np.argmax(np.abs(direction))])
    names = _AXES[space]
    terms = [(names[k], direction[k]) for k in range(len(direction)) if abs(direction[k]) > 0.05]
    if len(terms) == 1:
        return terms[0][0]
    return "(" + ", ".join(f"{name} {share:.2f}" for name, share in terms) + ")"


def _involvement(problem: Problem) -> tuple[Array, Array]:
    """Number of factors, and of residuals with information, that each column takes part in."""
    factors = np.zeros(len(problem.row_of))
    residuals = np.zeros(len(problem.row_of))
    for block in problem.blocks:
        rank = np.linalg.matrix_rank(block.factor.information, hermitian=True)
        for position, table in enumerate(block.tables):
            columns = problem.columns[table][block.rows[:, position]]
            free = columns >= 0
            np.add.at(factors, columns[free], 1)
            np.add.at(residuals, columns[free], rank[free])
    return factors, residuals


def _first(sentences: list[str], what: str) -> list[str]:
    """The first few, and how many more there are."""
    if len(sentences) <= _SHOWN:
        return sentences
    return [*sentences[:_SHOWN], f"... and {len(sentences) - _SHOWN:,} more {what} like these."]
