"""The result of a solve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry import SE2, SE3
from clew.graph import FactorGraph
from clew.solve.gauge import Part
from clew.solve.posterior import NO_COVARIANCE, Posterior
from clew.solve.status import Status

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """What a solve found; made by `optimize`.

    Attributes:
        status: how the solve ended; ``status.value`` is a sentence.
        chi2_history: cost of the initial guess and after each accepted step, ``sum rho(e^T Omega e)``.
        iterations: steps tried.
        init: initial guess that was used ("file", "tree", "rotation" or "sequential").
        seconds: time by stage: compile, initialise, linearise, factorise, total.
        free_parts: connected parts of the graph that, at the initial values, nothing ties to the world, and
            what was held.
        diagnosis: sentences about what the measurements leave open, gauge included; empty if all is well.
        posterior: the Gaussian around the minimum.
    """

    status: Status
    chi2_history: tuple[float, ...]
    iterations: int
    init: str
    seconds: Mapping[str, float]
    free_parts: tuple[Part, ...]
    diagnosis: tuple[str, ...]
    posterior: Posterior
    _graph: FactorGraph
    _structure: int

    @property
    def chi2(self) -> float:
        """Cost at the solution."""
        return self.chi2_history[-1]

    @property
    def chi2_initial(self) -> float:
        """Cost of the initial guess."""
        return self.chi2_history[0]

    # --- values
    # ------------------------------------------------------------------------------------------------

    @property
    def kinds(self) -> tuple[type[Any], ...]:
        """Manifolds of the variables that occur."""
        return tuple(table.kind for table in self.posterior.problem.tables)

    def keys(self, kind: type[Any] | None = None) -> Index:
        """Keys of all variables of one kind, in the order of addition; by default of the poses."""
        keys: Index = self.posterior.problem.tables[self._table(kind)].keys.copy()
        return keys

    def value(self, key: int) -> Any:
        """Value of one variable, as the type that it was added as."""
        table, row = self._locate(key)
        kind = self.posterior.problem.tables[table].kind
        return kind.from_array(self.posterior.values[table][row])

    def values(self, kind: type[Any] | None = None) -> Any:
        """Values of all variables of one kind as a batch, in the order of `keys`; by default the poses."""
        table = self._table(kind)
        return self.posterior.problem.tables[table].kind.from_array(self.posterior.values[table])

    def apply(self, graph: FactorGraph) -> None:
        """Write the values into a graph that has these variables.

        Raises:
            InputError: a variable that the graph does not have.
        """
        for table, values in zip(self.posterior.problem.tables, self.posterior.values, strict=True):
            graph.set_values(table.keys, values)

    @cached_property
    def graph(self) -> FactorGraph:
        """A copy of the graph with the values of the solution.

        Raises:
            InputError: variables or factors of the graph changed since; use `apply`.
        """
        if self._graph.structure != self._structure:
            raise InputError(
                "the graph has changed since it was solved; take what you need with Solution.apply"
            )
        twin = self._graph.copy()
        self.apply(twin)
        return twin

    # --- covariance
    # --------------------------------------------------------------------------------------------

    def covariance(self, key: int) -> Array:
        """Marginal covariance ``(dim, dim)`` of one variable, in the tangent of `retract`; zero if it was
        held.

        Raises:
            InputError: an unknown key, or measurements that leave variables free.
        """
        return self.joint_covariance([key])

    def covariances(self, kind: type[Any] | None = None) -> Array:
        """Marginal covariances ``(N, dim, dim)`` of all variables of one kind, in the order of `keys`.

        They come from the selected inverse, for little more than one factorisation.

        Raises:
            InputError: no such kind, or measurements that leave variables free.
        """
        return self._determined().marginals(self._table(kind))

    def joint_covariance(self, keys: ArrayLike) -> Array:
        """Dense covariance of several variables together, blocks in the order of `keys`."""
        places = [self._locate(int(key)) for key in np.asarray(keys).reshape(-1)]
        problem = self.posterior.problem
        columns = np.array([problem.columns[table][row] for table, row in places], np.int64)
        sizes = np.array([problem.tables[table].kind.dim for table, _ in places], np.int64)
        return self._determined().joint(columns, sizes)

    def _determined(self) -> Posterior:
        if self.status is Status.UNDERCONSTRAINED:  # rounding may have made the factorisation pass
            raise InputError(NO_COVARIANCE)
        return self.posterior

    # --- for people
    # --------------------------------------------------------------------------------------------

    def __str__(self) -> str:
        lines = [
            self.status.value,
            f"chi2 {self.chi2_initial:.6g} -> {self.chi2:.6g} in {self.iterations} iterations "
            f"({1e3 * self.seconds['total']:.1f} ms), initial guess: {self.init}",
        ]
        return "\n".join([*lines, *self.diagnosis])

    def __repr__(self) -> str:
        return f"<Solution: {self.status.name}, chi2 {self.chi2:.6g}, {self.iterations} iterations>"

    # --- looking up
    # --------------------------------------------------------------------------------------------

    @cached_property
    def _sorted(self) -> list[tuple[Index, Index]]:
        orders = [np.argsort(table.keys, kind="stable") for table in self.posterior.problem.tables]
        return [
            (table.keys[order], order)
            for table, order in zip(self.posterior.problem.tables, orders, strict=True)
        ]

    def _locate(self, key: int) -> tuple[int, int]:
        for number, (keys, order) in enumerate(self._sorted):
            place = int(np.searchsorted(keys, key))
            if place < len(keys) and keys[place] == key:
                return number, int(order[place])
        raise InputError(f"the solution has no variable with key {key}")

    def _table(self, kind: type[Any] | None) -> int:
        kinds = [table.kind for table in self.posterior.problem.tables]
        candidates = (
            [k for k in kinds if k in (SE2, SE3)] or kinds
            if kind is None
            else [k for k in kinds if k is kind]
        )
        if len(candidates) != 1:
            have = ", ".join(k.__name__ for k in kinds) or "no variables"
            raise InputError(f"say which kind of variable; the solution has {have}")
        return kinds.index(candidates[0])
