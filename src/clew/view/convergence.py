"""How the cost fell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from clew.errors import InputError
from clew.view.chart import chart, describe, heading, key_to
from clew.view.style import LIGHT, Theme

_MARKERS = "osD^vP"


def cost_figure(
    histories: Mapping[str, Sequence[float]] | Sequence[float], title: str = "", *, theme: Theme = LIGHT
) -> Figure:
    """Cost after each accepted step, on a logarithmic axis; several solves in one picture.

    Args:
        histories: `Solution.chi2_history`, or several by name.
        title: heading, one line.
        theme: `LIGHT` or `DARK`.

    Raises:
        InputError: no cost, or one that is not finite or is negative.
    """
    named = histories if isinstance(histories, Mapping) else {"": histories}
    arrays = {name: np.asarray(history, dtype=np.float64) for name, history in named.items()}
    for name, costs in arrays.items():
        if not (costs.ndim == 1 and costs.size and np.isfinite(costs).all() and (costs >= 0.0).all()):
            raise InputError(f"a picture of the cost needs finite costs, at least one; those of {name!r} are not")
    if not arrays:
        raise InputError("a picture of the cost needs at least one history")
    figure, (axes,) = chart(1400, 800, 1, 1, theme)
    for number, costs in enumerate(arrays.values()):
        axes.plot(np.arange(len(costs)), costs, color=theme.robot(number),
                  linewidth=1.6 + 1.6 * (len(arrays) - 1 - number),  # those below stay visible where all are one
                  marker=_MARKERS[number % len(_MARKERS)], markersize=4.5 + 1.6 * (len(arrays) - 1 - number))
    highest, lowest = (pick(float(pick(costs)) for costs in arrays.values()) for pick in (max, min))
    if lowest > 0.0 and highest > 20.0 * lowest:
        axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    describe(axes, "accepted steps", "cost  Σ ρ(eᵀ Ω e), no unit", theme)
    handles = [
        Line2D([], [], color=theme.robot(number), linewidth=1.6, marker=_MARKERS[number % len(_MARKERS)],
               markersize=4.5, label=_label(name, costs))
        for number, (name, costs) in enumerate(arrays.items())
    ]  # fmt: skip
    key_to(axes, handles, theme, "upper right")
    heading(figure, title, theme)
    return figure


def _label(name: str, costs: NDArray[np.float64]) -> str:
    return f"{name}{': ' if name else ''}{costs[0]:.6g} to {costs[-1]:.6g} in {len(costs) - 1} steps"
