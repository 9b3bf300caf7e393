"""What ``clew optimize`` writes: graph or trajectory, covariances, a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import SE2, SE3, so2, so3
from clew.io import GraphFile, atomic_write, write_graph, write_kitti, write_tum
from clew.solve import Solution

Array = NDArray[np.float64]

FORMATS = {".g2o": "g2o", ".graph": "toro", ".tum": "tum", ".kitti": "kitti", ".txt": "kitti"}


def format_of(path: Path) -> str:
    """Format that the ending of a name asks for: "g2o", "toro", "tum" or "kitti".

    Raises:
        InputError: another ending.
    """
    packed = path.suffix in (".gz", ".bz2")
    ending = Path(path.stem).suffix if packed else path.suffix
    name = FORMATS.get(ending.lower())
    if name is None or (packed and name not in ("g2o", "toro")):
        raise InputError(
            f"-o {path}: no format has the ending {path.suffix!r}; choose .g2o, .graph (TORO), .tum, .kitti or .txt "
            "(KITTI); .gz or .bz2 after .g2o and .graph"
        )
    return name


def write_result(path: Path, file: GraphFile, solution: Solution) -> None:
    """The optimised graph, or its poses in the order of their keys.

    A graph has no times: in a TUM file the key of a pose stands for its timestamp.

    Raises:
        InputError: an unknown ending, a graph that the format cannot hold, or a file that cannot be written.
    """
    style = format_of(path)
    if style == "g2o":
        write_graph(path, solution.graph, features=file.features, unknown=file.report.unknown)
    elif style == "toro":
        write_graph(path, solution.graph, style=style)
    else:
        keys = solution.keys()
        order = np.argsort(keys)
        poses = solution.values().array[order]
        if style == "tum":
            write_tum(path, keys[order].astype(np.float64), poses)
        else:
            write_kitti(path, poses)


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
    """Picture of the solution: poses, landmarks, edges by role and, if wanted, ellipses of positions.

    Raises:
        InputError: the file cannot be written, or ellipses are wanted and some variables are free to move.
    """
    from clew.view import plot_graph

    graph = solution.graph
    where = {kind: solution.values(kind).array[:, : kind.space] for kind in solution.kinds}
    edges: dict[str, list[Array]] = {}
    for block in graph.blocks():
        if len(block.kinds) > 1:
            rows = graph.positions(block.keys)
            ends = [where[kind][rows[:, place]] for place, kind in enumerate(block.kinds[:2])]
            edges.setdefault(block.role.value, []).append(np.stack(ends, axis=1))
    poses = [kind for kind in solution.kinds if kind in (SE2, SE3)]
    points = [where[kind] for kind in solution.kinds if kind not in (SE2, SE3)]
    spread = {kind: _position_covariances(solution, kind) for kind in solution.kinds} if ellipses else {}
    of_points = [spread[kind] for kind in solution.kinds if kind in spread and kind not in (SE2, SE3)]
    plot_graph(
        path,
        where[poses[0]] if poses else np.empty((0, 2)),
        {role: np.concatenate(parts) for role, parts in edges.items()},
        points[0] if points else None,
        spread[poses[0]] if spread and poses else None,
        of_points[0] if of_points else None,
        f"chi2 {solution.chi2:.6g}",
    )


def _position_covariances(solution: Solution, kind: type[Any]) -> Array:
    """``(N, space, space)`` in the world frame."""
    own = solution.covariances(kind)[:, : kind.space, : kind.space]
    if kind not in (SE2, SE3):
        return own
    rotation = solution.values(kind).array[:, kind.space :]
    turn = so2.matrix(rotation) if kind is SE2 else so3.matrix(rotation)
    return np.asarray(turn @ own @ np.swapaxes(turn, 1, 2), dtype=np.float64)
