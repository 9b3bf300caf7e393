"""Round things in scans: trees, poles, columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from clew.scan.feature_returns import Index, Mask, ReturnOptions, Returns, gather_returns, spans, sum_by
from clew.scan.laser import LaserScan

Array = NDArray[np.float64]

ITERATIONS = 8


@dataclass(frozen=True)
class CircleOptions:
    """What counts as a round thing.

    Attributes:
        returns: noise, and where surfaces end.
        minimum_returns: least number of returns.
        least_radius, greatest_radius: metres.
        radius_sigma: greatest standard deviation of the radius as a share of it.
        misfit: greatest mean squared normalised residual.
        better_than_line: a straight line must fit this many times worse.
        seen: the returns must reach this share of the radius to either side as seen from the sensor.
        grazing: beams that meet the surface flatter than this (cosine of the angle to its normal) are left out.
    """

    returns: ReturnOptions = field(default_factory=ReturnOptions)
    minimum_returns: int = 6
    least_radius: float = 0.04
    greatest_radius: float = 0.8
    radius_sigma: float = 0.25
    misfit: float = 2.0
    better_than_line: float = 2.0
    seen: float = 0.6
    grazing: float = 0.3


@dataclass(frozen=True, eq=False)
class Circles:
    """``K`` round things in the frames of the robot.

    Attributes:
        scan: ``(K,)`` index of the scan.
        centres: ``(K, 2)`` metres.
        radii: ``(K,)`` metres.
        covariances: ``(K, 3, 3)`` of (x, y, radius).
        returns: ``(K,)`` number of returns on each.
    """

    scan: Index
    centres: Array
    radii: Array
    covariances: Array
    returns: Index

    def __len__(self) -> int:
        return len(self.scan)


def find_circles(scans: Sequence[LaserScan], options: CircleOptions | None = None) -> Circles:
    """Round things that stand free in front of what is behind them, all scans at once.

    The first guess is algebraic (Kåsa 1976), the fit Gauss-Newton on the ranges themselves: the noise is along the
    beams, and a fit to distances from the circle would be biased where beams graze it.
    """
    options = options or CircleOptions()
    returns = gather_returns(scans, options.returns)
    first, last = _free_standing(returns, options)
    rows, owner = spans(first, last)
    guess = _algebraic(returns.points[rows], owner, len(first))
    plausible = np.isfinite(guess).all(axis=1) & (guess[:, 2] < 3 * options.greatest_radius)
    first, last, guess = first[plausible], last[plausible], guess[plausible]
    rows, owner = spans(first, last)
    circles, covariances, misfit, used = _refine(returns, rows, owner, guess, options)
    good = (used >= options.minimum_returns) & (misfit < options.misfit)
    good &= (circles[:, 2] > options.least_radius) & (circles[:, 2] < options.greatest_radius)
    good &= covariances[:, 2, 2] < (options.radius_sigma * circles[:, 2]) ** 2
    good &= _wide_enough(returns, first, last, circles, options)
    good &= _line_misfit(returns, rows, owner, len(first)) > options.better_than_line * np.maximum(misfit, 0.3)
    scan = returns.scan[first[good]]
    covariances = covariances + options.returns.sigma_surface**2 * np.eye(3)
    return _in_robot_frame(returns, scan, circles[good], covariances[good], used[good])


def _free_standing(returns: Returns, options: CircleOptions) -> tuple[Index, Index]:
    """Surfaces small enough, with nothing nearer right beside them."""
    first, last = returns.starts[:-1], returns.starts[1:]
    if not len(first):
        return first, last
    points = returns.points
    width = np.hypot(*(points[last - 1] - points[first]).T)
    good = (last - first >= options.minimum_returns) & (width < 2.1 * options.greatest_radius)
    before, after = np.maximum(first - 1, 0), np.minimum(last, len(points) - 1)
    for own, other in ((first, before), (last - 1, after)):
        beside = (returns.scan[own] == returns.scan[other]) & (np.abs(returns.beam[own] - returns.beam[other]) <= 2)
        hidden = beside & (own != other) & (returns.ranges[other] < returns.ranges[own])
        good &= ~hidden
    return first[good], last[good]


def _algebraic(points: Array, owner: Index, count: int) -> Array:
    """Kåsa's circle ``(K, 3)``: least squares in ``x^2 + y^2 + a x + b y + c = 0``, about each mean."""
    number = np.maximum(np.bincount(owner, minlength=count), 1)[:, None]
    mean = sum_by(owner, points, count) / number
    d = points - mean[owner]
    rows = np.column_stack([d, np.ones(len(d))])
    squared = (d**2).sum(axis=1)
    normal = sum_by(owner, rows[:, :, None] * rows[:, None, :], count)
    right = sum_by(owner, rows * squared[:, None], count)
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-15 * np.eye(3)
    a, b, c = np.linalg.solve(normal, right[..., None])[..., 0].T
    return np.column_stack([mean + np.stack([a, b], axis=1) / 2, np.sqrt(np.maximum(c + (a * a + b * b) / 4, 0.0))])


