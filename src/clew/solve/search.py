"""How a step is found: Gauss-Newton, Levenberg-Marquardt, Powell's dogleg.

A search proposes a step from the normal equations, and learns from how well the cost followed its prediction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from clew.linalg import Factor, FactorStatus
from clew.solve.evaluate import System
from clew.solve.problem import Problem

Array = NDArray[np.float64]

_RESTING_DAMPING = 1e-12
_WORKING_DAMPING = 1e-6
_LEAP = 1e3  # from rest to work in two steps


@dataclass(frozen=True, eq=False)
class Step:
    """A proposed step in the tangents of the free variables.

    Attributes:
        delta: ``(dim,)``.
        predicted: decrease of the cost that the quadratic model promises.
        full: whether the step is the Newton step or close to it, so that a small decrease means convergence.
    """

    delta: Array
    predicted: float
    full: bool


class Search(Protocol):
    """The part of a solver that turns normal equations into steps.

    Attributes:
        factor: the last factorisation.
        damping: multiple of the diagonal that was added in it.
    """

    factor: Factor | None
    damping: float

    def propose(self, problem: Problem, system: System, fresh: bool) -> Step | None:
        """A step, or None if the system is singular; `fresh` says that it changed since the last call."""
        ...

    def judge(self, step: Step, decrease: float) -> bool:
        """Take the true decrease of the cost and say whether to accept the step."""
        ...

    @property
    def exhausted(self) -> bool:
        """Whether further rejected steps are pointless."""
        ...


@dataclass(eq=False)
class GaussNewton:
    """The full step of the linearised problem, whatever it does to the cost."""

    factor: Factor | None = None
    damping: float = 0.0

    def propose(self, problem: Problem, system: System, fresh: bool) -> Step | None:
        """Solution of ``H step = -g``."""
        self.factor = problem.symbolic.factorize(system.hessian, into=self.factor)
        if self.factor.status is not FactorStatus.OK:
            return None
        delta = self.factor.solve(-system.gradient, overwrite=True)
        return Step(delta, -inner(system.gradient, delta), full=True)

    def judge(self, step: Step, decrease: float) -> bool:
        """Accept any finite cost."""
        return bool(np.isfinite(decrease))

    @property
    def exhausted(self) -> bool:
        """A cost that is not finite ends the search."""
        return True


@dataclass(eq=False)
class LevenbergMarquardt:
    """Gauss-Newton, damped by a multiple of the Hessian's diagonal (Marquardt 1963).

    The damping follows the gain ratio (Nielsen 1999, "Damping parameter in Marquardt's method", eq. 2.5).
    Long chains of poses have eigenvalues that are tiny beside the diagonal, and any visible damping makes
    them crawl; so the damping rests at a value that only guards against rounding, leaps to useful ones when a
    step fails, and relaxes as steps succeed.
    """

    damping: float = _RESTING_DAMPING
    growth: float = 2.0
    factor: Factor | None = None

    def propose(self, problem: Problem, system: System, fresh: bool) -> Step | None:
        """Solution of ``(H + damping D) step = -g``."""
        while not self.exhausted:
            damped = raised_diagonal(problem, system)
            damped *= self.damping
            self.factor = problem.symbolic.factorize(system.hessian, damping=damped, into=self.factor)
            if self.factor.status is FactorStatus.NOT_FINITE:
                return None
            if self.factor.status is FactorStatus.OK:
                delta = self.factor.solve(-system.gradient, overwrite=True)
                damped *= delta
                damped -= system.gradient
                return Step(delta, inner(delta, damped), full=self.damping < 1e-2)
            self._raise()
        return None

    def judge(self, step: Step, decrease: float) -> bool:
        """Accept a decrease; trust the model more or less according to the gain ratio."""
        gain = decrease / step.predicted if step.predicted > 0 else -1.0
        if np.isfinite(gain) and gain > 0:
            self.damping = max(self.damping * max(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), _RESTING_DAMPING)
            self.growth = 2.0
            return True
        self._raise()
        return False

    def _raise(self) -> None:
        self.damping *= _LEAP if self.damping < _WORKING_DAMPING else self.growth
        self.growth *= 2.0

    @property
    def exhausted(self) -> bool:
        """Steps this short change nothing in double precision."""
        return self.damping > 1e16


@dataclass(eq=False)
class Dogleg:
    """Powell's dogleg: along the gradient, then towards the Gauss-Newton step, within a trust region.

    Nocedal and Wright, "Numerical Optimization", 2006, section 4.1, in the norm of the Hessian's diagonal.
    """

    radius: float = np.inf
    factor: Factor | None = None
    damping: float = 0.0
    _newton: Array = field(default_factory=lambda: np.empty(0))
    _cauchy: Array = field(default_factory=lambda: np.empty(0))
    _scale: Array = field(default_factory=lambda: np.empty(0))

    def propose(self, problem: Problem, system: System, fresh: bool) -> Step | None:
        """The minimum of the quadratic model along the dogleg inside the trust region."""
        gradient = system.gradient
        if fresh:
            self.factor = problem.symbolic.factorize(system.hessian, into=self.factor)
            if self.factor.status is not FactorStatus.OK:
                return None
            self._scale = raised_diagonal(problem, system)
            np.sqrt(self._scale, out=self._scale)
            self._newton = self.factor.solve(-gradient, overwrite=True)
            downhill = -gradient / self._scale**2
            curvature = inner(downhill, multiply(problem, system, downhill))
            self._cauchy = downhill * -inner(gradient, downhill) / max(curvature, 1e-300)
        delta, full = self._dogleg()
        predicted = -inner(delta, 2.0 * gradient + multiply(problem, system, delta))
        return Step(delta, predicted, full)

    def _dogleg(self) -> tuple[Array, bool]:
        newton, cauchy = self._scale * self._newton, self._scale * self._cauchy
        if length_of(newton) <= self.radius:
            return self._newton, True
        length = length_of(cauchy)
        if length >= self.radius:
            return self._cauchy * (self.radius / length), False
        along = newton - cauchy  # |cauchy + t along| = radius
        a, b, c = inner(along, along), inner(cauchy, along), length**2 - self.radius**2
        t = -c / (b + np.sqrt(b * b - a * c))
        return self._cauchy + t * (self._newton - self._cauchy), False

    def judge(self, step: Step, decrease: float) -> bool:
        """Accept a decrease; grow or shrink the trust region by the gain ratio."""
        gain = decrease / step.predicted if step.predicted > 0 else -1.0
        length = length_of(self._scale * step.delta)
        if not np.isfinite(gain) or gain < 0.25:
            self.radius = 0.25 * length
        elif gain > 0.75:
            self.radius = max(self.radius, 3.0 * length)
        return bool(gain > 0)

    @property
    def exhausted(self) -> bool:
        """Steps this short change nothing in double precision."""
        return self.radius < 1e-14


def raised_diagonal(problem: Problem, system: System) -> Array:
    """The Hessian's diagonal ``(dim,)``, entries near zero raised to a billionth of the largest."""
    diagonal = problem.pattern.diagonal(system.hessian)
    np.maximum(diagonal, 1e-9 * diagonal.max(initial=1e-9), out=diagonal)
    return diagonal


