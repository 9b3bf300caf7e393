"""Straight walls in scans: split and merge, then a weighted fit with its covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from clew.geometry import wrap
from clew.scan.feature_returns import Index, ReturnOptions, Returns, gather_returns, spans, sum_by
from clew.scan.laser import LaserScan

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LineOptions:
    """What counts as a line.

    Attributes:
        returns: noise, and where surfaces end.
        split: a surface is split where a return is further than this from the chord, in standard deviations of a
            range.
        trim: returns left out at either end of a line, where the beam may have met something else as well.
        minimum_returns: least number of returns after trimming.
        minimum_length: metres.
        misfit: greatest mean squared normalised residual.
    """

    returns: ReturnOptions = field(default_factory=ReturnOptions)
    split: float = 4.0
    trim: int = 1
    minimum_returns: int = 6
    minimum_length: float = 0.4
    misfit: float = 2.0


@dataclass(frozen=True, eq=False)
class Lines:
    """``K`` lines ``x cos(alpha) + y sin(alpha) = rho`` in the frames of the robot, ``rho >= 0`` from the sensor.

    Attributes:
        scan: ``(K,)`` index of the scan.
        parameters: ``(K, 2)`` alpha (radians) and rho (metres).
        covariances: ``(K, 2, 2)``.
        ends: ``(K, 2, 2)`` where the line begins and ends, in the order of the beams, metres.
        returns: ``(K,)`` number of returns on each.
    """

    scan: Index
    parameters: Array
    covariances: Array
    ends: Array
    returns: Index

    def __len__(self) -> int:
        return len(self.scan)


def find_lines(scans: Sequence[LaserScan], options: LineOptions | None = None) -> Lines:
    """Straight lines in scans, all scans at once.

    Surfaces are split at the return furthest from the chord until none is far (Ramer 1972), neighbours on one line
    are merged again, and each line is fitted with the noise of every return across it (Pfister, Roumeliotis &
    Burdick, ICRA 2003).
    """
    options = options or LineOptions()
    returns = gather_returns(scans, options.returns)
    points = returns.points
    first, last = _merge(returns, points, *_split(returns, points, options), options)
    first, last = first + options.trim, last - options.trim
    enough = last - first >= options.minimum_returns
    parameters, covariances, misfit = _fit(returns, points, first[enough], last[enough])
    first, last = first[enough], last[enough]
    normal = np.stack([np.cos(parameters[:, 0]), np.sin(parameters[:, 0])], axis=1)
    ends = np.stack([points[first], points[last - 1]], axis=1) if len(first) else np.empty((0, 2, 2))
    off = (ends * normal[:, None]).sum(axis=2) - parameters[:, 1, None]
    ends = ends - off[..., None] * normal[:, None]
    good = (misfit < options.misfit) & (np.hypot(*(ends[:, 1] - ends[:, 0]).T) >= options.minimum_length)
    parameters, ends = parameters[good], ends[good]
    covariances = covariances[good] + _of_surfaces(parameters, ends, options.returns.sigma_surface)
    return _in_robot_frame(
        returns, returns.scan[first[good]], parameters, covariances, ends, (last - first)[good]
    )


def _split(returns: Returns, points: Array, options: LineOptions) -> tuple[Index, Index]:
    """Spans ``first .. last - 1`` without a return far from their chord; all spans are split in step."""
    first, last = returns.starts[:-1], returns.starts[1:]
    limit = options.split * options.returns.sigma_range
    done_first, done_last = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    while len(first):
        keep = last - first >= options.minimum_returns
        first, last = first[keep], last[keep]
        rows, owner = spans(first, last)
        distance = _from_chord(points, rows, first[owner], last[owner] - 1)
        # The furthest return of each span: the last one after sorting by span and distance.
        order = np.lexsort((distance, owner))
        furthest = order[np.cumsum(last - first) - 1]
        straight = distance[furthest] <= limit
        done_first.append(first[straight])
        done_last.append(last[straight])
        at = rows[furthest][~straight]
        first, last = (np.concatenate(parts) for parts in ((first[~straight], at), (at + 1, last[~straight])))
    a, b = np.concatenate(done_first), np.concatenate(done_last)
    order = np.argsort(a, kind="stable")
    return a[order], b[order]


def _from_chord(points: Array, rows: Index, start: Index, end: Index) -> Array:
    """Distance of points from the straight line between the ends of their spans, metres."""
    along = points[end] - points[start]
    away = points[rows] - points[start]
    length = np.hypot(along[:, 0], along[:, 1])
    cross = np.abs(along[:, 0] * away[:, 1] - along[:, 1] * away[:, 0])
    return np.where(length > 0, cross / np.where(length > 0, length, 1.0), np.hypot(away[:, 0], away[:, 1]))


def _merge(returns: Returns, points: Array, first: Index, last: Index, options: LineOptions) -> tuple[Index, Index]:
    """Make neighbours one where a single line fits both, until no pair is left that was not tried."""
    surface = np.searchsorted(returns.starts, first, side="right")
    untried = np.ones(len(first), dtype=bool)  # of each span with the next one
    while True:
        untried[-1:] = False
        untried[:-1] &= (surface[:-1] == surface[1:]) & (first[1:] - last[:-1] <= 1)
        left = np.flatnonzero(untried)
        if not len(left):
            return first, last
        # Of neighbouring pairs only the first, third, ... at a time: they share a span.
        run = np.cumsum(np.diff(left, prepend=-2) > 1)
        place = np.arange(len(left)) - np.searchsorted(run, run)
        left = left[place % 2 == 0]
        misfit = _fit(returns, points, first[left], last[left + 1])[2]
        rows, owner = spans(first[left], last[left + 1])
        chord = _from_chord(points, rows, first[left][owner], last[left + 1][owner] - 1)
        starts = np.searchsorted(owner, np.arange(len(left)))
        far = np.maximum.reduceat(chord, starts)
        one = (misfit < options.misfit) & (far < 1.5 * options.split * options.returns.sigma_range)
        untried[left] = False
        merged = left[one]
        last[merged] = last[merged + 1]
        untried[merged] = True
        untried[merged[merged > 0] - 1] = True
        keep = np.ones(len(first), dtype=bool)
        keep[merged + 1] = False
        first, last, surface, untried = first[keep], last[keep], surface[keep], untried[keep]


def _fit(returns: Returns, points: Array, first: Index, last: Index) -> tuple[Array, Array, Array]:
    """Parameters ``(K, 2)``, covariances ``(K, 2, 2)`` and mean squared normalised residuals ``(K,)`` of spans."""
    count = len(first)
    rows, owner = spans(first, last)
    p = points[rows]
    number = np.maximum(last - first, 1)[:, None]
    mean = sum_by(owner, p, count) / number
    d = p - mean[owner]
    xx, xy, yy = sum_by(owner, np.stack([d[:, 0] ** 2, d[:, 0] * d[:, 1], d[:, 1] ** 2], axis=1), count).T
    alpha = 0.5 * np.arctan2(-2 * xy, yy - xx)  # total least squares with equal weights to begin with
    rho = mean[:, 0] * np.cos(alpha) + mean[:, 1] * np.sin(alpha)
    parts = Returns(returns.scan[rows], returns.beam[rows], returns.ranges[rows], returns.directions[rows],
                    returns.starts, returns.T_robot_sensor, returns.increments, returns.options)
    covariance = np.zeros((count, 2, 2))
    for _ in range(3):
        normal = np.stack([np.cos(alpha), np.sin(alpha)], axis=1)[owner]
        weight = 1.0 / parts.variance_across(normal)
        error = (p * normal).sum(axis=1) - rho[owner]
        turn = p[:, 1] * normal[:, 0] - p[:, 0] * normal[:, 1]  # derivative of the error by alpha
        terms = weight[:, None] * np.stack([turn * turn, -turn, np.ones(len(p)), turn * error, -error], axis=1)
        aa, ar, rr, ga, gr = sum_by(owner, terms, count).T
        determinant = aa * rr - ar * ar
        safe = np.where(determinant > 0, determinant, np.inf)
        covariance = np.stack([np.stack([rr, -ar], axis=1), np.stack([-ar, aa], axis=1)], axis=1) / safe[:, None, None]
        alpha = alpha - (rr * ga - ar * gr) / safe
        rho = rho - (aa * gr - ar * ga) / safe
    normal = np.stack([np.cos(alpha), np.sin(alpha)], axis=1)[owner]
    error = (p * normal).sum(axis=1) - rho[owner]
    misfit = np.bincount(owner, error**2 / parts.variance_across(normal), count) / np.maximum(number[:, 0] - 2, 1)
    return np.stack([alpha, rho], axis=1), covariance, misfit


def _of_surfaces(parameters: Array, ends: Array, sigma: float) -> Array:
    """Covariances ``(K, 2, 2)`` of lines whose walls are shifted and bent: both by `sigma`, about the middle."""
    alpha = parameters[:, 0]
    length = np.maximum(np.hypot(*(ends[:, 1] - ends[:, 0]).T), 1e-6)
    middle = ends.mean(axis=1)
    lever = middle[:, 1] * np.cos(alpha) - middle[:, 0] * np.sin(alpha)
    tilt = 12.0 * (sigma / length) ** 2  # of a line through points evenly along it that are so far off, taken as one
    out = np.empty((len(alpha), 2, 2))
    out[:, 0, 0] = tilt
    out[:, 0, 1] = out[:, 1, 0] = lever * tilt
    out[:, 1, 1] = sigma**2 + lever**2 * tilt
    return out


def _in_robot_frame(returns: Returns, scan: Index, parameters: Array, covariances: Array, ends: Array,
                    counts: Index) -> Lines:
    flip = parameters[:, 1] < 0
    place = returns.T_robot_sensor[scan]
    alpha = parameters[:, 0] + np.pi * flip + place[:, 2]
    sign = np.where(flip, -1.0, 1.0)
    rho = sign * parameters[:, 1] + place[:, 0] * np.cos(alpha) + place[:, 1] * np.sin(alpha)
    jacobian = np.zeros((len(scan), 2, 2))
    jacobian[:, 0, 0], jacobian[:, 1, 1] = 1.0, sign
    jacobian[:, 1, 0] = place[:, 1] * np.cos(alpha) - place[:, 0] * np.sin(alpha)
    c, s = np.cos(place[:, 2]), np.sin(place[:, 2])
    rotation = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    return Lines(
        scan,
        np.stack([wrap(alpha), rho], axis=1),
        jacobian @ covariances @ np.swapaxes(jacobian, 1, 2),
        ends @ np.swapaxes(rotation, 1, 2) + place[:, None, :2],
        counts,
    )
