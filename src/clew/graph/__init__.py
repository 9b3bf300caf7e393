"""The factor graph: variables by kind in arrays, factors by kind in blocks."""

from clew.graph.factor import Factor, Role
from clew.graph.factor_graph import FactorGraph
from clew.graph.variables import Variables

__all__ = ["Factor", "FactorGraph", "Role", "Variables"]
