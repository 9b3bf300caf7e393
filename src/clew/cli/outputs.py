"""The files that a mapping job leaves behind."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from clew.io import atomic_write, write_graph, write_ros_map, write_tum
from clew.mapping import CellState, OccupancyGrid
from clew.slam import Slam
from clew.view import save_map_png, save_overview_png


def write_outputs(
    slam: Slam, out: Path, title: str, progress: Callable[[int, int], None] | None = None
) -> OccupancyGrid:
    """Trajectory, keyframes, graph, closures, map and pictures (with a title); returns the map.

    `progress` is called with the scans in the map and all of them.
    """
    grid = slam.map(progress=progress)  # first of all: a map that does not fit into memory leaves no file behind
    trajectory, keyframes, every = slam.trajectory, slam.keyframes, slam.every_keyframe
    write_tum(out / "trajectory.tum", trajectory.timestamps, trajectory.T_world_robot)
    write_tum(out / "keyframes.tum", keyframes.timestamps, keyframes.T_world_robot)
    write_graph(out / "graph.g2o", slam.graph)
    write_closures(slam, out / "closures.csv")
    probabilities = np.where(grid.states() == CellState.UNKNOWN, np.nan, grid.probabilities())
    write_ros_map(out / "map", probabilities, grid.resolution, grid.origin)
    save_map_png(out / "map.png", grid)
    pairs = np.array([(c.source, c.target) for c in slam.closures], dtype=np.int64).reshape(-1, 2)
    save_overview_png(
        out / "overview.png",
        grid=grid,
        odometry_xy=slam.odometry.T_world_robot[:, :2],
        trajectory_xy=trajectory.T_world_robot[:, :2],
        keyframes=every.T_world_robot,
        closures_accepted=pairs,
        title=title,
        subtitle=f"{len(trajectory):,} scans, {len(keyframes):,} keyframes, {len(pairs):,} closures",
    )
    return grid


def write_closures(slam: Slam, path: Path) -> None:
    """Each candidate closure with its evidence and its verdict, one a row."""
    stamps = slam.every_keyframe.timestamps
    closures = sorted([*slam.closures, *slam.rejected_closures], key=lambda c: (c.source, c.target))
    with atomic_write(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["source", "target", "source_time", "target_time", "verdict", "reason", "x", "y", "theta", "similarity",
             "likelihood", "overlap", "rms", "contradiction", "innovation_m", "innovation_rad", "seen_through", "rival",
             "distance", "certain", "partial", "supporters", "telling", "in_row", "within"]
        )  # fmt: skip
        for c in closures:
            numbers = (*c.T_target_source, c.similarity, c.likelihood, c.overlap, c.rms, c.contradiction, *c.innovation,
                       c.seen_through, c.rival, c.distance)
            writer.writerow(
                [c.source, c.target, f"{stamps[c.source]:.6f}", f"{stamps[c.target]:.6f}", c.verdict.name.lower(),
                 c.verdict.value, *(f"{value:.5f}" for value in numbers), int(c.is_certain), int(c.is_partial),
                 c.supporters, c.telling, c.in_row, f"{c.within:.5f}"]
            )  # fmt: skip


def write_summary(summary: Mapping[str, object], path: Path) -> None:
    """`summary.json`."""
    with atomic_write(path) as file:
        json.dump(summary, file, indent=2)
        file.write("\n")
