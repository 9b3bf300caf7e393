"""Charts: what they draw is what they were given."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import clew
from clew.errors import InputError
from clew.evaluate import factor_residuals
from clew.linalg import BlockPattern, analyse, factor_blocks
from clew.view import (
    DARK,
    LIGHT,
    cost_figure,
    error_figure,
    residuals_figure,
    save_figure,
    sparsity_figure,
)
from clew.view.style import Theme
from view.pictures import close_to, pixels_of, rgb


def line(axes: Axes, number: int) -> tuple[Any, Any]:
    """What was drawn, whatever the picture looks like."""
    x, y = axes.lines[number].get_data()
    return np.asarray(x), np.asarray(y)


def words(figure: Figure) -> str:
    """All text of the axes: titles, labels, legends."""
    found = []
    for axes in figure.axes:
        found += [axes.get_title(loc="left"), axes.get_xlabel(), axes.get_ylabel()]
        legend = axes.get_legend()
        found += [text.get_text() for text in legend.get_texts()] if legend else []
        found += [text.get_text() for text in axes.get_xticklabels()]
    found += [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    return "\n".join(found)


def test_the_cost_is_drawn_step_by_step() -> None:
    figure = cost_figure({"a": [900.0, 30.0, 3.0], "b": (900.0, 3.5)})
    axes = figure.axes[0]
    np.testing.assert_array_equal(line(axes, 0), ([0, 1, 2], [900.0, 30.0, 3.0]))
    np.testing.assert_array_equal(line(axes, 1), ([0, 1], [900.0, 3.5]))
    assert axes.get_yscale() == "log"
    assert "a: 900 to 3 in 2 steps" in words(figure)
    assert cost_figure([4.0, 3.0]).axes[0].get_yscale() == "linear"
    assert cost_figure([4.0, 0.0]).axes[0].get_yscale() == "linear"  # zero has no logarithm


@pytest.mark.parametrize("histories", [{}, {"a": []}, [1.0, np.nan], [-1.0], [[1.0]]])
def test_a_cost_that_cannot_be_drawn_is_refused(histories: Any) -> None:
    with pytest.raises(InputError):
        cost_figure(histories)


def test_errors_outside_their_band_are_counted() -> None:
    times = np.arange(4.0)
    errors = np.array([[0.0, 1.0], [2.9, 1.0], [-3.1, 1.0], [0.0, 1.0]])
    covariances = np.tile(np.diag([1.0, 0.01]), (4, 1, 1))
    figure = error_figure(times, errors, covariances, ("x, m", "y, m"))
    upper, lower = figure.axes
    assert upper.get_title(loc="left") == "25.0 % outside"
    assert lower.get_title(loc="left") == "100.0 % outside"
    np.testing.assert_array_equal(line(upper, 0), (times, errors[:, 0]))
    np.testing.assert_array_equal(line(upper, 1), ([2.0], [-3.1]))
    band = upper.collections[0].get_paths()[0].get_extents()
    assert (band.y0, band.y1) == pytest.approx((-3.0, 3.0))
    assert (upper.get_ylabel(), lower.get_xlabel()) == ("x, m", "time, s")
    assert error_figure(times, errors, covariances, ("x", "y"), sigmas=2.0).axes[0].get_title(loc="left")[:2] == "50"


@pytest.mark.parametrize("change", [
    {"timestamps": np.arange(3.0)}, {"errors": np.zeros((4, 3))}, {"covariances": np.zeros((4, 3, 3))},
    {"names": ("x",)}, {"errors": np.full((4, 2), np.nan)}, {"errors": np.zeros(4)},
])
def test_errors_that_do_not_fit_are_refused(change: dict[str, Any]) -> None:
    given: dict[str, Any] = {"timestamps": np.arange(4.0), "errors": np.zeros((4, 2)),
                             "covariances": np.zeros((4, 2, 2)), "names": ("x", "y")}
    with pytest.raises(InputError):
        error_figure(**(given | change))


def measured_line() -> clew.FactorGraph:
    """Three poses; the closure is 10 sigma off, odometry and prior are met."""
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE2.from_array(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])))
    graph.add(clew.Prior(keys[0], clew.SE2.identity(), sigmas=1.0))
    graph.add(clew.Between(keys[:2], keys[1:], clew.SE2(1.0, 0.0, 0.0), sigmas=0.1))
    graph.add(clew.Between(keys[0], keys[2], clew.SE2(3.0, 0.0, 0.0), sigmas=0.1, role="loop"))
    return graph


def test_residuals_and_weights_are_drawn_role_by_role() -> None:
    kernel = clew.Huber(1.0)
    figure = residuals_figure(factor_residuals(measured_line(), kernel))
    upper, lower = figure.axes
    drawn = {upper.lines[n].get_color(): line(upper, n) for n in range(len(upper.lines))}
    assert drawn[LIGHT.closure][1] == pytest.approx([100.0])
    assert drawn[LIGHT.closure][0] == [2]  # after two of odometry
    assert len(drawn[LIGHT.trajectory][0]) == 2
    weights = [values for n in range(len(lower.lines)) for values in line(lower, n)[1]]
    assert pytest.approx(0.1) in weights
    text = words(figure)
    assert "1 loop, 100.0 % above" in text
    assert "2 odometry, 0.0 % above" in text
    assert "loop (1)" in text


def test_without_a_kernel_there_are_no_weights_to_draw() -> None:
    assert len(residuals_figure(factor_residuals(measured_line())).axes) == 1
    assert len(residuals_figure(factor_residuals(clew.FactorGraph())).axes) == 1


def arrow(n: int) -> BlockPattern:
    """All variables tied to variable 0: eliminated first it fills everything, eliminated last nothing."""
    return BlockPattern.from_pairs(np.full(n, 2), np.zeros(n - 1, int), np.arange(1, n))


def test_factor_blocks_of_an_arrow() -> None:
    pattern = arrow(6)
    rows, cols = factor_blocks(pattern, np.arange(6))
    assert len(rows) == 21
    assert (rows >= cols).all()
    rows, cols = factor_blocks(pattern, [1, 2, 3, 4, 5, 0])
    assert sorted(zip(rows.tolist(), cols.tolist(), strict=True)) == sorted([(k, k) for k in range(6)] +
                                                                            [(5, k) for k in range(5)])
    with pytest.raises(InputError):
        factor_blocks(pattern, [0, 1, 2, 3, 4, 4])


@pytest.mark.parametrize("seed", range(5))
def test_factor_blocks_are_those_of_a_dense_factor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 25
    pattern = BlockPattern.from_pairs(np.ones(n), *rng.integers(0, n, (2, 30)))
    order = analyse(pattern).permutation if seed else rng.permutation(n)
    dense = np.zeros((n, n))
    dense[pattern.rows, pattern.cols] = rng.uniform(0.5, 1.0, len(pattern.rows))
    dense = dense + dense.T + 60.0 * np.eye(n)
    lower = np.linalg.cholesky(dense[np.ix_(order, order)])
    rows, cols = factor_blocks(pattern, order)
    expected = {(int(i), int(j)) for i, j in np.argwhere(np.abs(lower) > 1e-14)}
    assert set(zip(rows.tolist(), cols.tolist(), strict=True)) == expected


def test_sparsity_shows_matrix_and_fill() -> None:
    symbolic = analyse(arrow(6), ordering="natural")
    figure = sparsity_figure(symbolic)
    images = [np.asarray(axes.images[0].get_array()) for axes in figure.axes]
    assert images[0].astype(bool).sum() == 16  # the diagonal, a row and a column
    assert (images[2] == 2).sum() == 11  # what the matrix has below its diagonal, with it
    assert (images[2] == 1).sum() == 10  # the fill
    assert "21 blocks, 1e+02 % of a triangle" in words(figure)
    last = np.asarray(sparsity_figure(analyse(arrow(6), ordering="amd")).axes[1].images[0].get_array())
    assert last[-2:].astype(bool).sum(axis=1).max() == 6  # the hub is eliminated at the end, or but one
    assert not last[0, 1:4].any()
    large = sparsity_figure(analyse(arrow(3000)))
    assert np.asarray(large.axes[0].images[0].get_array()).shape == (560, 560)


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_charts_have_the_colours_of_their_theme_and_the_same_bytes(theme: Theme, tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        save_figure(cost_figure([3.0, 2.0], "a solve", theme=theme), tmp_path / name)
    picture = pixels_of(tmp_path / "a.png")
    assert (picture[-1, -1] == rgb(theme.paper)).all()
    assert close_to(picture, theme.ink, 20).any()
    assert close_to(picture, theme.robot(0), 20).any()
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with pytest.raises(InputError):
        save_figure(cost_figure([1.0]), tmp_path / "missing" / "a.png")


def lightness(colour: str) -> float:
    """CIE lightness, 0 to 100."""
    channels = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    y = float(linear @ [0.2126, 0.7152, 0.0722])
    return 116.0 * np.cbrt(y) - 16.0


def as_seen(colour: str, kind: str) -> np.ndarray:
    """Linear RGB as seen without one kind of cone (Viénot, Brettel, Mollon 1999)."""
    channels = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    lms = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.0299566, 0.184309, 1.46709]])
    seen = lms @ linear
    if kind == "protan":
        seen[0] = 2.02344 * seen[1] - 2.52581 * seen[2]
    else:
        seen[1] = 0.494207 * seen[0] + 1.24827 * seen[2]
    return np.linalg.solve(lms, seen)


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_lines_stand_out_from_the_paper_and_roles_from_each_other(theme: Theme) -> None:
    paper = lightness(theme.paper)
    for colour in (theme.ink, theme.trajectory, theme.closure, theme.rejected, theme.landmark, theme.uncertainty,
                   *theme.robots):
        assert abs(lightness(colour) - paper) > 25.0, colour
    for kind in ("protan", "deutan"):
        for a, b in ((theme.trajectory, theme.closure), (theme.trajectory, theme.rejected),
                     (theme.uncertainty, theme.closure), (theme.robots[0], theme.robots[1])):
            assert np.linalg.norm(as_seen(a, kind) - as_seen(b, kind)) > 0.15, (kind, a, b)
