"""The files that a merge leaves behind."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from clew.fleet.files import write_landmarks
from clew.fleet.keys import SHIFT
from clew.fleet.merge import MergedFleet
from clew.geometry import Point2
from clew.io import atomic_write, write_graph


def write_merged(merged: MergedFleet, folder: Path) -> None:
    """Write ``graph.g2o``, ``robots.json`` (frames and letters) and, where there are landmarks, ``landmarks.csv``.

    Raises:
        InputError: a factor has no record in g2o, or a file cannot be written.
    """
    write_graph(folder / "graph.g2o", merged.graph)
    robots = [
        {"name": name, "letter": chr(int(merged.pose_keys(number)[0]) >> SHIFT), "T_first_robot": frame.tolist()}
        for number, (name, frame) in enumerate(zip(merged.names, merged.frames, strict=True))
    ]
    with atomic_write(folder / "robots.json") as file:
        json.dump(robots, file, indent=2)
        file.write("\n")
    if Point2 not in merged.solution.kinds:
        return
    keys = merged.solution.keys(Point2)
    seen = [block.keys[:, 1] for block in merged.graph.blocks() if block.kinds[1:] == (Point2,)]
    of_key, counts = np.unique(np.concatenate([keys, *seen]), return_counts=True)
    write_landmarks(folder / "landmarks.csv", [merged.identities.get(int(key), "") for key in keys],
                    merged.solution.values(Point2).array, merged.solution.covariances(Point2),
                    counts[np.searchsorted(of_key, keys)] - 1)
