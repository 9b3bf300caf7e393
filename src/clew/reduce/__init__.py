"""Smaller graphs that say the same: variables taken out, with what they knew kept."""

from clew.reduce.fuse import fuse_parallel
from clew.reduce.marginalise import Marginalised, marginalise

__all__ = ["Marginalised", "fuse_parallel", "marginalise"]
