"""The rooms may import only whom the design lets them (docs/architecture.md)."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

SRC = Path(__file__).parents[1] / "src" / "clew"

ESTIMATION = {"geometry", "noise", "linalg", "graph", "factors", "solve"}
WORLD = {"motion", "scan", "mapping", "place", "io", "sim", "evaluate"}
ALLOWED: dict[str, set[str]] = {
    "geometry": set(),
    "noise": set(),
    "linalg": set(),
    "graph": {"geometry", "noise"},
    "factors": {"geometry", "noise", "graph"},
    "solve": {"geometry", "noise", "linalg", "graph"},
    "reduce": {"geometry", "noise", "linalg", "graph", "factors", "solve"},
    "motion": {"geometry"},
    "scan": {"geometry"},
    "mapping": {"geometry", "scan"},
    "place": {"geometry", "scan", "mapping"},
    "io": {"geometry", "noise", "graph", "factors", "scan", "motion"},
    "sim": {"geometry", "scan", "motion"},
    "evaluate": {"geometry", "graph"},
    "slam": ESTIMATION | {"reduce"} | WORLD,
    "fleet": ESTIMATION | {"reduce"} | WORLD | {"slam"},
    "view": ESTIMATION | WORLD | {"slam", "fleet"},
    "testing": {"geometry", "noise", "graph", "factors", "solve"},
    "cli": ESTIMATION | WORLD | {"slam", "fleet", "view", "testing"},
}
ROOTS = {"errors", "_version", "_native"}  # what every room may use


def imported_rooms(tree: ast.AST) -> set[tuple[int, str]]:
    """Line and first name below `clew` of each import of our own."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: imports are absolute here"
            base = node.module or ""
            names = [f"clew.{a.name}" for a in node.names] if base == "clew" else [base]
        else:
            continue
        found |= {(node.lineno, name.split(".")[1]) for name in names if name.startswith("clew.")}
    return found


def violations(room: str, source: str) -> list[str]:
    """Forbidden imports in the source of a file of a room."""
    allowed = ALLOWED[room] | ROOTS | {room}
    return [f"line {line}: {room} may not import {name}"
            for line, name in sorted(imported_rooms(ast.parse(source))) if name not in allowed]


FILES = sorted(p for p in SRC.rglob("*.py") if p.parent != SRC)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SRC)))
def test_room_imports_only_whom_it_may(path: Path) -> None:
    room = path.relative_to(SRC).parts[0]
    assert room in ALLOWED, f"{room} is not a room of the design"
    assert not violations(room, path.read_text())


def test_the_check_sees_a_forbidden_import() -> None:
    assert violations("geometry", "from clew.slam import Slam")
    assert violations("scan", "def f():\n    import clew.solve")
    assert violations("place", "from clew import solve")
    assert not violations("slam", "from clew.solve import optimize")
