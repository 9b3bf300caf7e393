"""Elimination orders: approximate minimum degree, and nested dissection where it saves work."""

from __future__ import annotations

import numpy as np

from clew import _native
from clew.errors import InputError, MissingDependencyError
from clew.linalg.pattern import Ints

ORDERINGS = ("auto", "amd", "metis", "natural")

#: Flops a variable below which nested dissection takes longer than it saves in some six factorisations.
WORTH_DISSECTION = 1e5


def choose_order(analysis: _native.linalg.Analysis, variables: int, ordering: str) -> tuple[Ints, str]:
    """Elimination order (position to variable) and the name of the method that found it.

    "auto" takes minimum degree, or nested dissection where that is worth trying, METIS is installed and the
    predicted work is lower.

    Raises:
        InputError: an unknown ordering.
        MissingDependencyError: "metis" without pymetis.
    """
    if ordering not in ORDERINGS:
        raise InputError(f"ordering is {ordering!r}; choose one of {', '.join(ORDERINGS)}")
    if ordering == "natural":
        return np.arange(variables, dtype=np.int32), ordering
    if ordering == "metis":
        order = _nested_dissection(analysis, variables)
        if order is None:
            raise MissingDependencyError(
                "ordering 'metis' needs pymetis 2025.2 or later; run: pip install 'clew[metis]'"
            )
        return order, ordering
    by_degree = analysis.amd()
    if ordering == "auto":
        work = analysis.flops(by_degree)
        dissected = _nested_dissection(analysis, variables) if work > WORTH_DISSECTION * variables else None
        if dissected is not None and analysis.flops(dissected) < work:
            return dissected, "metis"
    return by_degree, "amd"


def _nested_dissection(analysis: _native.linalg.Analysis, variables: int) -> Ints | None:
    """Order by METIS (Karypis, Kumar, SIAM J. Sci. Comput. 20, 1998); None without a recent pymetis."""
    try:
        from pymetis import CSRAdjacency, nested_dissection
    except ImportError:
        return None
    if variables < 2:
        return np.arange(variables, dtype=np.int32)
    starts, neighbours = analysis.adjacency()
    order, _ = nested_dissection(CSRAdjacency(starts, neighbours))
    return np.ascontiguousarray(order, dtype=np.int32)
