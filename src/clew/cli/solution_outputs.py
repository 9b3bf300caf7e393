"""What ``clew optimize`` writes: graph or trajectory, covariances, a picture, a report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.cli.formats import GRAPHS, TRAJECTORIES, Format, format_of
from clew.geometry import SE2, SE3
from clew.io import GraphFile, atomic_write, write_csv, write_graph, write_kitti, write_tum
from clew.noise import Kernel
from clew.solve import Solution

REPORT_ENDING = ".report.html"

Array = NDArray[np.float64]


def write_result(path: Path, file: GraphFile, solution: Solution) -> None:
    """The optimised graph, or its poses in the order of their keys.

    A graph has no times: in a TUM or CSV file the key of a pose stands for its timestamp.

    Raises:
        InputError: an unknown ending, a graph that the format cannot hold, or a file that cannot be written.
    """
    wanted = format_of(path, GRAPHS + TRAJECTORIES)
    if wanted is Format.G2O:
        write_graph(path, solution.graph, features=file.features, unknown=file.report.unknown)
    elif wanted is Format.TORO:
        write_graph(path, solution.graph, style="toro")
    else:
        keys = solution.keys()
        order = np.argsort(keys)
        poses = solution.values().array[order]
        if wanted is Format.KITTI:
            write_kitti(path, poses)
        else:
            (write_csv if wanted is Format.CSV else write_tum)(path, keys[order].astype(np.float64), poses)


def write_marginals(path: Path, solution: Solution) -> None:
    """Covariances as CSV: key, kind, then the matrix row by row, in the tangent of `retract`.

    Raises:
        InputError: the measurements leave variables free, or the file cannot be written.
    """
    with atomic_write(path) as file:
        file.write("# key,kind,covariance row by row (translation first; m, rad; in the pose's frame)\n")
        for kind in solution.kinds:
            rows = solution.covariances(kind).reshape(-1, kind.dim**2).tolist()
            for key, row in zip(solution.keys(kind).tolist(), rows, strict=True):
                file.write(f"{key},{kind.name},{','.join(map(repr, row))}\n")


def draw(path: Path, solution: Solution, *, ellipses: bool) -> None:
    """Picture of the solution: poses, landmarks, edges by role and, if wanted, ellipses.

    Raises:
        InputError: the file cannot be written, or ellipses are wanted and some variables are free to move.
    """
    from clew.view import graph_figure, save_figure, solution_scene

    scene = solution_scene(solution, covariances=ellipses)
    save_figure(graph_figure(scene, f"chi2 {solution.chi2:.6g}"), path)


def report_beside(output: Path) -> Path:
    """Where the report of a result goes unless it is told: ``best.report.html`` beside ``best.g2o.gz``."""
    return output.with_name(output.name.split(".")[0] + REPORT_ENDING)


def write_solution_report(
    path: Path, file: GraphFile, solution: Solution, *, robust: Kernel | None, notes: list[str]
) -> None:
    """The report of a solve; nothing for a graph without poses of one kind, which has no map.

    Raises:
        InputError: the file cannot be written.
    """
    from clew.view import report_of_solution, write_report

    if sum(kind in (SE2, SE3) for kind in solution.kinds) == 1:
        write_report(path, report_of_solution(solution, file.path.name, robust=robust, notes=tuple(notes)))
