"""Text files of numbers, one row a line; the base of TUM, KITTI and relations files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.errors import InputError
from clew.io.atomic import atomic_write
from clew.io.content import check_text, read_content

Array = NDArray[np.float64]


def read_table(path: Path, columns: int, row: str) -> tuple[Array, NDArray[np.int64]]:
    """Rows ``(N, columns)`` of finite numbers and the line ``(N,)`` of each; `row` names the fields.

    Raises:
        InputError: the file cannot be read, holds no row, or a line is not such a row.
    """
    content = read_content(path)
    check_text(path, content.data)
    if content.truncated:
        raise InputError(f"{path}: the packed file ends early or is damaged; get it again")
    return parse_rows(path, content.data, columns, row)


def parse_rows(path: Path, data: bytes, columns: int, row: str) -> tuple[Array, NDArray[np.int64]]:
    """As `read_table`, of what the file at `path` holds."""
    values, lines, bad_line, bad_count = _native.io.parse_table(data, columns)
    if bad_line:
        found = f"{bad_count} numbers" if bad_count != columns else "text behind them"
        raise InputError(f"{path}, line {bad_line}: {columns} finite numbers ({row}) expected, "
                         f"found {found}; correct or remove the line")
    if len(values) == 0:
        raise InputError(f"{path}: holds no line of {columns} numbers ({row}); give a file with data")
    return values, lines


def write_table(path: Path, rows: Array, formats: list[str], header: str | None = None, *,
                comma: bool = False) -> None:
    """Write ``(N, columns)`` numbers, one ``%`` format a column, after an optional line that names them.

    Columns are parted by spaces and the names are a comment; with `comma`, by commas, and they are none.
    """
    line = ("," if comma else " ").join(formats) + "\n"
    with atomic_write(path) as file:
        if header is not None:
            file.write(f"{header}\n" if comma else f"# {header}\n")
        # Adding zero turns -0.0 into 0.0.
        file.write((line * len(rows)) % tuple((np.asarray(rows, dtype=np.float64) + 0.0).ravel().tolist()))


def time_format(timestamps: Array) -> str:
    """Microseconds, or nanoseconds where the timestamps are finer."""
    exact = np.array([float(f"{t:.6f}") for t in timestamps.tolist()])
    return "%.6f" if np.array_equal(exact, timestamps) else "%.9f"
