"""``clew view``: finds the page, and opens a browser only where there is a screen."""

from __future__ import annotations

import json
import webbrowser
from pathlib import Path

import pytest

from clew.cli.browser import open_in_browser
from cli.commands import Command
from cli.test_bad_input import assert_refused


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Addresses that the browser was asked to open."""
    addresses: list[str] = []

    class Recorder(webbrowser.BaseBrowser):
        def open(self, url: str, new: int = 0, autoraise: bool = True) -> bool:
            addresses.append(url)
            return True

    webbrowser.register("recorder", None, Recorder(), preferred=True)
    monkeypatch.setenv("DISPLAY", ":99")
    yield addresses
    webbrowser._tryorder.remove("recorder")  # type: ignore[attr-defined]  # there is no way to take a browser back


def page(folder: Path) -> Path:
    (folder / "my out").mkdir()
    (folder / "my out" / "report.html").write_text("<!doctype html>")
    return folder / "my out"


def test_page_is_opened(tmp_path: Path, clew_command: Command, opened: list[str]) -> None:
    out = page(tmp_path)
    assert clew_command("view", out).out == f"opened {out / 'report.html'}\n"
    assert opened == [(out / "report.html").as_uri()]
    assert clew_command("view", out / "report.html").code == 0


def test_page_is_only_named_if_asked_or_without_a_screen(
    tmp_path: Path, clew_command: Command, opened: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = page(tmp_path)
    assert clew_command("view", out, "--no-open").out == f"{out / 'report.html'}\n"
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    assert not open_in_browser("http://127.0.0.1/")
    assert json.loads(clew_command("view", out, "--json").out) == {"page": str(out / "report.html"), "opened": False}
    assert clew_command("view", out, "-q").out == ""
    assert opened == []


def test_report_beside_a_result_is_found_by_the_result_and_by_its_folder(
    tmp_path: Path, clew_command: Command, opened: list[str]
) -> None:
    for name in ("best.g2o.gz", "best.report.html"):
        (tmp_path / name).write_text("x")
    for given in (tmp_path, tmp_path / "best.g2o.gz"):
        assert clew_command("view", given).out == f"opened {tmp_path / 'best.report.html'}\n"
    (tmp_path / "other.report.html").write_text("x")
    done = clew_command("view", tmp_path)
    assert_refused(done)
    assert "best.report.html, other.report.html" in done.err
    (tmp_path / "report.html").write_text("x")
    assert clew_command("view", tmp_path).out == f"opened {tmp_path / 'report.html'}\n"


def test_folder_without_page_is_refused(tmp_path: Path, clew_command: Command) -> None:
    (tmp_path / "file").write_text("x")
    for name, word in (("", "clew run LOG"), ("none", "no such folder"), ("file", "file.report.html beside it")):
        done = clew_command("view", tmp_path / name)
        assert_refused(done)
        assert word in done.err
