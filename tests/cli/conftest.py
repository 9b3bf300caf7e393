"""The command as a fixture."""

from __future__ import annotations

from functools import partial

import pytest

from cli.commands import Command, in_process


@pytest.fixture
def clew_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """``clew_command("run", log, "-o", out)`` in this process."""
    return partial(in_process, monkeypatch, capsys)
