"""Reads the DLR landmark data: odometry steps and artificial circles on the floor that a camera saw.

Kurlbaum, Frese: "A benchmark data set for data association" (University of Bremen, 2008). The file's robot looks along
its negative y axis and has x to its right, so its frame is left-handed seen from above: it becomes clew's (x forward,
y left) by ``(x, y, theta) -> (-y, -x, -theta)``.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import so2
from clew.io.content import check_text, printable, read_content
from clew.io.feature_drive import FeatureLog
from clew.io.graph_file import Features
from clew.io.log import ReadReport

Array = NDArray[np.float64]

_TO_CLEW = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_STEP, _LANDMARK = b"STEP", (b"LANDMARK_C", b"LANDMARK")
_STEP_NUMBERS, _LANDMARK_NUMBERS = 9, 6


def is_circles(data: bytes) -> bool:
    """Whether the content of a file is of this kind: its first line that is no comment is a ``STEP``."""
    for line in data.splitlines()[:200]:
        if line.strip() and not line.startswith(b"#"):
            return line.split(None, 1)[0] == _STEP and len(line.split()) == _STEP_NUMBERS + 2
    return False


def read_circles(path: str | PathLike[str]) -> FeatureLog:
    """Read steps and landmarks; pose 0 is where the first step begins, pose ``k`` where the ``k``-th ends.

    Landmarks with several identities get the first. Lines of other kinds are left out and counted.

    Raises:
        InputError: the file cannot be read, a line is broken, a covariance is not positive definite, a landmark comes
            before the first step, or there is no step or no landmark.
    """
    path = Path(path)
    content = read_content(path)
    check_text(path, content.data)
    report = ReadReport()
    steps, seen, poses, identities, lines = [], [], [], [], []
    for number, line in enumerate(content.data.decode("latin-1").splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if words[0].encode("latin-1") == _STEP:
            steps.append(_numbers(path, number, words[2:], _STEP_NUMBERS))
        elif words[0].encode("latin-1") in _LANDMARK:
            if not steps:
                raise InputError(f"{path}, line {number}: a landmark before the first STEP; remove the line")
            seen.append(_numbers(path, number, words[1:7], _LANDMARK_NUMBERS))
            poses.append(len(steps))
            identities.append(_identity(path, number, words[7:]))
            lines.append(number)
        else:
            report.skipped[f"line of the unknown kind {printable(words[0][:40])}"] += 1
    if not steps or not seen:
        raise InputError(f"{path}: {len(steps)} steps and {len(seen)} landmarks; there is no map in that")
    if content.truncated:
        report.skipped["end of a packed file that is damaged"] += 1
    step, mark = np.array(steps), np.array(seen)
    motion = step[:, :3] @ _TO_CLEW.T
    covariance = _TO_CLEW @ _symmetric(step[:, 3:]) @ _TO_CLEW.T
    turn = np.tile(np.eye(3), (len(motion), 1, 1))
    turn[:, :2, :2] = so2.matrix(-motion[:, 2:])  # the file has them in the frame before the step
    flip = _TO_CLEW[:2, :2]
    spread = np.zeros((len(mark), 2, 2))
    spread[:, 0, 0], spread[:, 1, 1] = mark[:, 3], mark[:, 5]
    spread[:, 0, 1] = spread[:, 1, 0] = mark[:, 4]
    bad = np.flatnonzero(np.linalg.eigvalsh(spread)[:, 0] <= 0.0)
    if len(bad):
        raise InputError(f"{path}, line {lines[bad[0]]}: the covariance is not positive definite; correct the line")
    if np.any(np.linalg.eigvalsh(covariance)[:, 0] <= 0.0):
        first = int(np.argmax(np.linalg.eigvalsh(covariance)[:, 0] <= 0.0)) + 1
        raise InputError(f"{path}: the covariance of step {first} is not positive definite; correct the line")
    report.used["steps"] += len(step)
    report.used["features"] += len(mark)
    features = Features(np.array(poses), mark[:, :2] @ flip.T, np.linalg.inv(flip @ spread @ flip.T))
    information = np.linalg.inv(turn @ covariance @ np.swapaxes(turn, 1, 2))
    return FeatureLog(path, np.arange(len(step) + 1), motion, information, features, np.array(identities), report)


def _symmetric(values: Array) -> Array:
    """``(N, 3, 3)`` from columns xx, xy, yy, xt, yt, tt."""
    out = np.empty((len(values), 3, 3))
    for column, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        out[:, i, j] = out[:, j, i] = values[:, column]
    return out


def _numbers(path: Path, number: int, words: list[str], count: int) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(f"{path}, line {number}: {count} finite numbers expected; correct or remove the line")
    return values


def _identity(path: Path, number: int, words: list[str]) -> int:
    try:
        return int(words[0])
    except (IndexError, ValueError):
        raise InputError(f"{path}, line {number}: no identity at the end; write -1 where it is unknown") from None
