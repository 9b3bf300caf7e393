"""What all commands have in common: help with examples, --quiet, --json, --log-level; completion; progress."""

from __future__ import annotations

import logging
import subprocess
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from clew.cli.progress import stages
from clew.cli.terminal import PIPE_WIDTH, results
from clew.sim import write_carmen
from cli.commands import PROGRAM, Command, drive, environment

COMMANDS = ("run", "demo", "optimize", "evaluate", "merge", "info", "convert", "view")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_the_common_options_and_an_example(command: str, clew_command: Command) -> None:
    text = clew_command(command, "--help").out
    for word in ("--json", "--quiet", "--log-level", "Example", f"clew {command} "):
        assert word in text


def test_log_level_tells_more(tmp_path: Path, clew_command: Command, caplog: pytest.LogCaptureFixture) -> None:
    write_carmen(drive(), tmp_path / "a.log")
    arguments = ("run", tmp_path / "a.log", "-o", tmp_path / "out", "-q")
    try:
        for level, told in (("warning", False), ("info", True), ("INFO", True)):
            caplog.clear()
            assert clew_command(*arguments, "--log-level", level).code == 0
            assert any("closures" in record.message for record in caplog.records) is told
        assert clew_command(*arguments, "--log-level", "loud").code == 2
    finally:
        logging.getLogger("clew").setLevel(logging.NOTSET)


@pytest.mark.parametrize(("words", "place", "expected"), [
    ("clew conv", 1, {"convert"}), ("clew run --live-", 2, {"--live-host", "--live-port", "--live-keep"}),
    ("clew convert --to k", 3, {"kitti"})])
def test_bash_completes(words: str, place: int, expected: set[str]) -> None:
    done = subprocess.run(PROGRAM, capture_output=True, text=True, timeout=60, check=False, env={
        **environment(), "_CLEW_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(place)})
    assert (done.returncode, done.stderr) == (0, "")
    assert set(done.stdout.split()) == expected


def screen(terminal: bool, width: int = 80) -> tuple[Console, StringIO]:
    text = StringIO()
    return Console(file=text, force_terminal=terminal, width=width, color_system=None), text


def test_progress_is_told_on_a_terminal_only() -> None:
    for terminal in (True, False):
        console, text = screen(terminal)
        with stages(console) as shown:
            shown.begin("mapping", 1000)
            shown.show(400, "7 closures, 50 x real time")
            count = shown.counter("aligning")
            count(3, 9)
        told = text.getvalue()
        if terminal:
            for word in ("mapping", "1,000/1,000", "aligning", "9/9"):
                assert word in told
        else:
            assert told == ""


def test_quiet_console_shows_no_progress() -> None:
    text = StringIO()
    console = Console(file=text, force_terminal=True, quiet=True)
    with stages(console) as shown:
        shown.begin("mapping", 10)
        shown.show(5)
    assert text.getvalue() == ""


def test_pipes_get_wide_text_without_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    console = results()
    assert not console.is_terminal
    assert console.color_system is None
    assert console.width == PIPE_WIDTH


def test_importing_the_command_is_cheap() -> None:
    """Help and completion load no numbers and no pictures."""
    program = "import sys, clew.cli; print([name for name in ('numpy', 'scipy', 'matplotlib') if name in sys.modules])"
    done = subprocess.run([PROGRAM[0], "-c", program], capture_output=True, text=True, timeout=60, check=True,
                          env=environment())
    assert done.stdout.strip() == "[]"
