"""What a robot recorded that moves in steps and sees features."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.io.graph_file import Features
from clew.io.log import ReadReport

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

UNNAMED = -1  # identity of a feature that the log does not name


@dataclass(frozen=True, eq=False)
class FeatureLog:
    """A drive in steps.

    Attributes:
        path: file that it came from.
        keys: ``(N,)`` keys of the poses, increasing.
        motion: ``(N - 1, 3)`` from each pose to the next, in the frame of the former.
        information: ``(N - 1, 3, 3)`` of the motions, in the tangent at their end.
        features: seen from the poses, in the order of the poses.
        identity: ``(K,)`` what each feature is, `UNNAMED` where the log does not say; None if it says so of none.
        report: what was read, and what was left out.
    """

    path: Path
    keys: Indices
    motion: Array
    information: Array
    features: Features
    identity: Indices | None
    report: ReadReport