def largest_of(vector: Array) -> float:
    """Largest magnitude in a vector that is not empty; NaN if any is."""
    return float(max(vector.max(), -vector.min()))


def inner(a: Array, b: Array) -> float:
    """Inner product of two vectors; not by BLAS, whose threads spin for longer than this takes."""
    return float(np.einsum("i,i->", a, b))


def length_of(vector: Array) -> float:
    """Euclidean length; see `inner`."""
    return math.sqrt(inner(vector, vector))


def multiply(problem: Problem, system: System, vector: Array) -> Array:
    """Product of the Hessian and a vector ``(dim,)``, block by block size."""
    pattern = problem.pattern
    out = np.zeros(pattern.dim)
    sizes = pattern.sizes.astype(np.int64)
    shapes = sizes[pattern.rows] * 64 + sizes[pattern.cols]
    for shape in np.unique(shapes):
        mine = np.flatnonzero(shapes == shape)
        height, width = int(shape) // 64, int(shape) % 64
        values = system.hessian[pattern.offsets[mine, None] + np.arange(height * width)].reshape(
            -1, height, width
        )
        row = pattern.starts[pattern.rows[mine], None] + np.arange(height)
        col = pattern.starts[pattern.cols[mine], None] + np.arange(width)
        np.add.at(out, row, np.einsum("mij,mj->mi", values, vector[col]))
        off = pattern.rows[mine] != pattern.cols[mine]
        np.add.at(out, col[off], np.einsum("mij,mi->mj", values[off], vector[row[off]]))
    return out
