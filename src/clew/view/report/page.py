"""The page of a report: text in HTML, everything else beside it in the same file."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from clew._version import __version__
from clew.io import atomic_write
from clew.view.report.content import Chart, Focus, Note, Report, Section, Table
from clew.view.report.data import scene_data
from clew.view.report.encode import pack

#: Put together in this order; each file's names are seen by those after it.
SCRIPTS = ("data", "colours", "camera", "grid", "strokes", "paint", "pick", "overlay", "inspect", "timeline", "charts",
           "main")
_LEVELS = {"check": "Check", "know": "Know", "good": "Good"}
_SHOWN = 6  # notes before the rest is folded away


def write_report(path: str | Path, report: Report) -> None:
    """Write a report as one HTML file that needs nothing else: no network, no server.

    The bytes depend on nothing but the report.

    Raises:
        InputError: the file cannot be written.
    """
    page = render(report)
    with atomic_write(path) as file:
        file.write(page)


def render(report: Report) -> str:
    """The page as text."""
    charts: list[dict[str, object]] = []
    data = scene_data(report.scene)
    sections = "\n".join(_section(section, charts, float(str(data["begin"]))) for section in report.sections)
    parts = {
        "title": escape(report.title),
        "kind": {"run": "Map", "optimize": "Graph", "merge": "Merge"}[report.kind],
        "lead": "\n".join(f"<p>{escape(line)}</p>" for line in report.lead),
        "notes": _notes(report.notes),
        "sections": sections,
        "version": escape(__version__),
        "style": _asset("report.css"),
        "script": "\n".join(_asset(f"{name}.js") for name in SCRIPTS),
        "data": _json({**data, "charts": charts}),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], _asset("report.html"))


def _asset(name: str) -> str:
    return (files("clew.view.report") / "assets" / name).read_text(encoding="utf-8")


def _json(data: object) -> str:
    """JSON that may stand in a script element: no tag can begin in it."""
    text = json.dumps(data, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _leads_to(focus: Focus | None) -> str:
    if focus is None:
        return ""
    return f' data-focus="{escape(focus.kind)} {focus.first} {focus.last}"'


def _notes(notes: Sequence[Note]) -> str:
    if not notes:
        notes = [Note("Nothing stands out: no closure was withdrawn, no stretch hangs on odometry alone, and the "
                      "residuals are as large as the noise says.", "good")]
    shown = "\n".join(_note(note) for note in notes[:_SHOWN])
    html = f'<ul class="notes">{shown}</ul>'
    if len(notes) > _SHOWN:
        rest = "\n".join(_note(note) for note in notes[_SHOWN:])
        html += f'<details><summary>{len(notes) - _SHOWN} more</summary><ul class="notes">{rest}</ul></details>'
    return html


def _note(note: Note) -> str:
    button = "" if note.focus is None else (
        f'<button type="button" class="show"{_leads_to(note.focus)}>Show on the map</button>')
    return (f'<li class="{escape(note.level)}"><span class="tag">{_LEVELS[note.level]}</span>'
            f"<span>{escape(note.text)} {button}</span></li>")


def _section(section: Section, charts: list[dict[str, object]], begin: float) -> str:
    facts = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in section.facts)
    parts = [f"<h2>{escape(section.title)}</h2>"]
    if facts:
        parts.append(f"<dl>{facts}</dl>")
    if section.notes:
        parts.append(_notes(section.notes))
    parts += [_chart(chart, charts, begin) for chart in section.charts]
    parts.append('<div class="tables">' + "".join(_table(table) for table in section.tables) + "</div>")
    return "<section>" + "\n".join(parts) + "</section>"


def _table(table: Table) -> str:
    title = f"<h3>{escape(table.title)}</h3>"
    if not table.rows:
        return f'<div class="table">{title}<p class="empty">{escape(table.empty)}</p></div>'
    head = "".join(f'<th scope="col">{escape(column)}</th>' for column in table.columns)
    focus = [*table.focus, *[None] * (len(table.rows) - len(table.focus))]
    body = "".join(_row(row, leads_to) for row, leads_to in zip(table.rows, focus, strict=True))
    caption = f'<p class="caption">{escape(table.caption)}</p>' if table.caption else ""
    return (f'<div class="table">{title}<div class="scroll" tabindex="0" role="region" '
            f'aria-label="{escape(table.title)}"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
            f"</div>{caption}</div>")


def _row(row: Sequence[str], focus: Focus | None) -> str:
    first = escape(row[0])
    if focus is not None:
        first = f'<button type="button" class="show"{_leads_to(focus)}>{first}</button>'
    return "<tr><td>" + first + "</td>" + "".join(f"<td>{escape(text)}</td>" for text in row[1:]) + "</tr>"


def _chart(chart: Chart, charts: list[dict[str, object]], begin: float) -> str:
    number = len(charts)
    charts.append({
        "unit": chart.unit,
        "time": pack(chart.times - begin, "f4"),
        "curves": [{"name": name, "values": pack(values, "f4")} for name, values in chart.curves],
    })  # fmt: skip
    return (f'<figure class="chart"><h3>{escape(chart.title)}</h3>'
            f'<canvas data-chart="{number}" tabindex="0" role="img" '
            f'aria-label="{escape(chart.title)}. {escape(chart.caption)}"></canvas>'
            f"<figcaption>{escape(chart.caption)} Click to go to a moment.</figcaption></figure>")
