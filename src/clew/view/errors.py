"""How wrong an estimate is, and how wrong it says that it may be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from clew.errors import InputError
from clew.view.chart import chart, describe, heading, key_below
from clew.view.style import LIGHT, Theme

Array = NDArray[np.float64]


def error_figure(
    timestamps: Array,
    errors: Array,
    covariances: Array,
    names: Sequence[str] = ("ahead, m", "left, m", "heading, rad"),
    title: str = "",
    *,
    sigmas: float = 3.0,
    theme: Theme = LIGHT,
) -> Figure:
    """Error of each coordinate over time, with the band that the estimate's own covariance gives.

    An honest Gaussian estimate leaves its 3-sigma band 0.27 % of the time; the heading of each row says how often
    this one does.

    Args:
        timestamps: ``(N,)`` seconds.
        errors: ``(N, d)`` estimate against truth in the tangent of the estimate, ``estimate.local(truth)``.
        covariances: ``(N, d, d)`` of the same tangent, as `Solution.covariances` gives them.
        names: ``(d,)`` what the coordinates are, with their unit.
        title: heading, one line.
        sigmas: half width of the band in standard deviations.
        theme: `LIGHT` or `DARK`.

    Raises:
        InputError: shapes that do not fit, or numbers that are not finite.
    """
    count, dim = errors.shape if errors.ndim == 2 else (0, 0)
    if not dim or timestamps.shape != (count,) or covariances.shape != (count, dim, dim) or len(names) != dim:
        raise InputError(
            f"errors over time need times (N,), errors (N, d), covariances (N, d, d) and d names; got "
            f"{timestamps.shape}, {errors.shape}, {covariances.shape} and {len(names)} names"
        )
    if not all(np.isfinite(values).all() for values in (timestamps, errors, covariances)):
        raise InputError("errors over time need finite numbers")
    band = sigmas * np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))
    outside = np.abs(errors) > band
    figure, rows = chart(1500, 300 * dim + 180, dim, 1, theme, share_x=True)
    for k, (axes, name) in enumerate(zip(rows, names, strict=True)):
        axes.fill_between(timestamps, -band[:, k], band[:, k], color=theme.uncertainty, alpha=0.22, linewidth=0.0)
        axes.plot(timestamps, errors[:, k], color=theme.trajectory, linewidth=1.0)
        axes.plot(timestamps[outside[:, k]], errors[outside[:, k], k], linestyle="none", marker="o", markersize=2.5,
                  color=theme.closure)
        describe(axes, "time, s" if k == dim - 1 else "", name, theme,
                 f"{100.0 * outside[:, k].mean() if count else 0.0:.1f} % outside")
    if dim:
        key_below(figure, [
            Line2D([], [], color=theme.trajectory, linewidth=1.2, label="error"),
            Line2D([], [], color=theme.uncertainty, alpha=0.4, linewidth=6.0, label=f"± {sigmas:g} sigma as estimated"),
            Line2D([], [], linestyle="none", marker="o", markersize=4, color=theme.closure, label="outside"),
        ], theme)  # fmt: skip
    heading(figure, title, theme)
    return figure
