"""The part of a report that every graph has: how sure it is, what fits badly, what hangs by a thread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate import ROLES, FactorResiduals, PathCuts, bridges, factor_residuals, path_cuts, stretches
from clew.geometry import SE2, SE3, so2, so3
from clew.graph import FactorGraph, Role
from clew.noise import Kernel
from clew.solve import Solution
from clew.view.report.content import Chart, Edges, Focus, Landmarks, Note, Scene, Section, Table
from clew.view.report.words import counted, key_name, metres, number

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHI2_95 = {2: 5.991464547107979, 3: 7.814727903251179}  # squared distance that holds 95 %, by coordinates
_ROWS = 10  # of a table
_UNLIKELY = 1e-6  # chance of so large a residual anywhere in the graph, below which it is worth a look
_DOUBTED = 0.5  # robust weight below which a measurement is hardly believed
_MANY = 0.02  # share of measurements of one kind that are doubted, above which it is worth a look
_LEAST_STRETCH = 8  # poses held by odometry alone that are worth a sentence
_STRETCHES = 3  # such sentences


@dataclass(frozen=True, eq=False)
class GraphView:
    """A solved graph as scene, sentences and section.

    Attributes:
        scene: poses, edges and landmarks; paths, closures, scans and grid are for the caller to add.
        notes: what to check about the graph.
        section: health of the graph.
        sure: a sentence about the uncertainty, or None where there is none.
        rows: ``(N,)`` row of each pose in the order of keys.
    """

    scene: Scene
    notes: tuple[Note, ...]
    section: Section
    sure: str | None


def view_graph(
    solution: Solution, *, times: Array | None = None, robot: Index | None = None, robots: tuple[str, ...] = ("",),
    robust: Kernel | None = None, landmark_names: dict[int, str] | None = None, covariances: Array | None = None,
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
        *_open_directions(solution), *_misfits(residuals, place_of_row, scene), *_threads(scene),
        *_noise(residuals, scene),
    ]
    cuts = [path_cuts(graph, keys[robot == r]) for r in range(len(robots))]
    section = Section(
        "Health of the graph", _facts(solution, residuals, scene), (),
        (_worst(residuals, place_of_row, scene), _weakest(cuts, scene)), _charts(scene, residuals, edge_rows),
    )  # fmt: skip
    return GraphView(scene, tuple(notes), section, _sure(scene))


def moment(scene: Scene, row: int) -> str:
    """When or where along the path a pose is, in words."""
    if scene.timed:
        return f"t = {scene.times[row] - scene.times.min():.1f} s"
    return f"pose {scene.names[row]}"


# --- the scene ----------------------------------------------------------------------------------------------------


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
    solution: Solution, kind: type | None, graph: FactorGraph, names: dict[int, str], pose_kind: type
) -> tuple[Landmarks, Index]:
    dim = pose_kind.space  # type: ignore[attr-defined]
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


# --- sentences ----------------------------------------------------------------------------------------------------


def _sure(scene: Scene) -> str | None:
    if scene.covariances is None or len(scene.covariances) < 2:
        return None
    radius = _radius(scene)
    worst = int(np.argmax(radius))
    return (
        f"If the noise is as the graph states, the robot's position is known to ±{metres(float(np.median(radius)))} "
        f"(95 %, median) and at worst to ±{metres(float(radius[worst]))}, at {moment(scene, worst)}, seen from the "
        "pose that the map hangs on."
    )


def _radius(scene: Scene) -> Array:
    """Longest half axis of each 95 % ellipse or ellipsoid, metres."""
    assert scene.covariances is not None
    if scene.dim == 2:
        largest = CHI2_95[2] * np.linalg.eigvalsh(scene.covariances[:, :2, :2])[:, -1]
    else:
        largest = CHI2_95[3] * np.linalg.eigvalsh(scene.covariances)[:, -1]
    return np.asarray(np.sqrt(np.maximum(largest, 0.0)), dtype=np.float64)


def _open_directions(solution: Solution) -> list[Note]:
    held = [str(part) for part in solution.free_parts if part.held]
    usual = len(held) == 1  # a graph of relative measurements hangs on one pose, as it should
    level = "know" if usual else "check"
    return [Note(sentence, level if sentence in held else "check") for sentence in solution.diagnosis
            if not (usual and sentence in held)]


def _misfits(residuals: FactorResiduals, place: Index, scene: Scene) -> list[Note]:
    """Measurements that the robust kernel hardly believes, and believed ones that noise as stated cannot explain."""
    notes = []
    share = residuals.squared / np.maximum(residuals.dim, 1)
    doubted = residuals.weight < _DOUBTED
    unlikely = ~doubted & (residuals.chance < _UNLIKELY / max(len(residuals), 1))
    for role in (Role.LOOP, Role.OBSERVATION, Role.ODOMETRY):
        mine = np.flatnonzero(doubted & residuals.of_role(role))
        if len(mine):
            part = len(mine) / int(residuals.of_role(role).sum())
            verb, them, their = ("contradicts", "it", "its") if len(mine) == 1 else ("contradict", "them", "their")
            notes.append(Note(
                f"{counted(len(mine), _NOUNS[role])} ({100 * part:.1f} %) {verb} the others so much that the robust "
                f"kernel gives {them} less than half of {their} weight.", "check" if part > _MANY else "know",
                _edge(place, int(mine[np.argmin(residuals.weight[mine])]))))
        mine = np.flatnonzero(unlikely & residuals.of_role(role))
        if len(mine):
            worst = int(mine[np.argmax(share[mine])])
            notes.append(Note(
                f"{counted(len(mine), _NOUNS[role])} {'misses' if len(mine) == 1 else 'miss'} by more than their "
                f"stated noise can explain, the worst by {np.sqrt(share[worst]):.1f} standard deviations.", "check",
                _edge(place, worst)))
    return notes


_NOUNS = {Role.LOOP: "loop edge", Role.OBSERVATION: "sighting", Role.ODOMETRY: "odometry edge", Role.PRIOR: "prior",
          Role.MARGINAL: "summarised edge"}


def _edge(place: Index, row: int) -> Focus | None:
    return Focus("edge", int(place[row])) if place[row] >= 0 else None


def _threads(scene: Scene) -> list[Note]:
    """Stretches of path that only one chain of edges holds."""
    count = len(scene.names)
    alone = bridges(count + len(scene.landmarks.names), scene.edges.ends)
    steps = np.zeros(count, dtype=np.bool_)
    ends = np.sort(scene.edges.ends[alone], axis=1)
    chain = (ends[:, 1] - ends[:, 0] == 1) & (ends[:, 1] < count)
    steps[ends[chain, 0]] = True
    runs = [run for run in stretches(steps).tolist() if run[1] - run[0] + 1 >= _LEAST_STRETCH]
    if not runs:
        return []
    if len(runs) == 1 and runs[0][1] - runs[0][0] >= count - 2:
        return [Note("No measurement closes a loop: the whole path is odometry, and its error grows with the way.",
                     "check", Focus("span", 0, count - 1))]
    length = {tuple(run): float(np.linalg.norm(np.diff(scene.positions[run[0] : run[1] + 2], axis=0), axis=1).sum())
              for run in runs}
    runs.sort(key=lambda run: -length[tuple(run)])
    notes = []
    for first, last in runs[:_STRETCHES]:
        where = f"Between {moment(scene, first)} and {moment(scene, last + 1)}"
        end = " and its far end hangs free" if first == 0 or last >= count - 2 else ""
        notes.append(Note(f"{where} the path ({metres(length[first, last])}, {counted(last - first + 2, 'pose')}) is "
                          f"held by odometry alone{end}: nothing confirms it.", "check",
                          Focus("span", first, last + 1)))
    if len(runs) > _STRETCHES:
        notes.append(Note(f"{counted(len(runs) - _STRETCHES, 'shorter stretch', 'shorter stretches')} of path "
                          "likewise.", "know"))
    return notes


def _freedom(residuals: FactorResiduals, scene: Scene) -> int:
    """Redundant measurements: numbers measured, less those estimated."""
    each = 3 if scene.dim == 2 else 6
    return int(residuals.dim.sum()) - each * (len(scene.names) - 1) - scene.dim * len(scene.landmarks.names)


def _noise(residuals: FactorResiduals, scene: Scene) -> list[Note]:
    freedom = _freedom(residuals, scene)
    if freedom < 50:
        return []
    ratio = float((residuals.weight * residuals.squared).sum()) / freedom
    if 0.5 <= ratio <= 2.0:
        return []
    factor = np.sqrt(ratio)
    if ratio > 2.0:
        return [Note(f"The residuals are {factor:.1f} times as large as the stated noise: all ellipses are about that "
                     "much too small, or some measurements are wrong.", "check")]
    return [Note(f"The residuals are only {100 * factor:.0f} % of the stated noise: the measurements are better than "
                 "they say, and all ellipses rather too large.", "know")]


# --- the section --------------------------------------------------------------------------------------------------


def _facts(solution: Solution, residuals: FactorResiduals, scene: Scene) -> list[tuple[str, str]]:
    facts = [("Poses", f"{len(scene.names):,}")]
    if len(scene.landmarks.names):
        facts.append(("Landmarks", f"{len(scene.landmarks.names):,}"))
    for role in ROLES:
        count = int(residuals.of_role(role).sum())
        if count:
            facts.append((_NOUNS[role].capitalize() + "s", f"{count:,}"))
    freedom = _freedom(residuals, scene)
    facts.append(("Cost χ²", number(solution.chi2)))
    if freedom > 0:
        facts.append(("χ² for one redundant measurement",
                      number(float((residuals.weight * residuals.squared).sum()) / freedom)))
    held = [part for part in solution.free_parts if part.held]
    if held:
        facts.append(("Held in place", ", ".join(f"pose {key_name(part.anchor)}" for part in held[:3])))
    return facts


def _worst(residuals: FactorResiduals, place: Index, scene: Scene) -> Table:
    rows = [int(row) for row in residuals.largest(_ROWS) if residuals.squared[row] > 0]
    def name(row: int) -> str:
        return " to ".join(key_name(int(key)) for key in residuals.keys[row] if key >= 0)
    return Table(
        "Largest residuals", ("edge", "kind", "sigmas", "weight"),
        [(name(row), ROLES[residuals.role[row]].value,
          f"{np.sqrt(residuals.squared[row] / max(int(residuals.dim[row]), 1)):.2f}", f"{residuals.weight[row]:.2f}")
         for row in rows],
        [_edge(place, row) for row in rows], "Every measurement is met exactly.",
        "How far the estimate is from each measurement, in standard deviations of one coordinate as the graph states "
        "them, and what the robust kernel leaves of its weight (1 without a kernel).",
    )  # fmt: skip


def _weakest(cuts: list[PathCuts], scene: Scene) -> Table:
    """The steps of the paths over which the least reaches, one a stretch."""
    found: list[tuple[float, int, int]] = []
    for r, cut in enumerate(cuts):
        rows = np.flatnonzero(scene.robot == r)
        near = max(5, len(rows) // 50)  # of steps beside each other one is enough
        left = np.ones(len(cut.edges), dtype=np.bool_)
        for k in np.argsort(cut.information, kind="stable").tolist():
            if left[k]:
                found.append((float(cut.information[k]), int(cut.edges[k]), int(rows[k])))
                left[max(0, k - near) : k + near] = False
    found.sort()
    return Table(
        "Weakest links along the path", ("step", "ties over it", "together within"),
        [(f"{moment(scene, row)} (pose {scene.names[row]})" if scene.timed else moment(scene, row), f"{edges:,}",
          f"±{metres(1.96 / np.sqrt(information))}" if information > 0 else "not tied") for information, edges, row in
         found[:_ROWS]],
        [Focus("span", row, row + 1) for _, _, row in found[:_ROWS]], "A path of one pose has no links.",
        "Where the least ties what the robot drove before to what it drove after: edges, and landmarks seen on both "
        "sides. The last column adds up the information of all ties over the step as if they were measured there "
        "(95 %): it compares steps, and says nothing of the error of the map.",
    )  # fmt: skip


def _charts(scene: Scene, residuals: FactorResiduals, rows: Index) -> list[Chart]:
    if scene.covariances is None or len(scene.robots) > 1 or len(scene.names) < 3:
        return []
    order = np.argsort(scene.times, kind="stable")
    return [Chart("Uncertainty of the position", "m", scene.times[order], [("95 %, longest half axis",
                  _radius(scene)[order])],
                  "How far off each pose may be, as the graph states its noise. It grows where nothing is recognised, "
                  "and falls where a loop closes.")]  # fmt: skip


