"""Block-sparse patterns, elimination ordering, Cholesky factor, selected inverse."""

from clew.linalg.factor import Factor, FactorStatus, SymbolicFactor, analyse
from clew.linalg.pattern import BlockPattern

__all__ = ["BlockPattern", "Factor", "FactorStatus", "SymbolicFactor", "analyse"]
