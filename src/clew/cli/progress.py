"""What the user sees while something takes its time: how far, how fast, how long still."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn
from rich.text import Text

if TYPE_CHECKING:
    from clew.slam import Slam
    from clew.solve import Progress as Step

EVERY = 0.1  # seconds between updates


class _Done(ProgressColumn):
    """``1,200/13,631``; nothing while the number is not known."""

    def render(self, task: Task) -> Text:
        if not task.fields["counted"] or task.total is None:
            return Text(f"{int(task.completed):,}" if task.completed > 1 else "")
        return Text(f"{int(task.completed):,}/{int(task.total):,}", style="progress.download")


class _Speed(ProgressColumn):
    """``310/s``, over the last seconds."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        if not speed or not task.fields["counted"]:
            return Text("")
        return Text(f"{speed:,.0f}/s" if speed >= 10 else f"{speed:.1f}/s")


class _Left(ProgressColumn):
    """``0:12 left``, or how long it took once it is done."""

    max_refresh = 0.5

    def render(self, task: Task) -> Text:
        if task.finished or task.total is None or task.time_remaining is None:
            return Text(_clock(task.finished_time or task.elapsed or 0.0))
        return Text(f"{_clock(task.time_remaining)} left", style="progress.remaining")


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


class Stages:
    """One bar below the other, a stage each; nothing but on a terminal."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._task: TaskID | None = None
        self._name = ""

    def begin(self, name: str, total: float | None = None, note: str = "") -> None:
        """The stage before is over; begin the next one."""
        self.end()
        self._task = self._progress.add_task(name, total=total, note=note, counted=total is not None)
        self._name = name

    def end(self) -> None:
        """The present stage is over."""
        if self._task is not None:
            task = self._progress.tasks[self._task]
            total = task.total if task.total is not None else max(task.completed, 1)
            self._progress.update(self._task, total=total, completed=total)
            self._task = None
            self._name = ""

    def show(self, done: float, note: str | None = None) -> None:
        """How far the present stage is."""
        if self._task is not None:
            if note is not None:
                self._progress.update(self._task, note=note)
            self._progress.update(self._task, completed=done)

    def counter(self, name: str, note: str = "") -> Callable[[int, int], None]:
        """A callback ``(done, most)`` that begins the stage when it is first called."""

        def count(done: int, most: int) -> None:
            if self._name != name:
                self.begin(name, most, note)
            self.show(done)

        return count

    def stages(self, notes: Mapping[str, str]) -> Callable[[str, int, int], None]:
        """A callback ``(stage, done, most)`` that begins each stage when it is first told of it.

        Args:
            notes: what is counted, by stage.
        """

        def tell(stage: str, done: int, most: int) -> None:
            self.counter(stage, notes.get(stage, ""))(done, most)

        return tell

    def iterations(self, limit: int) -> Callable[[Step], None]:
        """A callback for `clew.solve.optimize`; a solve ends when it has converged, so there is no total."""
        shown = [0.0]

        def step(at: Step) -> None:
            now = time.perf_counter()
            if now - shown[0] >= EVERY:
                shown[0] = now
                self.show(at.iteration, f"of at most {limit} iterations, chi2 {at.chi2:.6g}")

        return step


class JobProgress:
    """Stages of a mapping job: scans, closures that were left open, refinement, map, files."""

    def __init__(self, stages: Stages, scans: int) -> None:
        self._stages = stages
        self._scans = scans
        self._begun = time.perf_counter()
        self._shown = 0.0
        stages.begin("mapping", scans)

    def scan(self, slam: Slam) -> None:
        """A scan has been taken."""
        now = time.perf_counter()
        if now - self._shown < EVERY:
            return
        self._shown = now
        begin, end = slam.time_span
        factor = (end - begin) / max(now - self._begun, 1e-6)
        self._stages.show(slam.scan_count, f"{slam.closure_count} closures, {factor:.0f} x real time")

    def closing(self, done: int, most: int) -> None:
        """A keyframe has been tried again that could not be closed; 0 of them when it begins."""
        if done == 0:
            self._stages.begin("closing", most, "keyframes at most, tried again")
        self._stages.show(done)

    def refining(self, done: int, most: int) -> None:
        """A round of the refinement is over; 0 of them when it begins."""
        if done == 0:
            self._stages.begin("refining", most, "rounds at most")
        self._stages.show(done)

    def mapped(self, done: int, most: int) -> None:
        """Scans that are in the map; 0 when the estimate stands, and with the last one the files are written."""
        if done == 0:
            self._stages.begin("map", most, "scans at their last poses")
        self._stages.show(done)
        if done == most:
            self._stages.begin("writing", note="files, pictures, report")


@contextmanager
def stages(console: Console) -> Iterator[Stages]:
    """Progress on a terminal; nothing in a pipe or when the console is quiet."""
    columns = (TextColumn("{task.description:<9}"), BarColumn(bar_width=16), _Done(), _Speed(), _Left(),
               TextColumn("{task.fields[note]}", style="dim"))
    off = console.quiet or not console.is_terminal
    with Progress(*columns, console=console, disable=off) as progress:
        shown = Stages(progress)
        yield shown
        shown.end()


@contextmanager
def job_progress(console: Console, scans: int) -> Iterator[JobProgress]:
    """Progress of a mapping job."""
    with stages(console) as shown:
        yield JobProgress(shown, scans)
