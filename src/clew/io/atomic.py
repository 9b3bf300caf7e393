"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path
from typing import IO, BinaryIO, TextIO, cast

from clew.errors import InputError


@contextmanager
def _aside(path: Path, binary: bool) -> Iterator[IO[bytes] | IO[str]]:
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    special = target.exists() and not target.is_file()  # a pipe or a device is written, never replaced
    aside = target if special else target.with_name(f".{target.name[:100]}.{os.getpid()}.part")
    try:
        encoding = None if binary else "utf-8"
        with aside.open("wb" if binary else "w", encoding=encoding, newline=None if binary else "\n") as file:
            yield file
        if not special:
            aside.replace(target)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); "
                         "choose another place or make room") from error
    finally:
        if not special:
            with suppress(OSError):
                aside.unlink()


@contextmanager
def atomic_write(path: str | PathLike[str]) -> Iterator[TextIO]:
    """A text file (UTF-8, line ends as given) that takes its name only when the block ends without an error.

    It is written aside in the same folder; nothing is left behind on failure, and an older file of that name
    stays as it was.

    Raises:
        InputError: the file cannot be written.
    """
    with _aside(Path(path), binary=False) as file:
        yield cast(TextIO, file)


@contextmanager
def atomic_write_binary(path: str | PathLike[str]) -> Iterator[BinaryIO]:
    """As `atomic_write`, for bytes."""
    with _aside(Path(path), binary=True) as file:
        yield cast(BinaryIO, file)


def ensure_output_folder(path: str | PathLike[str]) -> Path:
    """Make a folder (and those above it) unless it is there, and check that files can be written in it.

    Raises:
        InputError: it cannot be made or written.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{folder}: there is a file of that name; choose another output folder") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror or error}); "
                         "choose another output folder") from None
    return folder
