"""What a pose-graph file holds."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.graph import FactorGraph

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Features:
    """Landmarks seen from poses, whose identity the file does not tell (``DATA_FEATURE_POINTXY``).

    Attributes:
        keys: ``(M,)`` pose from which each was seen.
        measurement: ``(M, 2)`` where, in the frame of the pose, metres.
        information: ``(M, 2, 2)``.
    """

    keys: Indices
    measurement: Array
    information: Array


@dataclass(frozen=True, eq=False)
class GraphReport:
    """What the reader met besides what it understood.

    Attributes:
        unknown: lines with unknown tags, as (number, text), in the order of the file.
        reduced: numbers of the lines whose information is indefinite; their translation and rotation blocks
            are used without what couples the two.
        created: keys that edges refer to without a vertex line; they start at the identity.
        repeated: numbers of the lines that define a vertex again; the first definition counts.
        fixed: keys that the file holds constant (``FIX``).
    """

    unknown: tuple[tuple[int, str], ...] = ()
    reduced: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    created: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    repeated: Indices = field(default_factory=lambda: np.empty(0, np.int64))
    fixed: Indices = field(default_factory=lambda: np.empty(0, np.int64))

    @property
    def unknown_tags(self) -> Counter[str]:
        """How many lines there are of each unknown tag."""
        return Counter(re.split(r"[ \t\r\v\f]", text, maxsplit=1)[0] for _, text in self.unknown)


@dataclass(frozen=True, eq=False)
class GraphFile:
    """A pose graph read from a file.

    Attributes:
        path: where it came from.
        graph: its variables (keys are the vertex ids) and factors.
        report: what was set aside, repaired or missing.
        has_values: whether the file gives values of vertices; if not, all are at the identity and a solver
            has to make its own initial guess.
        features: sightings without association, or None.
    """

    path: Path
    graph: FactorGraph
    report: GraphReport
    has_values: bool
    features: Features | None
