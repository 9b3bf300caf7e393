"""``clew merge``: folders and files in, one folder out; bad input is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from clew.cli.merge import merge
from clew.errors import InputError
from clew.factors import PointObservation, RangeBearing
from clew.fleet import RobotGraph, read_landmarks, write_landmarks
from clew.geometry import SE2, Point2
from clew.graph import FactorGraph
from clew.io import read_graph, write_graph
from fleet.fleets import fleet, strangers

APP = typer.Typer()
APP.command()(merge)
DATA = Path(__file__).parents[3] / "shared" / "data" / "multirobot" / "example_4robots"


def cartesian(robot: RobotGraph) -> FactorGraph:
    """The robot's graph with range and bearing as points, for which g2o has a record."""
    graph = FactorGraph()
    graph.add_pose(robot.graph.values(SE2), key=robot.graph.keys(SE2))
    graph.add_point(robot.graph.values(Point2), key=robot.graph.keys(Point2))
    for block in robot.graph.blocks():
        if isinstance(block, RangeBearing):
            r, c, s = block.measurement[:, 0], np.cos(block.measurement[:, 1]), np.sin(block.measurement[:, 1])
            jacobian = np.stack([np.stack([c, -r * s], axis=1), np.stack([s, r * c], axis=1)], axis=1)
            covariance = jacobian @ np.linalg.inv(block.information) @ np.swapaxes(jacobian, 1, 2)
            graph.add(PointObservation(block.keys[:, 0], block.keys[:, 1], np.stack([r * c, r * s], axis=1),
                                       covariance=covariance))
        else:
            graph.add(block)
    return graph


def write_run(robot: RobotGraph, folder: Path) -> Path:
    """An output folder as `clew run` leaves it."""
    folder.mkdir()
    write_graph(folder / "graph.g2o", cartesian(robot))
    marks = robot.landmarks
    write_landmarks(folder / "landmarks.csv", marks.identities.tolist(), marks.positions, marks.covariances,
                    marks.sightings)
    return folder


def run(*arguments: object) -> str:
    result = CliRunner().invoke(APP, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    base = tmp_path_factory.mktemp("runs")
    _, robots = fleet(2, 2, identified=1.0, duration=60.0)
    return [write_run(robot, base / f"out{number}") for number, robot in enumerate(robots)]


def test_output_folders_are_merged(folders: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "new" / "all"
    report = json.loads(run(*folders, "-o", out, "--json"))
    assert report["robots"] == ["out0", "out1"]
    assert report["shared_landmarks"] >= 10
    assert sorted(file.name for file in out.iterdir()) == [
        "graph.g2o", "landmarks.csv", "landmarks.png", "report.html", "robots.json"
    ]  # fmt: skip
    graph = read_graph(out / "graph.g2o").graph
    names, positions = read_landmarks(out / "landmarks.csv")
    assert len(names) == len(graph.keys(Point2)) == len(positions)
    np.testing.assert_allclose(positions, graph.values(Point2).array, atol=1e-6)
    named = [name for name in names if name]
    assert len(set(named)) == len(named)
    first = [file.read_bytes() for file in sorted(out.iterdir())]
    assert "landmarks agree" in run(*folders, "-o", out)
    assert [file.read_bytes() for file in sorted(out.iterdir())] == first


def test_a_merge_can_be_merged_again(folders: list[Path], tmp_path: Path) -> None:
    run(*folders, "-o", tmp_path / "all")
    report = json.loads(run(tmp_path / "all", folders[0], "-o", tmp_path / "more", "--json"))
    assert report["shared_landmarks"] >= 10


@pytest.mark.skipif(not DATA.exists(), reason="needs ../shared/data/multirobot/example_4robots")
def test_files_with_edges_between_robots_are_merged(tmp_path: Path) -> None:
    assert "8 of 8 relative poses agree" in run(*(DATA / f"{k}.g2o" for k in range(4)), "-o", tmp_path)
    assert (tmp_path / "graph.png").stat().st_size > 10_000
    with pytest.raises(InputError, match="edges lead to poses of robot 'b', whose graph is not among the inputs"):
        run(DATA / "0.g2o", DATA / "3.g2o", "-o", tmp_path)


def test_nothing_is_written_where_nothing_is_merged(tmp_path: Path) -> None:
    inputs = [write_run(robot, tmp_path / f"lost{k}") for k, robot in enumerate(strangers(2, identified=1.0))]
    with pytest.raises(InputError, match=r"robot lost1 cannot be placed .* nothing was merged \(lost0 and lost1: "):
        run(*inputs, "-o", tmp_path / "all")
    assert not (tmp_path / "all").exists()


def test_files_that_disagree_about_identities(folders: list[Path], tmp_path: Path) -> None:
    names, positions = read_landmarks(folders[1] / "landmarks.csv")
    common = sorted(set(names) & set(read_landmarks(folders[0] / "landmarks.csv")[0]) - {""})
    swapped = {common[0]: common[3], common[3]: common[0]}
    other = tmp_path / "other"
    other.mkdir()
    (other / "graph.g2o").write_bytes((folders[1] / "graph.g2o").read_bytes())
    write_landmarks(other / "landmarks.csv", [swapped.get(n, n) for n in names], positions,
                    np.zeros((len(names), 2, 2)), np.ones(len(names), np.int64))
    with pytest.raises(InputError, match="disagree about identities") as caught:
        run(folders[0], other, "-o", tmp_path / "all")
    assert common[0] in str(caught.value)
    assert common[3] in str(caught.value)


def test_bad_input(folders: list[Path], tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "graph.g2o").write_bytes((folders[0] / "graph.g2o").read_bytes())
    marks = broken / "landmarks.csv"
    for text, message in (("identity,x,y\n", "column cov_xx is missing"),
                          ("identity,x,y,cov_xx,cov_xy,cov_yy,sightings\n7,one,2,0,0,0,1\n", "line 2: x and y"),
                          ("identity,x,y,cov_xx,cov_xy,cov_yy,sightings\n7,999,999,0,0,0,1\n", "landmark 7 stands")):
        marks.write_text(text)
        with pytest.raises(InputError, match=message):
            run(folders[1], broken, "-o", tmp_path / "all")
    for inputs, message in (((folders[0], empty), "holds no graph.g2o"), ((folders[0], tmp_path / "no"), "no such"),
                            ((folders[0], folders[0]), "given twice"), ((folders[0],), "at least two")):
        with pytest.raises(InputError, match=message):
            run(*inputs, "-o", tmp_path / "all")
    assert not (tmp_path / "all").exists()
