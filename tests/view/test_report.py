"""What a report holds: numbers that survive their packing, text that stays text, sentences that fit the graph."""

from __future__ import annotations

import base64
import io
import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import clew
from clew.errors import InputError
from clew.factors import Between
from clew.geometry import SE2, SE3
from clew.graph import FactorGraph, Role
from clew.io import read_graph
from clew.mapping import OccupancyGrid
from clew.noise import DCS, Cauchy
from clew.place import Closure, Verdict
from clew.solve import optimize
from clew.view import report_of_solution, write_report
from clew.view.report.content import Report
from clew.view.report.encode import LEVELS, pack_grid, pack_scans
from clew.view.report.graph import view_graph
from clew.view.report.page import render
from clew.view.report.words import counted, duration, key_name, listed, metres
from cli.commands import environment

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"


def numbers(packed: dict[str, str]) -> np.ndarray:
    kinds = {"f4": "<f4", "i4": "<i4", "i2": "<i2", "u1": "u1"}
    return np.frombuffer(base64.b64decode(packed["data"]), kinds[packed["type"]])


def data_of(page: str) -> dict[str, object]:
    found = re.search(r'<script type="application/json" id="report-data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def chain(count: int = 30, loops: tuple[tuple[int, int, float], ...] = ((0, 20, 0.0),)) -> FactorGraph:
    """A straight drive of 1 m steps with loops (from, to, metres too long)."""
    graph = FactorGraph()
    graph.add_pose(SE2(np.arange(float(count)), np.zeros(count), np.zeros(count)))
    keys, ones = np.arange(count), np.ones(count - 1)
    graph.add(Between(keys[:-1], keys[1:], SE2(ones, 0 * ones, 0 * ones), sigmas=0.1))
    for start, end, wrong in loops:
        graph.add(Between(start, end, SE2(end - start + wrong, 0.0, 0.0), sigmas=0.1, role=Role.LOOP))
    return graph


def report(graph: FactorGraph, title: str = "a graph", robust: Cauchy | DCS | None = None) -> Report:
    return report_of_solution(optimize(graph, init="file", robust=robust), title, robust=robust)


def notes(graph: FactorGraph, robust: Cauchy | DCS | None = None) -> str:
    return "\n".join(note.text for note in report(graph, robust=robust).notes)


class Outline(HTMLParser):
    """Tags that are opened, and everything that would be fetched."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.fetched: list[str] = []
        self.handlers: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.handlers += [name for name, _ in attributes if name.startswith("on")]
        self.fetched += [value or "" for name, value in attributes
                         if name in ("src", "srcset", "href", "data", "action") and not (value or "").startswith("#")]


def test_scans_are_true_to_half_a_step() -> None:
    rng = np.random.default_rng(0)
    scans = [rng.uniform(-20, 20, (n, 2)) for n in (5, 0, 300)]
    packed = pack_scans(scans)
    first, step = numbers(packed["first"]), packed["step"]
    assert step == 1e-3
    np.testing.assert_array_equal(first, [0, 5, 5, 305])
    np.testing.assert_allclose(numbers(packed["points"]).reshape(-1, 2) * step, np.concatenate(scans), atol=0.51e-3)
    assert pack_scans([np.array([[80.0, 0.0]])])["step"] == pytest.approx(80 / 32767)
    assert pack_scans([])["step"] == 1e-3


def test_grid_as_picture() -> None:
    log_odds = np.array([[0.0, -9.0, 9.0], [0.4, 0.0, 0.0]], np.float32)
    packed = pack_grid(OccupancyGrid(log_odds, 0.1, np.array([1.0, 2.0])))
    head, data = packed["image"].split(",")
    assert head == "data:image/png;base64"
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))))
    expected = [[1 + round(LEVELS / (1 + np.exp(-0.4))), 0, 0], [0, 1, LEVELS + 1]]  # the highest y comes first
    np.testing.assert_array_equal(pixels, expected)


def test_walls_of_a_grid_that_is_too_large_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("clew.view.report.encode.LONGEST_GRID", 2)
    log_odds = np.full((5, 3), -9.0, np.float32)
    log_odds[4, 2] = 9.0
    packed = pack_grid(OccupancyGrid(log_odds, 0.1, np.zeros(2)))
    assert (packed["rows"], packed["cols"]) == (2, 1)
    assert packed["resolution"] == pytest.approx(0.3)
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(packed["image"].split(",")[1]))))
    np.testing.assert_array_equal(pixels, [[LEVELS + 1], [1]])


def test_page_needs_no_network_and_has_no_inline_handlers() -> None:
    page = render(report(chain()))
    outline = Outline()
    outline.feed(page)
    assert outline.fetched == []
    assert outline.handlers == []
    assert "default-src 'none'" in page
    assert "http://" not in page
    assert "https://" not in page
    assert not re.search(r"\{\{\w+\}\}", page)


@pytest.mark.parametrize("title", ["<script>alert(1)</script>", "</script><img src=x onerror=alert(1)>", "{{data}}",
                                   "\" onmouseover=\"alert(1)", "it's <b>&amp;</b>"])
def test_names_stay_text(title: str) -> None:
    plain, page = Outline(), Outline()
    plain.feed(render(report(chain())))
    page.feed(render(report(chain(), title)))
    assert page.tags == plain.tags
    assert page.handlers == []
    text = render(report(chain(), title))
    assert data_of(text)["dim"] == 2  # the data is whole


def test_names_of_robots_and_landmarks_cannot_end_the_data() -> None:
    found = report(chain())
    evil = "</script><b>"
    object.__setattr__(found.scene, "robots", (evil,))
    assert data_of(render(found))["robots"] == [evil]


def test_same_bytes_again(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_report(tmp_path / name, report(chain()))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    with pytest.raises(InputError, match="cannot be written"):
        write_report(tmp_path / "nowhere" / "a", report(chain()))


def test_data_of_the_page_is_the_graph() -> None:
    graph = chain(loops=((0, 20, 0.5),))
    solution = optimize(graph, init="file")
    data = data_of(render(report_of_solution(solution, "t")))
    poses, edges = data["poses"], data["edges"]
    positions = numbers(poses["position"]).reshape(-1, 2) + data["centre"]
    np.testing.assert_allclose(positions, solution.values().array[:, :2], atol=1e-5)
    covariances = solution.covariances()  # headings are zero: the axes of the poses are those of the world
    np.testing.assert_allclose(numbers(poses["covariance"]).reshape(-1, 6)[:, [0, 3, 5]],
                               np.diagonal(covariances, axis1=1, axis2=2), rtol=1e-4, atol=1e-9)
    ends = numbers(edges["ends"]).reshape(-1, 2)
    np.testing.assert_array_equal(ends[-1], [0, 20])
    assert numbers(edges["role"])[-1] == 2
    assert numbers(edges["squared"]).sum() * 3 == pytest.approx(solution.chi2, rel=1e-4)


def test_covariances_are_turned_into_the_axes_of_the_map() -> None:
    graph = FactorGraph()
    graph.add_pose(SE2(np.zeros(2), np.zeros(2), np.full(2, np.pi / 2)))
    graph.set_constant(0)
    graph.add(Between(0, 1, SE2(0.0, 0.0, 0.0), sigmas=[2.0, 1.0, 0.1]))  # 2 m ahead, and ahead is y
    scene = report(graph).scene
    assert scene.covariances is not None
    np.testing.assert_allclose(scene.covariances[1], np.diag([1.0, 4.0, 0.01]), atol=1e-9)


def test_a_free_end_is_named() -> None:
    text = notes(chain())
    assert "Between pose 20 and pose 29 the path (9.00 m, 10 poses) is held by odometry alone and its far end" in text
    assert "closes a loop" in notes(chain(loops=()))
    assert "odometry alone" not in notes(chain(loops=((0, 29, 0.0),)))


def test_a_loop_that_does_not_fit_is_named() -> None:
    wrong = chain(loops=((0, 20, 0.0), (1, 21, 0.0), (2, 22, 0.0), (3, 23, 8.0)))
    assert "loop edges miss by more than their stated noise" in notes(wrong)
    assert "1 loop edge (25.0 %) contradicts the others" in notes(wrong, DCS(1.0))
    assert "loop edge" not in notes(chain(loops=((0, 20, 0.0), (1, 21, 0.0))))


def test_graph_in_space_and_graph_without_covariance() -> None:
    graph = FactorGraph()
    graph.add_pose(SE3.identity((4,)))
    graph.add(Between([0, 1, 2], [1, 2, 3], SE3.identity((3,)), sigmas=0.1))
    data = data_of(render(report(graph)))
    assert data["dim"] == 3
    assert len(numbers(data["poses"]["covariance"])) == 4 * 6
    flat = FactorGraph()
    flat.add_pose(SE2(np.arange(2.0), np.zeros(2), np.zeros(2)))
    flat.add(Between(0, 1, SE2(1.0, 0.0, 0.0), information=np.diag([1.0, 0.0, 1.0])))
    free = report(flat)
    assert data_of(render(free))["poses"]["covariance"] is None
    assert any("free along y" in note.text and note.level == "check" for note in free.notes)


def test_one_pose() -> None:
    graph = FactorGraph()
    graph.add_pose(SE2(0.0, 0.0, 0.0))
    assert data_of(render(report(graph)))["dim"] == 2


def test_closures_carry_what_was_expected() -> None:
    found = report(chain())
    closure = Closure(20, 0, 0.9, Verdict.CONFIRMED, np.array([20.0, 0.0, 0.0]), np.eye(3), overlap=np.nan,
                      T_predicted=np.array([19.0, 0.1, 0.0]))
    object.__setattr__(found.scene, "closures", (closure,))
    (packed,) = data_of(render(found))["closures"]
    assert packed["predicted"] == [19.0, 0.1, 0.0]
    assert packed["overlap"] is None
    assert packed["verdict"] == "confirmed"


@pytest.mark.parametrize(("value", "text"), [
    (metres(12345.0), "12 km"), (metres(1500.0), "1.50 km"), (metres(508.2), "508 m"), (metres(3.14159), "3.14 m"),
    (metres(0.5), "50 cm"), (metres(0.0123), "1.2 cm"), (metres(0.0012), "1.2 mm"), (duration(2691.3), "44 min 51 s"),
    (duration(59.94), "59.9 s"), (duration(7380.0), "2 h 3 min"), (counted(1, "pose"), "1 pose"),
    (counted(1728, "pose"), "1,728 poses"), (listed(["a"]), "a"), (listed(["a", "b", "c"]), "a, b and c"),
    (listed([]), ""), (key_name((ord("a") << 56) + 7), "a7"), (key_name(12), "12"),
])
def test_words(value: str, text: str) -> None:
    assert value == text


def test_city_fits_into_two_megabytes() -> None:
    path = DATA / "graphs2d" / "city10000.g2o"
    if not path.exists():
        pytest.skip(f"needs {path.name} of the shared data")
    page = render(report_of_solution(optimize(read_graph(path).graph), path.name))
    assert len(page) < 2e6


def test_a_report_of_a_solve_loads_neither_matplotlib_nor_the_pipelines() -> None:
    script = ("import sys; from clew.view import report_of_solution, write_report; "
              "print(sorted({'matplotlib', 'clew.slam', 'clew.fleet', 'scipy.stats'} & set(sys.modules)))")
    done = subprocess.run([sys.executable, "-c", script], env=environment(), capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("unit_variance", [0.04, 9.0])
def test_noise_that_was_found_scales_all_ellipses_and_is_told(unit_variance: float) -> None:
    graph = clew.FactorGraph()
    a, b = graph.add_pose(clew.SE2(0, 0, 0)), graph.add_pose(clew.SE2(1, 0, 0.3))
    point = graph.add_point([2.0, 1.0])
    graph.add(clew.Prior(a, clew.SE2.identity(), sigmas=(0.1, 0.1, 0.1)))
    graph.add(clew.Between(a, b, clew.SE2(1, 0, 0.3), sigmas=(0.1, 0.1, 0.1)))
    for pose in (a, b):
        graph.add(clew.RangeBearing(pose, point, range=1.4, bearing=0.5, sigmas=(0.1, 0.1)))
    solution = clew.optimize(graph)
    stated, found = view_graph(solution), view_graph(solution, unit_variance=unit_variance)
    for by_found, by_stated in (
        (found.scene.covariances, stated.scene.covariances),
        (found.scene.landmarks.covariances, stated.scene.landmarks.covariances),
    ):
        np.testing.assert_allclose(by_found, unit_variance * np.asarray(by_stated))
    percent = f"{100 * np.sqrt(unit_variance):.0f} %"
    assert [percent in note.text for note in found.notes if "noise that the log states" in note.text] == [True]
    assert not any("noise that the log states" in note.text for note in stated.notes)
