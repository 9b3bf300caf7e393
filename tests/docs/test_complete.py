"""The documentation names everything that it promises to name: rooms, records, columns, kernels, options."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import typer

import clew
from clew import fleet, noise
from clew.cli.main import app
from clew.io.graph_tags import EDGES, OFFSETS, VERTICES

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FORMATS = (DOCS / "formats.md").read_text()


def test_every_room_has_its_page() -> None:
    rooms = {path.name for path in (ROOT / "src" / "clew").iterdir() if (path / "__init__.py").exists()} - {"cli"}
    for room in rooms:
        assert f"automodule:: clew.{room}\n" in (DOCS / "api" / f"{room}.md").read_text()
        assert f"[clew.{room}]" in (DOCS / "api" / "index.md").read_text()
        assert f"  {room}/ " in (DOCS / "architecture.md").read_text(), f"architecture.md does not name {room}"


def test_every_public_name_of_the_package_is_in_the_overview() -> None:
    overview = (DOCS / "api" / "index.md").read_text()
    for name in clew.__all__:
        if name != "__version__":
            assert re.search(rf"`(clew\.)?{name}`", overview), name


def test_every_record_of_a_graph_file_is_described() -> None:
    for tag in (*VERTICES, *EDGES, *OFFSETS):
        assert f"`{tag.name}`" in FORMATS


def test_every_column_and_entry_of_a_run_is_described(tmp_path: Path) -> None:
    command = ["demo", "-o", str(tmp_path), "--seconds", "12", "--quiet"]
    subprocess.run([sys.executable, "-c", "from clew.cli import main; main()", *command], check=True,
                   env={**os.environ, "PYTHONPATH": ":".join(sys.path)})
    summary = json.loads((tmp_path / "summary.json").read_text())
    with (tmp_path / "closures.csv").open() as file:
        columns = next(csv.reader(file))
    for name in (*columns, *summary):
        assert f"`{name}`" in FORMATS, name
    for name in fleet.files.COLUMNS:
        assert re.search(rf"\b{name}\b", FORMATS), name


def test_every_kernel_method_and_guess_is_explained() -> None:
    choosing = (DOCS / "choosing.md").read_text()
    kernels = [name for name in noise.__all__ if hasattr(getattr(noise, name), "native_id") and name != "Kernel"]
    assert len(kernels) >= 7
    for name in kernels:
        assert f"`{name}`" in choosing
    optimize: Any = typer.main.get_command(app).commands["optimize"]  # type: ignore[attr-defined]  # a group has commands
    for option in optimize.params:
        if option.name in ("method", "init"):
            for choice in option.type.choices:
                assert f'`"{getattr(choice, "value", choice)}"`' in choosing, choice


def test_every_command_is_on_its_page() -> None:
    page = (DOCS / "command-line.md").read_text()
    for name in typer.main.get_command(app).commands:  # type: ignore[attr-defined]  # a group has commands
        assert f"`clew {name}" in page
