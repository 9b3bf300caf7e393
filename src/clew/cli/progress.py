"""What the user sees while a log is mapped."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from clew.slam import Slam

EVERY = 0.1  # seconds between updates


class JobProgress:
    """Stages of a mapping job: scans, refinement, writing."""

    def __init__(self, progress: Progress, scans: int) -> None:
        self._progress = progress
        self._task = progress.add_task("mapping", total=scans, note="")
        self._begun = time.perf_counter()
        self._shown = 0.0
        self._first: float | None = None

    def scan(self, slam: Slam) -> None:
        """A scan has been taken."""
        now = time.perf_counter()
        if now - self._shown < EVERY:
            return
        self._shown = now
        stamps = slam.time_span
        factor = (stamps[1] - stamps[0]) / max(now - self._begun, 1e-6)
        note = f"{slam.closure_count} closures, {factor:.0f} x real time"
        self._progress.update(self._task, completed=slam.scan_count, note=note)

    def refining(self, done: int, most: int) -> None:
        """A round of the refinement is over."""
        if self._progress.tasks[self._task].description == "mapping":
            self._progress.update(self._task, completed=self._progress.tasks[self._task].total)
            self._task = self._progress.add_task("refining", total=most, note="rounds")
        self._progress.update(self._task, completed=done)

    def writing(self) -> None:
        """The estimate stands; files are being written."""
        self._progress.update(self._task, completed=self._progress.tasks[self._task].total)
        self._task = self._progress.add_task("writing", total=None, note="map and pictures")


@contextmanager
def job_progress(console: Console, scans: int, quiet: bool) -> Iterator[JobProgress]:
    """Progress bars on a terminal; nothing elsewhere."""
    columns = (
        TextColumn("{task.description:>9}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal) as progress:
        yield JobProgress(progress, scans)
