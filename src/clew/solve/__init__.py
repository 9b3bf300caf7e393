"""Non-linear least squares on factor graphs: compile, initialise, optimise, covariance, diagnosis."""

from clew.solve.aligned import AlignedCovariances, aligned_covariances
from clew.solve.gauge import Part
from clew.solve.loop import Progress
from clew.solve.optimize import compile_graph, optimize
from clew.solve.problem import Problem
from clew.solve.recounted import recounted
from clew.solve.solution import Solution
from clew.solve.status import Status

__all__ = [
    "AlignedCovariances",
    "Part",
    "Problem",
    "Progress",
    "Solution",
    "Status",
    "aligned_covariances",
    "compile_graph",
    "optimize",
    "recounted",
]
