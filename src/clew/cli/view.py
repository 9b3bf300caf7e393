"""``clew view``: the report page of an output folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet

PAGE = "report.html"


def view(
    out: Annotated[Path, typer.Argument(metavar="OUT", show_default=False,
                                        help="Output folder of a run, an optimisation or a merge, or its page.")],
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
    """The absolute path of the page of an output folder.

    Raises:
        InputError: there is none.
    """
    from clew.errors import InputError

    if out.is_file() and out.suffix.lower() in (".html", ".htm"):
        return out.resolve()
    if not out.exists():
        raise InputError(f"{out}: no such folder; give the output folder of `clew run`, `optimize` or `merge`")
    if not out.is_dir():
        raise InputError(f"{out}: is no folder; give the output folder of `clew run`, `optimize` or `merge`")
    page = out / PAGE
    if not page.is_file():
        raise InputError(f"{out}: holds no {PAGE}; make one with `clew run LOG -o {out}`")
    return page.resolve()
