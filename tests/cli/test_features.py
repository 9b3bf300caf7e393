"""``clew run`` on files of features."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from clew.factors import Between
from clew.fleet import read_landmarks
from clew.geometry import SE2, Point2
from clew.graph import FactorGraph
from clew.io import Features, read_graph, write_graph
from cli.commands import in_process


def square(path: Path) -> None:
    """Twice around a square among five landmarks, without noise."""
    side = [np.array([1.0, 0.0, 0.0])] * 4 + [np.array([0.0, 0.0, np.pi / 2])]
    motion = np.array(side * 8)
    poses = SE2.from_array(np.zeros((1, 3)))
    arrays = [poses.array[0]]
    for step in motion:
        arrays.append((SE2.from_array(arrays[-1]) @ SE2.from_array(step)).array)
    places = np.array([[1.0, 2.0], [3.0, 1.0], [2.0, 3.5], [6.0, 2.0], [2.0, -2.0]])
    keys, z = [], []
    for key, pose in enumerate(arrays):
        q = SE2.from_array(pose).inverse().act(places)
        for point in np.asarray(q)[np.hypot(*np.asarray(q).T) < 4.0]:
            keys.append(key)
            z.append(point)
    graph = FactorGraph()
    graph.add_pose(SE2.from_array(np.array(arrays)), key=np.arange(len(arrays)))
    graph.set_constant(0)
    graph.add(Between(np.arange(40), np.arange(1, 41), motion, sigmas=[0.05, 0.05, 0.02]))
    information = np.tile(400.0 * np.eye(2), (len(z), 1, 1))
    write_graph(path, graph, features=Features(np.array(keys), np.array(z), information))


def test_files_and_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    square(tmp_path / "square.g2o")
    done = in_process(monkeypatch, capsys, "run", tmp_path / "square.g2o", "-o", tmp_path / "out", "--json")
    assert done.code == 0
    summary = json.loads(done.out)
    assert summary["landmarks"] == 5
    assert summary["identities"] == "found"
    assert summary["poses"] == 41
    assert summary["without_landmark"] == 0
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["graph.g2o", "landmarks.csv", "landmarks.png", "report.html", "summary.json", "trajectory.tum"]
    identities, positions = read_landmarks(tmp_path / "out" / "landmarks.csv")
    assert identities == [""] * 5  # numbers counted here mean nothing to other robots
    assert positions.shape == (5, 2)
    graph = read_graph(tmp_path / "out" / "graph.g2o").graph
    assert len(graph.keys(Point2)) == 5
    assert "look at" in done.err


def test_bad_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "gap.g2o"
    path.write_text("VERTEX_SE2 0 0 0 0\nDATA_FEATURE_POINTXY 0 0 1 1 4 0 4\nVERTEX_SE2 1 1 0 0\n")
    done = in_process(monkeypatch, capsys, "run", path, "-o", tmp_path / "out")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "pose 1 has no relative pose" in done.err
    assert not (tmp_path / "out").exists()
    square(tmp_path / "square.g2o")
    done = in_process(monkeypatch, capsys, "run", tmp_path / "square.g2o", "-o", tmp_path / "out", "--robot", 2)
    assert done.code == 2
    assert "no MRCLAM folder" in done.err


@pytest.mark.parametrize(
    ("feature", "said"),
    [
        ("2 1", "line 4: DATA_FEATURE_POINTXY: a finite number expected, found the end of the line"),
        ("2 1 abc 1 0 1", "line 4: DATA_FEATURE_POINTXY: a finite number expected, found 'abc'"),
        ("2 nan 2 1 0 1", "line 4: DATA_FEATURE_POINTXY: a finite number expected, found 'nan'"),
        ("2 1 2 inf 0 1", "line 4: DATA_FEATURE_POINTXY: a finite number expected, found 'inf'"),
        ("2 1 2 0 0 0", "pose 1 has an information matrix that is not positive definite"),
        ("2 1 2 1 5 1", "pose 1 has an information matrix that is not positive definite"),
        ("2 1 2 -1 0 -1", "pose 1 has an information matrix that is not positive definite"),
        ("2 1e200 2 1 0 1", "pose 1 is more than 1e+07 m away"),
    ],
)
def test_broken_features(
    feature: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, poses = tmp_path / "log.g2o", "VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\n"
    path.write_text(f"{poses}EDGE_SE2 0 1 1 0 0 100 0 0 100 0 100\nDATA_FEATURE_POINTXY 0 {feature}\n")
    assert_refused(path, said, monkeypatch, capsys)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("DATA_FEATURE_POINTXY 0 2 1 2 1 0 1\nVERTEX_SE2 0 0 0 0\n", "a vertex before it"),
        ("VERTEX_SE2 0 0 0 0\nDATA_FEATURE_POINTXY 0 2 1 2 1 0 1\n", "there is no drive in that"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_XY 5 1 1\nDATA_FEATURE_POINTXY 0 2 1 2 1 0 1\n", "no VERTEX_SE2"),
        ("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 0 0 0 0 0 0\nDATA_FEATURE_POINTXY 0 2 1 2 1 0 1\n",
         "relative pose to pose 1 has an information matrix"),
    ],
)  # fmt: skip
def test_broken_drives(
    text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "log.g2o"
    path.write_text(text)
    assert_refused(path, said, monkeypatch, capsys)


def assert_refused(
    path: Path, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done = in_process(monkeypatch, capsys, "run", path, "-o", path.parent / "out")
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert path.name in done.err
    assert said in done.err
    assert not (path.parent / "out").exists()
