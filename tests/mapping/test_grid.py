"""The grid as a value: cells and world coordinates, states, probabilities, cropping."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clew.errors import InputError
from clew.mapping import CellState, OccupancyGrid

GRID = OccupancyGrid(np.array([[0.0, -1.0, 0.0], [2.0, 0.0, 0.0]]), 0.5, np.array([10.0, -3.0]))


def test_row_zero_is_the_lowest_y() -> None:
    centres = GRID.cell_to_world(np.array([[0, 0], [1, 2]]))
    np.testing.assert_allclose(centres, [[10.25, -2.75], [11.25, -2.25]])
    assert GRID.world_to_cell(np.array([[10.49, -2.51], [11.49, -2.01], [9.9, -3.1]])).tolist() == [
        [0, 0], [1, 2], [-1, -1]]
    assert GRID.extent == (10.0, 11.5, -3.0, -2.0)


@given(st.integers(-500, 500), st.integers(-500, 500), st.floats(0.01, 2.0))
def test_a_cell_holds_its_own_centre(row: int, col: int, resolution: float) -> None:
    grid = OccupancyGrid(np.zeros((1, 1)), resolution, np.array([-3.3, 7.7]))
    assert grid.world_to_cell(grid.cell_to_world(np.array([row, col]))).tolist() == [row, col]


def test_states_and_probabilities_follow_the_log_odds() -> None:
    assert GRID.states().tolist() == [
        [CellState.UNKNOWN, CellState.FREE, CellState.UNKNOWN],
        [CellState.OCCUPIED, CellState.UNKNOWN, CellState.UNKNOWN]]
    expected = [[0.5, 0.26894143, 0.5], [0.88079708, 0.5, 0.5]]
    np.testing.assert_allclose(GRID.probabilities(), expected, rtol=1e-6)
    assert GRID.observed.sum() == 2


@pytest.mark.parametrize("padding", [0.0, 0.5, 1.5])
def test_cropping_keeps_every_cell_where_it_was(padding: float) -> None:
    log_odds = np.zeros((40, 50))
    log_odds[5:21, 30:43] = np.random.default_rng(0).uniform(0.5, 2.0, (16, 13))
    grid = OccupancyGrid(log_odds, 0.5, np.array([1.0, 2.0]))
    cropped = grid.cropped(padding)
    border = round(padding / 0.5)
    assert cropped.shape == (16 + 2 * border, 13 + 2 * border)
    cells = np.argwhere(grid.observed)
    row, col = cropped.world_to_cell(grid.cell_to_world(cells)).T
    np.testing.assert_array_equal(cropped.log_odds[row, col], grid.log_odds[grid.observed])
    assert cropped.observed.sum() == grid.observed.sum()


def test_cropping_leaves_out_stray_rays_but_not_a_map_made_of_them() -> None:
    log_odds = np.zeros((400, 400), dtype=np.float32)
    log_odds[100:200, 100:200] = -1.0
    log_odds[150, 200:260] = -1.0  # one ray through a window
    assert OccupancyGrid(log_odds, 0.05, np.zeros(2)).cropped().shape == (100, 100)
    # With padding, its first metre is seen, and nothing is cut to zero in between.
    padded = OccupancyGrid(log_odds, 0.05, np.zeros(2)).cropped(1.0)
    assert (padded.log_odds[70, 120:140] == -1.0).all()
    # A corridor is no stray ray.
    log_odds[148:154, 200:380] = -1.0
    assert OccupancyGrid(log_odds, 0.05, np.zeros(2)).cropped().shape == (100, 280)
    # Two rays are all that there is.
    cross = np.zeros((100, 100), dtype=np.float32)
    cross[10, 5:95] = cross[5:95, 10] = -1.0
    assert OccupancyGrid(cross, 0.05, np.zeros(2)).cropped().shape == (90, 90)


def test_cropping_an_unknown_world_changes_nothing() -> None:
    grid = OccupancyGrid(np.zeros((3, 4)), 0.1, np.zeros(2))
    assert grid.cropped(1.0) is grid


@pytest.mark.parametrize(("log_odds", "resolution", "origin"), [
    (np.zeros(3), 0.1, np.zeros(2)), (np.zeros((2, 2)), 0.0, np.zeros(2)),
    (np.zeros((2, 2)), 0.1, np.zeros(3)), (np.zeros((2, 2)), np.nan, np.zeros(2)),
])
def test_what_is_no_grid_is_refused(log_odds: np.ndarray, resolution: float, origin: np.ndarray) -> None:
    with pytest.raises(InputError):
        OccupancyGrid(log_odds, resolution, origin)
