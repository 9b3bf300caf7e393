"""The pages of the documentation: their code runs, their commands exist, their links lead somewhere."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from clew.cli.main import app

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def _pages() -> Any:
    spec = importlib.util.spec_from_file_location("clew_docs_pages", DOCS / "_ext" / "pages.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


pages = _pages()
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
LESSONS = [*pages.lessons(DOCS), [ROOT / "README.md"]]


@pytest.mark.parametrize("lesson", LESSONS, ids=lambda lesson: lesson[0].parent.name + "-" + lesson[0].stem)
def test_the_code_of_a_page_runs_and_draws_its_figures(lesson: list[Path], tmp_path: Path) -> None:
    printed = pages.run(lesson, tmp_path / "work", tmp_path / "drawings")
    for page in lesson:
        code = [block for block in pages.blocks(page) if block.is_python]
        assert len(printed[page]) == len(code)
    drawn = [block.drawing for page in lesson for block in pages.blocks(page) if block.drawing]
    assert len(set(drawn)) == len(drawn)
    for name in drawn:
        for theme in ("light", "dark"):
            assert (tmp_path / "drawings" / f"{name}-{theme}.png").stat().st_size > 5000


def test_there_are_lessons_to_run() -> None:
    assert sum(len(lesson) for lesson in LESSONS) >= 10
    assert [page.name for page in LESSONS[-2]][:2] == ["1-models.md", "2-errors.md"]


def test_code_that_fails_fails_the_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A page\n\n```python\nx = 1\n```\n\n```python\nassert x == 2\n```\n")
    with pytest.raises(AssertionError) as caught:
        pages.run([page], tmp_path / "work", tmp_path)
    assert caught.traceback[-1].lineno + 1 == 8  # the line of the page


COMMANDS = [(page, line, words) for page in PAGES for line, words in pages.commands(page)]


def understood(words: list[str]) -> None:
    """Raise unless a command line names a command and options that exist; files need not."""
    group: Any = typer.main.get_command(app)
    if words[0].startswith("-"):  # such options act at once: look for them, and do not call them
        assert words[0] in {name for parameter in group.params for name in parameter.opts}
        return
    context = group.make_context("clew", [*words])
    name, command, rest = group.resolve_command(context, [*words])
    assert command is not None, name
    command.make_context(name, rest, parent=context)


@pytest.mark.parametrize(("page", "line", "words"), COMMANDS,
                         ids=[f"{page.stem}:{line}" for page, line, _ in COMMANDS])
def test_the_commands_of_the_pages_exist(page: Path, line: int, words: list[str]) -> None:
    understood(words)


def test_commands_that_do_not_exist_are_told() -> None:
    wrong = (["map", "x"], ["run", "x", "-o", "out", "--fast"], ["run", "x"], ["optimize", "x", "--method", "magic"])
    for words in wrong:
        with pytest.raises(Exception, match=r"(?i)no such|missing|is not one of"):
            understood(words)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if not target.startswith(("http", "#")):
            assert (page.parent / target.partition("#")[0]).exists(), f"{page}: {target}"