def _refine(returns: Returns, rows: Index, owner: Index, circles: Array,
            options: CircleOptions) -> tuple[Array, Array, Array, Index]:
    """Circles ``(K, 3)``, covariances, mean squared normalised residuals and numbers of returns used."""
    count = len(circles)
    covariances: Array = np.zeros((count, 3, 3))
    for _ in range(ITERATIONS):
        error, jacobian, use = _predict(returns, rows, owner, circles, options)
        j, e = jacobian / options.returns.sigma_range, error / options.returns.sigma_range
        information = sum_by(owner[use], j[use, :, None] * j[use, None, :], count)
        information += 1e-9 * np.eye(3)
        gradient = sum_by(owner[use], j[use] * e[use, None], count)
        covariances = np.asarray(np.linalg.inv(information))
        step = (covariances @ gradient[..., None])[..., 0]
        # A step longer than the radius leaves the circle that was meant.
        length = np.linalg.norm(step, axis=1, keepdims=True) / np.maximum(0.5 * circles[:, 2:], 1e-3)
        circles = circles - step / np.maximum(length, 1.0)
        circles[:, 2] = np.maximum(circles[:, 2], 1e-3)
    error, _, use = _predict(returns, rows, owner, circles, options)
    used = np.bincount(owner[use], minlength=count)
    squared = np.bincount(owner[use], (error[use] / options.returns.sigma_range) ** 2, count)
    return circles, covariances, squared / np.maximum(used - 3, 1), used


def _predict(returns: Returns, rows: Index, owner: Index, circles: Array,
             options: CircleOptions) -> tuple[Array, Array, Mask]:
    """Predicted minus measured range, its derivative by (x, y, radius), and which beams say something."""
    u, (cx, cy, radius) = returns.directions[rows], circles[owner].T
    across = cx * u[:, 1] - cy * u[:, 0]  # how far the beam passes beside the centre
    half_squared = radius**2 - across**2
    use = half_squared > (options.grazing * radius) ** 2
    half = np.sqrt(np.where(use, half_squared, 1.0))
    error = cx * u[:, 0] + cy * u[:, 1] - half - returns.ranges[rows]
    slope = across / half
    jacobian = np.stack([u[:, 0] + slope * u[:, 1], u[:, 1] - slope * u[:, 0], -radius / half], axis=1)
    return error, jacobian, use


def _wide_enough(returns: Returns, first: Index, last: Index, circles: Array, options: CircleOptions) -> Mask:
    """Whether the returns reach far enough to both sides of the centre."""
    beams = returns.directions[np.stack([first, last - 1], axis=1)] if len(first) else np.empty((0, 2, 2))
    across = circles[:, None, 0] * beams[..., 1] - circles[:, None, 1] * beams[..., 0]
    reach = options.seen * circles[:, 2]
    return np.asarray((across.max(axis=1, initial=-np.inf) > reach) & (across.min(axis=1, initial=np.inf) < -reach))


def _line_misfit(returns: Returns, rows: Index, owner: Index, count: int) -> Array:
    """Mean squared residual of a straight line in standard deviations of a range."""
    points = returns.points[rows]
    number = np.maximum(np.bincount(owner, minlength=count), 1)
    d = points - (sum_by(owner, points, count) / number[:, None])[owner]
    scatter = sum_by(owner, d[:, :, None] * d[:, None, :], count)
    least = np.linalg.eigvalsh(scatter)[:, 0] if count else np.empty(0)
    return np.asarray(least / np.maximum(number - 2, 1) / returns.options.sigma_range**2)


def _in_robot_frame(returns: Returns, scan: Index, circles: Array, covariances: Array, used: Index) -> Circles:
    place = returns.T_robot_sensor[scan]
    c, s = np.cos(place[:, 2]), np.sin(place[:, 2])
    rotation = np.zeros((len(scan), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = c
    rotation[:, 0, 1], rotation[:, 1, 0] = -s, s
    rotation[:, 2, 2] = 1.0
    turned = (rotation @ circles[..., None])[..., 0]
    return Circles(scan, turned[:, :2] + place[:, :2], turned[:, 2],
                   rotation @ covariances @ np.swapaxes(rotation, 1, 2), used)
