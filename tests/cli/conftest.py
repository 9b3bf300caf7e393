"""The command as a fixture."""

from __future__ import annotations

import signal
from functools import partial

import pytest

from cli.commands import Command, in_process


@pytest.fixture
def clew_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """``clew_command("run", log, "-o", out)`` in this process."""
    return partial(in_process, monkeypatch, capsys)


@pytest.fixture(autouse=True, scope="session")
def _ctrl_c_is_heard() -> None:
    """A shell starts what runs in the background deaf to Ctrl-C, and so would be the commands that are tested."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
