"""Initial guess by growing the graph: what a filter would have known, a few poses at a time.

Landmarks that are seen again only much later do not correct a guess made of odometry, and from a bent
trajectory the solve ends in a wrong minimum. A graph that grows from its first pose never bends far: each
piece of odometry starts from where the measurements so far put its beginning (as in incremental smoothing,
Kaess, Ranganathan, Dellaert, "iSAM", IEEE Transactions on Robotics 2008, but in a fixed number of batches).
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from clew import _native
from clew.geometry import SE2, SE3
from clew.graph import Factor, FactorGraph
from clew.noise import Kernel
from clew.solve.gauge import find_gauge
from clew.solve.landmarks import Flags, sighted_landmarks
from clew.solve.loop import Stopping, iterate
from clew.solve.problem import Problem, Values, build_problem, values_of
from clew.solve.relations import Relations
from clew.solve.search import LevenbergMarquardt
from clew.solve.tree import span

#: Batches in which the poses come. Four are enough for Victoria Park; each costs a small solve.
BATCHES = 32
_STOPPING = Stopping(max_iterations=10, cost=1e-3, step=1e-4)


def sequential_guess(problem: Problem, current: Values, relations: Relations, robust: Kernel | None) -> Values:
    """Values of all variables: poses along a spanning tree, corrected batch by batch by what they see.

    Landmarks enter with their first sighting by point, or by range and bearing; others keep their values.

    Args:
        problem: the compiled graph.
        current: values that the graph has.
        relations: of its only kind of pose.
        robust: kernel that the corrections are solved with.
    """
    values = [array.copy() for array in current]
    poses = relations.table
    values[poses] = relations.start.copy()
    (node, parent, edge, forward, _), measurement = span(relations, robust is not None)
    known = [columns < 0 for columns in problem.columns]  # landmarks of a given map count from the start
    known[poses][:] = False
    for batch in np.array_split(np.arange(len(node)), min(BATCHES, len(node))):
        _native.solve.compose_tree(
            node[batch], parent[batch], edge[batch], forward[batch], measurement, values[poses]
        )
        known[poses][node[batch]] = True
        _place_new(problem, values, known)
        _correct(problem, values, known, robust)
    return values


def _place_new(problem: Problem, values: Values, known: list[Flags]) -> None:
    """Put landmarks where the first known pose that sees them says."""
    placed, found = sighted_landmarks(problem, values, known)
    for array, new, flags, now in zip(values, placed, known, found, strict=True):
        fresh = now & ~flags
        array[fresh] = new[fresh]
        flags |= now


def _correct(problem: Problem, values: Values, known: list[Flags], robust: Kernel | None) -> None:
    """Solve for the known variables with the factors between them."""
    part = FactorGraph()
    for table, array, flags, columns in zip(problem.tables, values, known, problem.columns, strict=True):
        keys: Any = table.keys[flags]
        if len(keys):
            add = part.add_pose if table.kind in (SE2, SE3) else part.add_point
            add(table.kind.from_array(array[flags]), key=keys)
            part.set_constant(keys[columns[flags] < 0])
    for block in problem.blocks:
        whole = np.all([known[n][block.rows[:, p]] for p, n in enumerate(block.tables)], axis=0)
        if whole.any():
            part.add(_some(block.factor, whole))
    small = build_problem(part, find_gauge(part).held, problem.ordering, problem.threads)
    trace = iterate(small, values_of(part), robust, LevenbergMarquardt(), _STOPPING)
    number_of = {table.kind: number for number, table in enumerate(problem.tables)}
    for table, array in zip(small.tables, trace.values, strict=True):
        number = number_of[table.kind]
        values[number][known[number]] = array


def _some(factor: Factor, rows: Flags) -> Factor:
    """A block with some of its measurements."""
    part: Any = copy.copy(factor)
    for name in ("keys", "measurement", "information"):
        object.__setattr__(part, name, getattr(factor, name)[rows])  # a factor may be a frozen dataclass
    return part  # type: ignore[no-any-return]  # Any only to set read-only fields
