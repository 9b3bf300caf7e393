"""Opens a log of any kind, recognised by its content."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from clew.errors import InputError
from clew.io.carmen import read_carmen
from clew.io.content import check_readable, check_text, read_content
from clew.io.log import Log

_GRAPH_TAGS = (b"VERTEX", b"EDGE", b"FIX", b"PARAMS_")


def open_log(path: str | PathLike[str]) -> Log:
    """Open a robot's log: a CARMEN text log, plain or packed with gzip or bzip2.

    Raises:
        InputError: the file is missing, unreadable, of another kind, mostly damaged, or without a scan.
    """
    path = Path(path)
    check_readable(path)
    content = read_content(path)
    check_text(path, content.data)
    if content.data.lstrip().startswith(_GRAPH_TAGS):
        raise InputError(f"{path}: is a pose graph, not a log; optimise it with `clew optimize`")
    return read_carmen(path, content)
