"""Robots that recognise landmarks on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from clew.io import SightingLog, read_graph
from clew.solve import optimize
from cli.commands import Command
from slam.test_landmarks import simulate


def write_mrclam(folder: Path, log: SightingLog) -> None:
    """One robot's files; the barcode of a landmark is its number and a hundred."""
    seen, odometry = log.landmarks, log.odometry
    known = np.unique(seen.identity)
    for name, columns in (
        ("Barcodes", [np.append(1, known), np.append(5, known + 100)]),
        ("Robot1_Odometry", [odometry.timestamp, odometry.speed, odometry.turn_rate]),
        ("Robot1_Measurement", [seen.timestamp, seen.identity + 100, seen.range, seen.bearing]),
    ):
        np.savetxt(folder / f"{name}.dat", np.column_stack(columns), fmt="%.9g")


def test_cost_in_the_summary_is_that_of_the_graph(tmp_path: Path, clew_command: Command) -> None:
    write_mrclam(tmp_path, simulate(1, 0, np.array([0.5, -1.0, 0.3]), 60.0))
    done = clew_command("run", tmp_path, "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    written = read_graph(tmp_path / "out" / "graph.g2o").graph
    cost = optimize(written, init="file", max_iterations=0).chi2
    assert json.loads(done.out)["chi2"] == pytest.approx(cost, rel=1e-4)


def test_numbers_of_one_landmark(tmp_path: Path, clew_command: Command) -> None:
    (tmp_path / "Barcodes.dat").write_text("1 5\n6 72\n")
    (tmp_path / "Robot1_Odometry.dat").write_text("".join(f"{0.1 * k:.1f} 0.1 0.05\n" for k in range(200)))
    (tmp_path / "Robot1_Measurement.dat").write_text("".join(f"{0.5 * k:.1f} 72 3.0 0.0\n" for k in range(1, 20)))
    done = clew_command("run", tmp_path, "-o", tmp_path / "out")
    assert done.code == 0, done.err
    assert "\n1 landmark, " in done.err
