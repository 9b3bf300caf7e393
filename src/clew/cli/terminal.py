"""Where text for people goes: results to standard output, progress to standard error."""

from __future__ import annotations

import os

from rich.console import Console

PIPE_WIDTH = 120  # columns, where nobody's window sets them


def results() -> Console:
    """Standard output; in a pipe without colours, and wide unless `COLUMNS` says otherwise."""
    return _wide_in_pipes(Console(highlight=False))


def messages(quiet: bool = False) -> Console:
    """Standard error, for progress and for what a person wants to know beside the result; in a pipe as `results`."""
    return _wide_in_pipes(Console(stderr=True, quiet=quiet, highlight=False))


def _wide_in_pipes(console: Console) -> Console:
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = PIPE_WIDTH
    return console
