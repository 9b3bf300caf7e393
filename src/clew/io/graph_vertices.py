"""Gathers the variables of a graph file before they go into a graph."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import SE2, SE3
from clew.graph import FactorGraph

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Vertices:
    """Vertices that a file defines, and those that it only mentions.

    Attributes, after `fill`:
        created: sorted keys of vertices without a definition.
        repeated: sorted lines that define a vertex again.
        has_values: whether any vertex is defined.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._kinds: list[type[Any]] = []
        self._defined: list[tuple[type[Any], Indices, Indices, Array]] = []
        self._mentioned: list[tuple[type[Any], Indices, Indices, str]] = []
        self.created: Indices = np.empty(0, np.int64)
        self.repeated: Indices = np.empty(0, np.int64)
        self.has_values = False

    def define(self, kind: type[Any], keys: Indices, lines: Indices, values: Array) -> None:
        """Vertices with their lines ``(N,)`` and values ``(N, storage)``."""
        self._defined.append((kind, keys, lines, values))

    def mention(self, kind: type[Any], keys: Indices, lines: Indices, tag: str) -> None:
        """Vertices that edges of a kind refer to."""
        self._mentioned.append((kind, keys, lines, tag))

    def fill(self, graph: FactorGraph) -> None:
        """Add all vertices to a graph: those of one kind in the order of the file, created ones by their ids.

        Raises:
            InputError: a vertex is used as two kinds.
        """
        self.has_values = bool(self._defined)
        repeated: list[Indices] = []
        for kind in dict.fromkeys(entry[0] for entry in self._defined):
            parts = [entry[1:] for entry in self._defined if entry[0] is kind]
            keys, lines, values = (np.concatenate(columns) for columns in zip(*parts, strict=True))
            order = np.argsort(lines)
            _, first = np.unique(keys[order], return_index=True)
            chosen = order[np.sort(first)]
            repeated.append(np.setdiff1d(lines, lines[chosen]))
            self._check_free(graph, keys[chosen], lines[chosen], kind)
            self._add(graph, kind, keys[chosen], values[chosen])
        created: list[Indices] = []
        for kind, keys, lines, tag in self._mentioned:
            order = np.sort(graph.keys(kind))
            place = np.searchsorted(order, keys)
            known = np.zeros(len(keys), dtype=bool)
            if len(order):
                known = order[np.minimum(place, len(order) - 1)] == keys
            if known.all():
                continue
            new = keys[~known]
            self._check_free(graph, new, lines[~known], kind, tag)
            unique = np.unique(new)
            self._add(graph, kind, unique, kind.identity((len(unique),)).array)
            created.append(unique)
        self.created = np.sort(np.concatenate([*created, np.empty(0, np.int64)]))
        self.repeated = np.sort(np.concatenate([*repeated, np.empty(0, np.int64)]))

    def _check_free(self, graph: FactorGraph, keys: Indices, lines: Indices, kind: type[Any],
                    tag: str = "the line") -> None:
        taken = np.flatnonzero(np.isin(keys, graph.keys()))
        if len(taken):
            key = int(keys[taken[0]])
            raise InputError(f"{self._path}, line {lines[taken[0]]}: {tag} takes vertex {key} for a "
                             f"{kind.name}, but it is a {graph.kind(key).name}; correct the id")

    @staticmethod
    def _add(graph: FactorGraph, kind: type[Any], keys: Indices, values: Array) -> None:
        batch = kind.from_array(values)
        if kind in (SE2, SE3):
            graph.add_pose(batch, key=keys)
        else:
            graph.add_point(batch, key=keys)
