"""The picture of a map, pixel by pixel."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from clew.errors import InputError
from clew.mapping import OccupancyGrid
from clew.view import save_map_png
from clew.view.raster import fitted, grid_pixels
from clew.view.style import FREE, INK, OCCUPIED, UNKNOWN, counted, format_metres, round_length
from view.pictures import close_to, pixels_of, rgb

WALL, EMPTY = 3.5, -2.0


def small_grid() -> OccupancyGrid:
    log_odds = np.zeros((40, 60))
    log_odds[5:30, 10:50] = EMPTY
    log_odds[5, 10:50] = log_odds[5:30, 10] = WALL  # an L: its corner is low and left
    return OccupancyGrid(log_odds, 0.05, np.array([-1.0, 2.0]))


def test_every_cell_is_a_square_of_its_colour_and_nothing_is_drawn_over_the_map(tmp_path: Path) -> None:
    grid = small_grid()
    save_map_png(tmp_path / "map.png", grid)
    picture = pixels_of(tmp_path / "map.png")
    side = picture.shape[1] // 60
    assert side >= 16
    cells = picture[:40 * side].reshape(40, side, 60, side, 3)
    assert (cells == cells[:, :1, :, :1]).all()
    colours = cells[::-1, 0, :, 0]  # row 0 at the bottom
    assert (colours[5, 10:50] == rgb(OCCUPIED)).all()
    assert (colours[5:30, 10] == rgb(OCCUPIED)).all()
    assert (colours[6:30, 11:50] == rgb(FREE)).all()
    assert (colours[~grid.observed] == rgb(UNKNOWN)).all()


def test_the_scale_bar_is_as_long_as_it_says(tmp_path: Path) -> None:
    save_map_png(tmp_path / "map.png", small_grid())
    picture = pixels_of(tmp_path / "map.png")
    side = picture.shape[1] // 60
    foot = picture[40 * side:]
    longest = (close_to(foot, INK, 5)).sum(axis=1).max()
    assert longest == pytest.approx(0.5 / 0.05 * side, abs=1)  # 0.5 m is the round length below 30 %


def test_a_large_map_is_one_pixel_a_cell(tmp_path: Path) -> None:
    log_odds = np.zeros((1200, 900))
    log_odds[1199, 899] = WALL
    save_map_png(tmp_path / "map.png", OccupancyGrid(log_odds, 0.05, np.zeros(2)))
    picture = pixels_of(tmp_path / "map.png")
    assert picture.shape[1] == 900
    assert (picture[0, 899] == rgb(OCCUPIED)).all()
    assert (picture[1:1200] == rgb(UNKNOWN)).all()


def test_weak_evidence_fades_towards_unknown() -> None:
    log_odds = np.array([[-2.0, -0.4, 0.0, 0.4, 2.0]])
    grey = grid_pixels(OccupancyGrid(log_odds, 0.05, np.zeros(2)))[0].astype(int).sum(axis=1)
    free, weakly_free, unknown, weakly_occupied, occupied = grey
    assert free > weakly_free > unknown > weakly_occupied > occupied


def test_thin_walls_survive_when_cells_are_more_than_pixels() -> None:
    log_odds = np.full((300, 1003), EMPTY)
    log_odds[10, :] = log_odds[:, 501] = WALL
    pixels, metres_per_pixel = fitted(OccupancyGrid(log_odds, 0.05, np.zeros(2)), 100)
    assert pixels.shape[:2] == (28, 92)  # eleven cells a pixel
    assert metres_per_pixel == pytest.approx(0.55)
    assert (pixels[-1] == rgb(OCCUPIED)).all()  # the lowest eleven rows lie at the bottom
    assert (pixels[1:, 501 // 11] == rgb(OCCUPIED)).all()
    assert (pixels[1:-1, :40] == rgb(FREE)).all()


def test_the_same_map_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        save_map_png(tmp_path / name, small_grid())
    content = (tmp_path / "a.png").read_bytes()
    assert content == (tmp_path / "b.png").read_bytes()
    assert b"tEXt" not in content  # neither a date nor the version of a program
    assert b"tIME" not in content


def test_a_picture_that_cannot_be_written_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        save_map_png(tmp_path / "missing" / "map.png", small_grid())
    assert list(tmp_path.iterdir()) == []


def test_clew_and_mapping_do_not_load_matplotlib() -> None:
    code = "import sys, clew, clew.mapping, clew.view; assert 'matplotlib' not in sys.modules; " \
           "clew.view.save_map_png; assert 'matplotlib' in sys.modules and 'matplotlib.pyplot' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": ":".join(sys.path)})


def test_one_is_singular() -> None:
    assert [counted(n, "pose") for n in (0, 1, 1728)] == ["0 poses", "1 pose", "1,728 poses"]


@pytest.mark.parametrize(("longest", "length", "text"), [
    (1.0, 1.0, "1 m"), (9.9, 5.0, "5 m"), (0.3, 0.2, "20 cm"), (2400.0, 2000.0, "2 km"), (49.0, 20.0, "20 m"),
])
def test_scale_bars_have_round_lengths(longest: float, length: float, text: str) -> None:
    assert round_length(longest) == pytest.approx(length)
    assert format_metres(round_length(longest)) == text
