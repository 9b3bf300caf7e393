"""The code in the pages: found, run in order, and its figures saved.

A page is Markdown. Its blocks marked ``python`` are run in order in one namespace; blocks marked ``{drawing} NAME`` are
run too, once a theme, with `theme` in the namespace, and leave a `figure` (or write a picture to `path`). The tests
run the same code.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[1]
DRAWINGS = "drawings"  # folder for figures, beside the pages; not in the repository

_FENCE = re.compile(r"^```(?P<info>[^`\n]*)\n(?P<body>.*?)^```\s*$", re.MULTILINE | re.DOTALL)
_OPTION = re.compile(r"^:[a-z-]+:.*\n", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block: what it is marked with, what is in it, and where it begins."""

    info: str
    body: str
    line: int

    @property
    def is_python(self) -> bool:
        """Whether it is to be run."""
        return self.info == "python"

    @property
    def drawing(self) -> str | None:
        """Name of the figure that it draws, if it is one that draws."""
        return self.info.removeprefix("{drawing}").strip() if self.info.startswith("{drawing}") else None

    @property
    def code(self) -> str:
        """What is to be run."""
        if self.drawing is None:
            return self.body
        start = 0
        while match := _OPTION.match(self.body, start):
            start = match.end()
        return "\n" * self.body[:start].count("\n") + self.body[start:]


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(found["info"].strip(), found["body"], text.count("\n", 0, found.start()) + 1)
        for found in _FENCE.finditer(text)
    ]


def lessons(docs: Path = DOCS) -> list[list[Path]]:
    """Pages with code; the pages of a folder go on from each other, in the order of their names."""
    pages = [page for page in sorted(docs.rglob("*.md")) if any(b.is_python or b.drawing for b in blocks(page))]
    alone = [[page] for page in pages if page.parent == docs]
    folders = dict.fromkeys(page.parent for page in pages if page.parent != docs)
    return [*alone, *([page for page in pages if page.parent == folder] for folder in folders)]


def run(pages: list[Path], work: Path, drawings: Path) -> dict[Path, list[str]]:
    """Run the code of pages that go on from each other, in a folder for the files that it leaves.

    Each figure is left in `drawings` as ``NAME-light.png`` and ``NAME-dark.png``.

    Returns:
        What each page's blocks marked ``python`` printed, in their order.
    """
    from clew.view import DARK, LIGHT, save_figure

    printed: dict[Path, list[str]] = {page: [] for page in pages}
    space: dict[str, Any] = {"__name__": "__lesson__"}
    drawings = drawings.resolve()
    drawings.mkdir(parents=True, exist_ok=True)
    with _inside(work):
        for page in pages:
            for block in blocks(page):
                if not (block.is_python or block.drawing):
                    continue
                code = compile("\n" * block.line + block.code, str(page), "exec")
                if block.is_python:
                    with contextlib.redirect_stdout(io.StringIO()) as out:
                        exec(code, space)  # the pages are ours
                    printed[page].append(out.getvalue())
                    continue
                for name, theme in (("light", LIGHT), ("dark", DARK)):
                    path = drawings / f"{block.drawing}-{name}.png"
                    path.unlink(missing_ok=True)
                    exec(code, space | {"theme": theme, "path": path}, drawn := {})
                    if not path.exists():
                        save_figure(drawn["figure"], path)
    return printed


def commands(page: Path) -> Iterator[tuple[int, list[str]]]:
    """Line and words of each ``clew`` command in the page's blocks marked ``console`` or without a mark."""
    for block in blocks(page):
        if block.info not in ("console", ""):
            continue
        joined = block.body.replace("\\\n", " " * 2)
        for number, line in enumerate(joined.splitlines()):
            words = shlex.split(line.removeprefix("$ "), comments=True) if "clew" in line else []
            if words[:1] == ["clew"]:
                yield block.line + 1 + number, words[1:]


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
