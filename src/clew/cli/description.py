"""A description of a file for people and for programs, and how it is printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text


@dataclass(frozen=True)
class Table:
    """Rows under names; columns of numbers are set right."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass
class Description:
    """What a file holds.

    Attributes:
        kind: what it is called.
        lines: label and text, in the order in which people read.
        table: what comes several times: topics, robots, files; or None.
        problems: what a user should know, a sentence each.
        data: the same for programs.
    """

    kind: str
    lines: list[tuple[str, str]] = field(default_factory=list)
    table: Table | None = None
    problems: list[str] = field(default_factory=list)
    data: dict[str, object] = field(default_factory=dict)

    def print(self, console: Console, path: str) -> None:
        """A screen of aligned text; long texts go on below their own column."""
        with console.capture() as screen:
            self._print(console, path)
        for line in screen.get().splitlines():  # rich fills columns up with blanks
            console.file.write(line.rstrip() + "\n")

    def _print(self, console: Console, path: str) -> None:
        console.print(Text.assemble((path, "bold"), f": {self.kind}"), soft_wrap=True)
        grid = RichTable.grid(padding=(0, 2, 0, 0))
        grid.add_column(no_wrap=True, style="cyan")
        grid.add_column(overflow="fold")
        for label, text in self.lines:
            grid.add_row(label, Text(text))
        console.print(grid)
        if self.table is not None and self.table.rows:
            console.print(_rendered(self.table))
        for problem in self.problems:
            mark = RichTable.grid(padding=(0, 1, 0, 0))
            mark.add_column(no_wrap=True, style="yellow")
            mark.add_column(overflow="fold")
            mark.add_row("!", Text(problem))
            console.print(mark)
        if not self.problems:
            console.print(Text("no problems found", style="green"))


def _rendered(table: Table) -> RichTable:
    shown = RichTable(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="cyan")
    for place, name in enumerate(table.columns):
        numbers = all(row[place][:1].isdigit() or row[place] in ("", "-") for row in table.rows)
        shown.add_column(name, justify="right" if numbers else "left", overflow="fold")
    for row in table.rows:
        shown.add_row(*(Text(cell) for cell in row))
    return shown


def count(number: int, noun: str) -> str:
    """``1 pose``, ``1,728 poses``."""
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def metres(length: float) -> str:
    """A length with its unit, three digits or whole metres."""
    return f"{length:,.0f} m" if abs(length) >= 1000 else f"{length:.3g} m"


def seconds(duration: float) -> str:
    """A duration with its unit; from two minutes on also in minutes and hours."""
    text = f"{duration:,.1f} s"
    if duration >= 7200:
        return f"{text} ({duration / 3600:.1f} h)"
    return f"{text} ({duration / 60:.1f} min)" if duration >= 120 else text
