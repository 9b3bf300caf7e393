"""Entry point: the commands, and what becomes of errors."""

from __future__ import annotations

import logging
import os
import sys
from typing import Annotated

import typer

from clew._version import __version__
from clew.cli.convert import convert
from clew.cli.demo import demo
from clew.cli.evaluate import evaluate
from clew.cli.info import info
from clew.cli.live import LiveCommand
from clew.cli.merge import merge
from clew.cli.optimize import optimize
from clew.cli.run import run
from clew.cli.view import view
from clew.errors import ClewError

BAD_INPUT = 2
INTERRUPTED = 130
_UsageError = typer.BadParameter.__mro__[1]  # click's, which versions of typer keep in different places

app = typer.Typer(
    name="clew",
    help="Graph SLAM: a robot's log in, an optimised trajectory and a map out.",
    epilog="Begin with:  clew demo -o demo   then:  clew run LOG -o OUT",
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)
app.command(cls=LiveCommand)(run)
app.command(cls=LiveCommand)(demo)
app.command()(optimize)
app.command()(evaluate)
app.command()(merge)
app.command()(info)
app.command()(convert)
app.command()(view)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"clew {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Graph SLAM: a robot's log in, an optimised trajectory and a map out."""


def main() -> None:
    """Run the command; bad input ends with one line on standard error and exit code 2."""
    # Our matrices are small or our own; NumPy's BLAS would start threads that spin and win nothing.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    logging.basicConfig(format="clew: %(message)s", level=logging.WARNING)
    try:
        code = app(sys.argv[1:] or ["--help"], prog_name="clew", standalone_mode=False)
    except ClewError as error:
        sys.stderr.write(f"clew: {error}\n")
        sys.exit(BAD_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has left (`clew ... | head`): nothing to say to nobody.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except Exception as error:
        if not isinstance(error, _UsageError):
            raise
        sys.stderr.write(f"clew: {_usage(error)}\n")
        sys.exit(BAD_INPUT)
    if code == INTERRUPTED:
        sys.stderr.write("clew: interrupted\n")
    sys.exit(code or 0)


def _usage(error: Exception) -> str:
    """What is wrong with the command line, in one line."""
    message = " ".join(str(getattr(error, "message", "") or error).split())
    context = getattr(error, "ctx", None)
    return f"{message.rstrip('.')}; see `{context.command_path if context else 'clew'} --help`"
