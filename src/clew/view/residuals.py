"""How well each measurement is met, and how much a robust kernel trusts it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.stats import chi2

from clew.evaluate import ROLES, FactorResiduals
from clew.graph import Role
from clew.view.chart import chart, describe, heading, key_below
from clew.view.style import LIGHT, Theme, font

Index = NDArray[np.int64]

_SMALLEST = 1e-6  # squared residuals below are drawn here, for the axis is logarithmic
_NARROW = 0.05  # share of the axis below which a role has no room for its name
_EXPECTED = 0.99  # share of the factors below the dashed line, were the noise as stated


def residuals_figure(
    residuals: FactorResiduals, title: str = "", *, heading_of: str = "", theme: Theme = LIGHT
) -> Figure:
    """Squared residual of every factor, role by role, in the order in which they were added.

    Below it the weight that a robust kernel gives each factor, where a weight is below one.

    The dashed lines lie where one factor in a hundred would be above, were the noise as stated; the labels say
    how many are.

    Args:
        residuals: of `clew.evaluate.factor_residuals`.
        title: heading, one line.
        heading_of: title of the upper axes, such as the kernel that gave the weights.
        theme: `LIGHT` or `DARK`.
    """
    weighted = bool((residuals.weight < 1.0).any())
    figure, grid = chart(1600, 1000 if weighted else 640, 2 if weighted else 1, 1, theme, share_x=True)
    upper, lower = grid[0], grid[-1]
    colours = {Role.ODOMETRY: theme.trajectory, Role.LOOP: theme.closure, Role.OBSERVATION: theme.landmark,
               Role.PRIOR: theme.rejected, Role.MARGINAL: theme.muted}
    size = float(np.clip(6.0 - 1.2 * np.log10(max(len(residuals), 1)), 1.0, 4.0))
    start, ticks, labels, handles = 0, [], [], []
    for role in ROLES:
        rows = np.flatnonzero(residuals.of_role(role))
        if not rows.size:
            continue
        x = start + np.arange(rows.size)
        squared = residuals.squared[rows]
        for axes, values in zip(grid, (np.maximum(squared, _SMALLEST), residuals.weight[rows]), strict=False):
            axes.plot(x, values, linestyle="none", marker="o", markersize=size, markeredgewidth=0.0,
                      color=colours[role], alpha=0.7)
        line = chi2.ppf(_EXPECTED, residuals.dim[rows])
        upper.plot(x, line, color=theme.ink, linewidth=1.0, dashes=(4.0, 2.5))
        above = 100.0 * float((squared > line).mean())
        ticks.append(start + rows.size / 2)
        labels.append(f"{role.value} ({rows.size:,})" if rows.size > _NARROW * len(residuals) else "")
        handles.append(Line2D([], [], linestyle="none", marker="o", markersize=5, color=colours[role],
                              markeredgewidth=0.0, label=f"{rows.size:,} {role.value}, {above:.1f} % above"))
        start += rows.size
        for axes in grid:
            axes.axvline(start, color=theme.faint, linewidth=1.0)
    upper.set_yscale("log")
    for axes in grid:
        axes.grid(False, axis="x")
        axes.set_xlim(0, max(start, 1))
    lower.set_xticks(ticks, labels)
    if weighted:
        lower.set_ylim(-0.03, 1.06)
        describe(lower, "", "weight  ρ′, no unit", theme)
    describe(upper, "", "squared residual  eᵀ Ω e, no unit", theme, heading_of)
    lower.set_xlabel("factors, role by role", fontproperties=font(9), color=theme.ink)
    for label in lower.get_xticklabels():
        label.set_fontproperties(font(9))
    handles.append(Line2D([], [], color=theme.ink, linewidth=1.0, dashes=(4.0, 2.5),
                          label="1 % above if the noise is as stated"))
    key_below(figure, handles, theme)
    heading(figure, title, theme)
    return figure
