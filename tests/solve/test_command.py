"""``clew optimize`` from file to file."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import clew
from clew.cli.optimize import optimize, parse_kernel
from clew.errors import InputError
from clew.io import read_graph, read_tum

SQUARE = """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1.1 0 1.5
VERTEX_SE2 2 1 0.9 3.1
VERTEX_SE2 3 0.1 1 -1.6
EDGE_SE2 0 1 1 0 1.5707963267948966 1 0 0 1 0 1e6
EDGE_SE2 1 2 1 0 1.5707963267948966 1 0 0 1 0 1e6
EDGE_SE2 2 3 1 0 1.5707963267948966 1 0 0 1 0 1e6
EDGE_SE2 3 0 1.4 0 1.5707963267948966 1 0 0 1 0 1e6
SOMETHING 1 2 3
"""


@pytest.fixture
def square(tmp_path: Path) -> Path:
    path = tmp_path / "square.g2o"
    path.write_text(SQUARE)
    return path


def run(*arguments: object) -> str:
    app = typer.Typer()
    app.command()(optimize)
    result = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_json_is_one_object_with_the_figures(square: Path) -> None:
    figures = json.loads(run(square, "--json", "--method", "gauss-newton", "--init", "file"))
    assert figures["chi2"] == pytest.approx(0.04, rel=1e-4)
    assert figures["chi2_initial"] > 1000
    assert figures["status"] == "converged"
    assert figures["init"] == "file"
    assert figures["iterations"] > 0
    assert set(figures["seconds"]) == {"read", "initialise", "solve", "marginals", "write", "total"}
    assert sum(figures["seconds"].values()) <= 2 * figures["seconds"]["total"]


def test_text_tells_shape_costs_and_what_was_left_out(square: Path) -> None:
    text = run(square)
    assert "square.g2o: 4 SE2" in text
    assert re.search(r"chi2 0\.\d+ -> 0\.04 in \d+ iterations", text)
    assert "1 line SOMETHING: not understood and left out" in text
    assert "key 0 was held" in text
    assert "Converged" in text


def test_vertices_that_are_defined_twice_or_never_are_told(tmp_path: Path) -> None:
    lines = ["VERTEX_SE2 0 0 0 0", "VERTEX_SE2 1 1 0 0", "VERTEX_SE2 1 5 0 0",
             "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1", "EDGE_SE2 1 7 1 0 0 1 0 0 1 0 1"]
    path = tmp_path / "graph.g2o"
    path.write_text("\n".join(lines))
    text = run(path)
    assert "1 line defines a vertex again (first in line 3); the first definition of each was taken" in text
    assert "1 vertex is only mentioned by edges (7)" in text


def test_tags_that_cannot_be_printed_are_told_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    path.write_bytes(b"VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n\0\x1b[2J\n")
    text = run(path)
    assert r"1 line '\x00\x1b[2J': not understood" in text
    assert all(character.isprintable() for line in text.splitlines() for character in line)


def test_results_are_written(square: Path, tmp_path: Path) -> None:
    result, table = tmp_path / "out.g2o", tmp_path / "marginals.csv"
    run(square, "-o", result, "--marginals", table)
    written = read_graph(result)
    solution = clew.optimize(read_graph(square).graph)
    np.testing.assert_allclose(written.graph.values(clew.SE2).array, solution.values().array, atol=1e-9)
    assert "SOMETHING 1 2 3" in result.read_text()
    rows = [line.split(",") for line in table.read_text().splitlines()[1:]]
    assert [row[:2] for row in rows] == [[str(key), "SE2"] for key in range(4)]
    np.testing.assert_allclose([[float(x) for x in row[2:]] for row in rows],
                               solution.covariances().reshape(4, 9), atol=1e-9)


def test_the_picture_is_drawn(square: Path, tmp_path: Path) -> None:
    pytest.importorskip("clew.view.graph")
    picture = tmp_path / "square.png"
    run(square, "--plot", picture, "--marginals", tmp_path / "marginals.csv")
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_kernels_by_name() -> None:
    assert parse_kernel("huber") == clew.Huber()
    assert parse_kernel("Geman-McClure:2.5") == clew.GemanMcClure(2.5)
    for text, message in (("hubert", "choose huber"), ("huber:x", "not a number"), ("huber:-1", "positive")):
        with pytest.raises(InputError, match=message):
            parse_kernel(text)


def test_a_file_without_values_cannot_start_from_them(tmp_path: Path) -> None:
    path = tmp_path / "edges.g2o"
    path.write_text("\n".join(line for line in SQUARE.splitlines() if line.startswith("EDGE")))
    with pytest.raises(InputError, match="--init auto"):
        run(path, "--init", "file")
    assert json.loads(run(path, "--json", "--robust", "cauchy:3"))["chi2"] == pytest.approx(0.04, rel=1e-2)


def test_the_ending_chooses_the_format(square: Path, tmp_path: Path) -> None:
    solution = clew.optimize(read_graph(square).graph)
    for ending in ("g2o", "g2o.gz", "graph"):
        run(square, "-o", tmp_path / f"out.{ending}")
        written = read_graph(tmp_path / f"out.{ending}").graph
        np.testing.assert_allclose(written.values(clew.SE2).array, solution.values().array, atol=1e-9)
        assert clew.optimize(written, init="file", max_iterations=0).chi2 == pytest.approx(solution.chi2)
    assert "EDGE2" in (tmp_path / "out.graph").read_text()
    run(square, "-o", tmp_path / "out.tum")
    stamps, poses = read_tum(tmp_path / "out.tum")
    assert stamps.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(poses[:, :2], solution.values().array[:, :2], atol=1e-8)
    for ending in ("kitti", "txt"):
        run(square, "-o", tmp_path / f"out.{ending}")
        rows = np.loadtxt(tmp_path / f"out.{ending}")
        np.testing.assert_allclose(rows[:, [3, 7]], solution.values().array[:, :2], atol=1e-8)
        np.testing.assert_allclose(np.arctan2(rows[:, 4], rows[:, 0]), solution.values().array[:, 2], atol=1e-8)
    for ending in ("xyz", "tum.gz"):
        with pytest.raises(InputError, match=r"choose \.g2o \(g2o\), \.graph"):
            run(square, "-o", tmp_path / f"out.{ending}")


def test_indefinite_information_is_reported_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "indefinite.g2o"
    information = "1 0 0 0 0 9 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
    path.write_text(f"EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1 {information}\n")
    assert "1 edge has an indefinite information matrix (first in line 1)" in run(path)
    assert "first in line 1" in json.loads(run(path, "--json"))["notes"][0]
