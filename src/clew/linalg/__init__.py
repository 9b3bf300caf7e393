"""Block-sparse patterns, elimination ordering, Cholesky factor, selected inverse."""

from clew.linalg.factor import Factor, FactorStatus
from clew.linalg.fill import factor_blocks
from clew.linalg.pattern import BlockPattern
from clew.linalg.symbolic import SymbolicFactor, analyse

__all__ = ["BlockPattern", "Factor", "FactorStatus", "SymbolicFactor", "analyse", "factor_blocks"]
