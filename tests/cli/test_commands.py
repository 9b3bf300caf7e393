"""Help, version, and the commands besides ``run``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import clew
from clew.io import read_tum
from cli.commands import FILES, Command, as_process


@pytest.mark.parametrize("command", ["run", "demo", "optimize", "evaluate"])
def test_help_shows_an_example(command: str, clew_command: Command) -> None:
    done = clew_command(command, "--help")
    assert (done.code, done.err) == (0, "")
    assert "Example" in done.out
    assert done.out.count(f"clew {command}") >= 2  # the usage line and the example


def test_help_of_the_program_names_all_commands_and_is_what_no_arguments_give(clew_command: Command) -> None:
    done, bare = clew_command("--help"), clew_command()
    assert done.code == bare.code == 0
    assert done.out == bare.out
    for word in ("run", "demo", "optimize", "evaluate", "--version"):
        assert word in done.out


def test_version_is_that_of_the_package(clew_command: Command) -> None:
    assert clew_command("--version").out.strip() == f"clew {clew.__version__}" == as_process("--version").out.strip()


def test_demo_writes_its_files_and_evaluate_agrees_with_its_summary(tmp_path: Path, clew_command: Command) -> None:
    out = tmp_path / "demo"
    done = clew_command("demo", "--seconds", "30", "-o", out, "--json")
    assert done.code == 0, done.err
    summary = json.loads(done.out)
    assert {p.name for p in out.iterdir()} == {*FILES, "truth.tum"}
    assert summary["ate_m"] < 0.1
    stamps, truth = read_tum(out / "truth.tum")
    np.testing.assert_allclose(stamps, read_tum(out / "trajectory.tum")[0])
    assert len(truth) == summary["scans"]
    judged = clew_command("evaluate", out / "trajectory.tum", "--truth", out / "truth.tum", "--json")
    assert judged.code == 0, judged.err
    rmse = json.loads(judged.out)["absolute"]["translation_m"]["rmse"]
    assert rmse == pytest.approx(summary["ate_m"], abs=2e-4)
    table = clew_command("evaluate", out / "trajectory.tum", "--truth", out / "truth.tum")
    assert table.code == 0
    assert f"{rmse:.4f}" in table.out


def test_another_seed_is_another_building(tmp_path: Path, clew_command: Command) -> None:
    for seed in (1, 2):
        assert clew_command("demo", "--seconds", "10", "--seed", seed, "-o", tmp_path / str(seed), "-q").code == 0
    assert (tmp_path / "1" / "map.pgm").read_bytes() != (tmp_path / "2" / "map.pgm").read_bytes()
