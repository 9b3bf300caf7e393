"""The bytes of a file, unpacked by what they are, with clear errors."""

from __future__ import annotations

import bz2
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from clew.errors import InputError

_CHUNK = 1 << 16
_OTHER_PACKERS = {b"PK\x03\x04": "zip", b"\xfd7zXZ\x00": "xz", b"\x28\xb5\x2f\xfd": "zstd",
                  b"7z\xbc\xaf": "7z"}


@dataclass(frozen=True)
class Content:
    """What a file holds.

    Attributes:
        data: the unpacked bytes.
        truncated: whether a packed file ended early or was damaged, so that this is its first part only.
    """

    data: bytes
    truncated: bool = False


class _Unpacker(Protocol):
    @property
    def eof(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, /) -> bytes: ...


def _gzip() -> _Unpacker:
    return zlib.decompressobj(wbits=31)


def _unpack(data: bytes, magic: bytes, make: type[bz2.BZ2Decompressor] | None) -> Content:
    """Everything that can be unpacked; a file may hold several streams one after the other."""
    pieces: list[bytes] = []
    view = memoryview(data)
    while view[: len(magic)] == magic:
        unpacker: _Unpacker = make() if make is not None else _gzip()
        try:
            # In chunks, so that what comes before the damage is kept.
            for start in range(0, len(view), _CHUNK):
                pieces.append(unpacker.decompress(bytes(view[start : start + _CHUNK])))
                if unpacker.eof:
                    view = view[min(start + _CHUNK, len(view)) - len(unpacker.unused_data) :]
                    break
        except (OSError, EOFError, ValueError, zlib.error):
            return Content(b"".join(pieces), truncated=True)
        if not unpacker.eof:
            return Content(b"".join(pieces), truncated=True)
    return Content(b"".join(pieces))


def check_readable(path: Path) -> None:
    """Raise `InputError` unless `path` is there, may be read, and has an end."""
    try:
        if not path.exists():
            raise InputError(f"{path}: no such file; check the path")
        if path.is_char_device() or path.is_block_device():  # some never end
            raise InputError(f"{path}: is a device; store it in a file first")
        if path.is_file():  # opening a pipe waits for its writer
            with path.open("rb"):
                pass
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None


def read_content(path: Path) -> Content:
    """Read a file, unpacking gzip and bzip2 by their magic bytes.

    Raises:
        InputError: the file is missing, unreadable, a folder, empty, or packed in another way.
    """
    check_readable(path)
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give a file")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the file") from None
    if not data:
        raise InputError(f"{path}: the file is empty; give a file with data")
    for magic, name in _OTHER_PACKERS.items():
        if data.startswith(magic):
            raise InputError(f"{path}: packed with {name}; unpack it first (only gzip and bzip2 are read)")
    content = Content(data)
    if data.startswith(b"BZh"):
        content = _unpack(data, b"BZh", bz2.BZ2Decompressor)
    elif data.startswith(b"\x1f\x8b"):
        content = _unpack(data, b"\x1f\x8b", None)
    if not content.data:
        raise InputError(f"{path}: the packed file is empty or damaged; get it again")
    return content


def printable(text: str) -> str:
    """Text that is safe to print on one line."""
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)


def check_text(path: Path, data: bytes) -> None:
    """Raise `InputError` if the beginning of a file is not text."""
    head = data[:4096]
    strange = sum(1 for byte in head if byte < 9 or 13 < byte < 32)
    if strange > 0.1 * len(head):
        raise InputError(f"{path}: is a binary file of an unknown kind; give a text file or a ROS bag")
