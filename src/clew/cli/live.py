"""The options ``--live``, and the viewers behind them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol

import typer
from typer.core import TyperCommand

from clew.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from clew.slam import Slam
    from clew.view.live import BrowserViewer

BROWSER, RERUN = "browser", "rerun"
FIRST_PAGE = 3.0  # seconds that a browser gets to open the page before the run begins

_PANEL = "Live view"
LiveOption = Annotated[str | None, typer.Option(
    "--live", metavar="WHERE", show_default=False, rich_help_panel=_PANEL,
    help="Show map and graph while they grow: browser (if WHERE is left out), rerun, or FILE.rrd, a recording for "
         "rerun.")]  # fmt: skip
LiveHost = Annotated[str, typer.Option(
    "--live-host", metavar="HOST", rich_help_panel=_PANEL,
    help="Where the page is served; 0.0.0.0 lets other machines in.")]  # fmt: skip
LivePort = Annotated[int, typer.Option(
    "--live-port", metavar="PORT", rich_help_panel=_PANEL, help="Its port; 0 takes any that is free.")]
LiveNoOpen = Annotated[bool, typer.Option(
    "--no-open", rich_help_panel=_PANEL, help="Print the address of the page only; do not open the browser.")]
LiveKeep = Annotated[bool, typer.Option(
    "--live-keep", rich_help_panel=_PANEL, help="Keep the page served at the end, until Ctrl-C.")]


class LiveCommand(TyperCommand):
    """A command whose option ``--live`` may stand without a value: then it is the browser's."""

    # Click's context is typed as object, for versions of typer keep it in different places.
    def parse_args(self, ctx: object, args: list[str]) -> list[str]:
        """Put the value in where it is left out."""
        full: list[str] = []
        for place, word in enumerate(args):
            full.append(word)
            following = args[place + 1] if place + 1 < len(args) else ""
            if word == "--live" and following not in (BROWSER, RERUN) and not following.endswith(".rrd"):
                full.append(BROWSER)
        return super().parse_args(ctx, full)  # type: ignore[arg-type]  # the context, typed as object


@dataclass(frozen=True)
class LiveOptions:
    """Attributes: what was asked for, as in `clew run --help`."""

    where: str | None = None
    host: str = "127.0.0.1"
    port: int = 0
    no_open: bool = False
    keep: bool = False


class JobViewer(Protocol):
    """A viewer that is also told what goes on."""

    def update(self, slam: Slam) -> None: ...
    def moved(self, slam: Slam) -> None: ...
    def stage(self, stage: str) -> None: ...
    def finish(self, stage: str = "finished") -> None: ...
    def close(self, stage: str = "finished") -> None: ...


class NoViewer:
    """What a job has without ``--live``."""

    def update(self, slam: Slam) -> None:
        """Nothing."""

    def moved(self, slam: Slam) -> None:
        """Nothing."""

    def stage(self, stage: str) -> None:
        """Nothing."""

    def finish(self, stage: str = "finished") -> None:
        """Nothing."""

    def close(self, stage: str = "finished") -> None:
        """Nothing."""


@contextmanager
def live_view(options: LiveOptions, title: str, total: int, console: Console) -> Iterator[JobViewer]:
    """The viewer that was asked for, open while the block lasts.

    Raises:
        InputError: it cannot be opened, or there is no such viewer.
        MissingDependencyError: rerun is asked for and is missing, or does not fit.
    """
    if options.where is None:
        yield NoViewer()
        return
    viewer = _rerun(options.where, title, total) if options.where != BROWSER else _browser(
        options, title, total, console)
    try:
        yield viewer
        viewer.finish()
        if options.keep and options.where == BROWSER:
            with suppress(KeyboardInterrupt):
                console.print("the live view stays open; Ctrl-C ends it")
                while True:
                    time.sleep(3600)
    finally:
        viewer.close("stopped")


def _rerun(where: str, title: str, total: int) -> JobViewer:
    from clew.view.live import RerunViewer

    if where != RERUN and not where.endswith(".rrd"):
        raise InputError(f"--live {where}: choose {BROWSER}, {RERUN}, or the name of a recording, FILE.rrd")
    return RerunViewer(title, None if where == RERUN else Path(where), total)


def _browser(options: LiveOptions, title: str, total: int, console: Console) -> BrowserViewer:
    from clew.cli.browser import open_in_browser
    from clew.view.live import BrowserViewer

    viewer = BrowserViewer(title, options.host, options.port, total)
    console.print(f"live view: {viewer.url}", soft_wrap=True, markup=False)
    if not options.no_open and open_in_browser(viewer.url):
        until = time.monotonic() + FIRST_PAGE  # so that a short run is seen at all
        while not viewer.server.streams and time.monotonic() < until:
            time.sleep(0.05)
    return viewer
