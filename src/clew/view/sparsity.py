"""Where the Hessian and its factor are not zero."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from clew.linalg import SymbolicFactor, factor_blocks
from clew.view.chart import chart, describe, heading
from clew.view.style import LIGHT, Theme, counted

Index = NDArray[np.int64]

_SIDE = 560  # pixels of a matrix


def sparsity_figure(symbolic: SymbolicFactor, title: str = "", *, theme: Theme = LIGHT) -> Figure:
    """Blocks of the Hessian as the variables came, in the order of elimination, and of its Cholesky factor.

    One row and column a variable; where there are more variables than pixels, a dot says that there is a block
    in its square.

    Args:
        symbolic: analysis of the Hessian, ``solution.posterior.problem.symbolic``.
        title: heading, one line.
        theme: `LIGHT` or `DARK`.
    """
    pattern = symbolic.pattern
    n = int(pattern.sizes.size)
    place = np.empty(n, dtype=np.int64)
    place[symbolic.permutation] = np.arange(n)
    rows, cols = pattern.rows.astype(np.int64), pattern.cols.astype(np.int64)
    factor = factor_blocks(pattern, symbolic.permutation)
    panels = [
        ("Hessian H, variables as they came", _both(rows, cols), len(rows)),
        (f"H in the order of elimination ({symbolic.ordering})", _both(place[rows], place[cols]), len(rows)),
        ("factor L of H = L Lᵀ, the fill in orange", factor, len(factor[0])),
    ]
    figure, grid = chart(1800, 720, 1, 3, theme)
    for number, (axes, (name, (i, j), stored)) in enumerate(zip(grid, panels, strict=True)):
        image = _image(i, j, n)
        if number == 2:  # what the matrix itself has, over the fill
            own = _image(*(np.maximum(place[rows], place[cols]), np.minimum(place[rows], place[cols])), n)
            image = np.where(own > 0, 2, image)
        colours = [theme.paper, theme.closure if number == 2 else theme.ink, theme.ink]
        axes.imshow(image, cmap=ListedColormap(colours), vmin=0, vmax=2, interpolation="nearest",
                    extent=(0.0, float(n), float(n), 0.0))
        axes.grid(False)
        for spine in axes.spines.values():
            spine.set_visible(True)
        share = 100.0 * stored / max(1, n * (n + 1) // 2)
        describe(axes, f"{counted(stored, 'block')}, {share:.2g} % of a triangle", "variable" if number == 0 else "",
                 theme, name)
    heading(figure, title, theme)
    return figure


def _both(i: Index, j: Index) -> tuple[Index, Index]:
    """A symmetric matrix from one of its triangles."""
    return np.concatenate([i, j]), np.concatenate([j, i])


def _image(i: Index, j: Index, n: int) -> NDArray[np.uint8]:
    """``(s, s)`` 1 where there is a block; one pixel a variable, or several variables a pixel."""
    side = max(1, min(n, _SIDE))
    image = np.zeros((side, side), dtype=np.uint8)
    image[i * side // max(n, 1), j * side // max(n, 1)] = 1
    return image
