"""``clew view``: the report page of an output folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet

PAGE = "report.html"


def view(
    out: Annotated[Path, typer.Argument(metavar="OUT", show_default=False,
                                        help="Output folder of a run or a merge, a result of an optimisation, or "
                                             "a page.")],
    no_open: Annotated[bool, typer.Option("--no-open", help="Only print where the page is.")] = False,
    json: Json = False,
    quiet: Quiet = False,
    log_level: LogLevelOption = LogLevel.WARNING,
) -> None:
    """Open the report of a run in the browser.

    Where there is no browser, the path of the page is printed: copy the page wherever you like, it needs nothing
    beside itself.

    **Examples**

    `clew view out`

    `clew view best.g2o`

    `clew view out --no-open`
    """
    import json as json_

    from clew.cli.browser import open_in_browser

    page = find_page(out)
    opened = not no_open and open_in_browser(page.as_uri())
    if json:
        typer.echo(json_.dumps({"page": str(page), "opened": opened}))
    elif not quiet:
        typer.echo(f"opened {page}" if opened else str(page))


def find_page(out: Path) -> Path:
    """The absolute path of the page of an output folder, or of a result that has its report beside it.

    Raises:
        InputError: there is none, or a folder has several.
    """
    from clew.cli.solution_outputs import REPORT_ENDING, report_beside
    from clew.errors import InputError

    if out.is_file() and out.suffix.lower() in (".html", ".htm"):
        return out.resolve()
    if not out.exists():
        raise InputError(f"{out}: no such folder; give the output folder of `clew run`, `optimize` or `merge`")
    if not out.is_dir():
        beside = report_beside(out)
        if beside.is_file():
            return beside.resolve()
        raise InputError(f"{out}: has no {beside.name} beside it; give the output folder of `clew run` or `merge`, or "
                         "a result of `clew optimize`")
    if (out / PAGE).is_file():
        return (out / PAGE).resolve()
    pages = sorted(out.glob(f"*{REPORT_ENDING}"))
    if len(pages) > 1:
        names = ", ".join(page.name for page in pages[:4]) + (", ..." if len(pages) > 4 else "")
        raise InputError(f"{out}: holds {len(pages)} reports; choose one: {names}")
    if not pages:
        raise InputError(f"{out}: holds no {PAGE}; make one with `clew run LOG -o {out}`")
    return pages[0].resolve()
