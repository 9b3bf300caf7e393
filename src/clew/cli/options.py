"""Options that every command has."""

from __future__ import annotations

import logging
from enum import Enum
from typing import Annotated

import typer


class LogLevel(str, Enum):
    """Choices of ``--log-level``."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


def _set_level(level: LogLevel) -> LogLevel:
    logging.getLogger("clew").setLevel(level.value.upper())
    return level


Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print nothing but errors, and JSON if asked for.")]
LogLevelOption = Annotated[
    LogLevel, typer.Option("--log-level", metavar="LEVEL", callback=_set_level, case_sensitive=False,
                           help="What is told of what goes on inside: debug, info, warning or error.")
]
