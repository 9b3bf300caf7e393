"""Files appear whole or not at all."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from clew.errors import InputError
from clew.io import atomic_write, atomic_write_binary, ensure_output_folder


def test_a_file_takes_its_name_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with atomic_write(path) as file:
        file.write("grün\n")
        file.flush()
        assert not path.exists()
    assert path.read_bytes() == "grün\n".encode()
    with atomic_write_binary(path) as binary:
        binary.write(b"\x00\r\n")
    assert path.read_bytes() == b"\x00\r\n"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, OSError])
def test_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")


    def fail() -> None:
        with atomic_write(path) as file:
            file.write("new")
            raise error

    with pytest.raises(InputError if error is OSError else error):
        fail()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_permissions_and_links_are_the_usual_ones(tmp_path: Path) -> None:
    mask = os.umask(0)
    os.umask(mask)
    target, link = tmp_path / "target", tmp_path / "link"
    target.touch()
    link.symlink_to(target)
    with atomic_write(link) as file:
        file.write("x")
    assert link.is_symlink()
    assert target.read_text() == "x"
    assert stat.S_IMODE(target.stat().st_mode) == 0o666 & ~mask


def test_a_device_is_written_not_replaced() -> None:
    with atomic_write("/dev/null") as file:
        file.write("x")
    assert Path("/dev/null").is_char_device()


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path, tmp_path / "none" / "a", tmp_path / "file" / "a"):
        with pytest.raises(InputError, match=str(path)), atomic_write(path) as file:
            file.write("x")
    assert ensure_output_folder(tmp_path / "a" / "b").is_dir()
    for path in (tmp_path / "file", tmp_path / "file" / "b", Path("/proc/none")):
        with pytest.raises(InputError, match=str(path)):
            ensure_output_folder(path)
    assert sorted(os.listdir(tmp_path)) == ["a", "file"]
