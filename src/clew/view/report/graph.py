"""A solved graph as scene, sentences and section."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate import FactorResiduals, factor_residuals, path_cuts
from clew.geometry import SE2, SE3, so2, so3
from clew.graph import FactorGraph
from clew.noise import Kernel
from clew.solve import Solution
from clew.view.report.content import Edges, Landmarks, Note, Scene, Section
from clew.view.report.graph_notes import misfits, noise_note, open_directions, sure_sentence, threads
from clew.view.report.graph_tables import graph_facts, largest_residuals, uncertainty_chart, weakest_links
from clew.view.report.words import key_name

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class GraphView:
    """A solved graph as scene, sentences and section.

    Attributes:
        scene: poses, edges and landmarks; paths, closures, scans and grid are for the caller to add.
        notes: what to check about the graph.
        section: health of the graph.
        sure: a sentence about the uncertainty, or None where there is none.
    """

    scene: Scene
    notes: tuple[Note, ...]
    section: Section
    sure: str | None


def view_graph(
    solution: Solution, *, times: Array | None = None, robot: Index | None = None, robots: tuple[str, ...] = ("",),
    robust: Kernel | None = None, landmark_names: dict[int, str] | None = None, covariances: Array | None = None,
    unit_variance: float = 1.0,
) -> GraphView:  # fmt: skip
    """Scene and health of a solved graph.

    Args:
        solution: its graph has poses of one kind, in the plane or in space.
        times: ``(N,)`` seconds of the poses in the order of their keys; None where there are none.
        robot: ``(N,)`` rows in `robots` of the poses in the order of their keys; None for one robot.
        robots: names.
        robust: kernel that the solve was given.
        landmark_names: by key; the key itself unless given.
        covariances: ``(N, 3, 3)`` tangent covariances of the poses to show in place of the solution's.
        unit_variance: variance of the measurements as a multiple of what the graph states, where it has been found;
            the solution's covariances are multiplied by it.
    """
    graph = solution.graph
    kinds = [kind for kind in solution.kinds if kind in (SE2, SE3)]
    points = [kind for kind in solution.kinds if kind not in (SE2, SE3)]
    if len(kinds) != 1:
        raise InputError("a report shows graphs with poses of one kind, in the plane or in space")
    kind = kinds[0]
    order = np.argsort(solution.keys(kind))
    keys = solution.keys(kind)[order]
    poses = solution.values(kind).array[order]
    spread = _covariances(solution, kind, order, poses, covariances)
    landmarks, landmark_keys = _landmarks(solution, points[0] if points else None, graph, landmark_names or {}, kind)
    if spread is not None and covariances is None:
        spread = unit_variance * spread
    if landmarks.covariances is not None:
        landmarks = replace(landmarks, covariances=unit_variance * landmarks.covariances)
    residuals = factor_residuals(graph, robust)
    edges, edge_rows = _edges(residuals, keys, landmark_keys)
    robot = np.zeros(len(keys), np.int64) if robot is None else robot
    places = np.concatenate([np.arange(n) for n in np.bincount(robot, minlength=len(robots))] or [np.zeros(0)])
    steps = np.empty(len(keys))
    steps[np.argsort(robot, kind="stable")] = places
    scene = Scene(
        poses[:, : kind.space], poses[:, 2] if kind is SE2 else np.full(len(poses), np.nan),
        [key_name(key) for key in keys.tolist()],
        steps if times is None else times, robot, robots, times is not None, spread, edges, landmarks,
    )  # fmt: skip
    place_of_row = np.full(len(residuals), -1, np.int64)
    place_of_row[edge_rows] = np.arange(len(edge_rows))
    notes = [
        *open_directions(solution), *misfits(residuals, place_of_row, scene), *threads(scene),
        *noise_note(residuals, scene, unit_variance),
    ]
    cuts = [path_cuts(graph, keys[robot == r]) for r in range(len(robots))]
    section = Section(
        "Health of the graph", graph_facts(solution, residuals, scene), (),
        (largest_residuals(residuals, place_of_row, scene), weakest_links(cuts, scene)), uncertainty_chart(scene),
    )  # fmt: skip
    return GraphView(scene, tuple(notes), section, sure_sentence(scene))


def _covariances(
    solution: Solution, kind: type[SE2] | type[SE3], order: Index, poses: Array, given: Array | None
) -> Array | None:
    """Covariances of x, y and heading (x, y, z) in the axes of the world."""
    if given is None:
        try:
            given = solution.covariances(kind)[order]
        except InputError:
            return None
    turn = np.zeros((len(poses), 3, 3))
    if kind is SE2:
        turn[:, :2, :2], turn[:, 2, 2] = so2.matrix(poses[:, 2:]), 1.0
    else:
        turn[:] = so3.matrix(poses[:, 3:])
    return np.asarray(turn @ given[:, :3, :3] @ np.swapaxes(turn, 1, 2), dtype=np.float64)


def _landmarks(
    solution: Solution, kind: type | None, graph: FactorGraph, names: dict[int, str],
    pose_kind: type[SE2] | type[SE3],
) -> tuple[Landmarks, Index]:
    dim = pose_kind.space
    none = np.zeros(0, np.int64)
    if kind is None:
        return Landmarks(np.zeros((0, dim)), None, (), none), none
    keys = solution.keys(kind)
    seen = [block.keys[:, 1] for block in graph.blocks() if block.kinds[1:] == (kind,)]
    of_key, counts = np.unique(np.concatenate([keys, *seen]), return_counts=True)
    kept = np.flatnonzero(counts[np.searchsorted(of_key, keys)] > 1)
    try:
        spread = solution.covariances(kind)[kept]
    except InputError:
        spread = None
    keys = keys[kept]
    positions = np.asarray(solution.values(kind).array)[kept, :dim]
    return Landmarks(positions, spread, [names.get(int(k)) or key_name(int(k)) for k in keys],
                     counts[np.searchsorted(of_key, keys)] - 1), keys  # fmt: skip


def _edges(residuals: FactorResiduals, keys: Index, landmark_keys: Index) -> tuple[Edges, Index]:
    """Edges between variables of the scene, in the order of the residuals, and their rows there."""
    ends = np.stack([_places(residuals.keys[:, side], keys, landmark_keys) for side in (0, 1)], axis=1)
    rows = np.flatnonzero((ends >= 0).all(axis=1))
    share = residuals.squared[rows] / np.maximum(residuals.dim[rows], 1)
    return Edges(ends[rows], residuals.role[rows], share, residuals.weight[rows]), rows


def _places(wanted: Index, keys: Index, landmark_keys: Index) -> Index:
    everything = np.concatenate([keys, landmark_keys])
    order = np.argsort(everything)
    place = order[np.minimum(np.searchsorted(everything[order], wanted), len(order) - 1)]
    return np.where(everything[place] == wanted, place, -1)
