"""Landmark SLAM on real data (UTIAS MRCLAM 6, Victoria Park, DLR) and in simulated worlds. Prints Markdown.

Run: ``python benchmarks/landmarks.py [--data FOLDER] [--only PART]``; the data are those of ``shared/data/landmarks``.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from clew.evaluate import absolute_trajectory_error, align
from clew.factors import PointObservation
from clew.geometry import SE2, Point2, se2
from clew.graph import FactorGraph, Role
from clew.io import (
    UNNAMED,
    FeatureLog,
    Features,
    SightingLog,
    mrclam_robots,
    read_feature_log,
    read_graph,
    read_mrclam,
    read_survey,
)
from clew.io.log import ReadReport
from clew.noise import DCS
from clew.sim import FleetModel, SightingModel, landmark_field, simulate_fleet
from clew.slam.landmarks import LandmarkMap, map_features, map_landmarks
from clew.solve import Solution, optimize
from mrclam_nees import errors_of

Array = NDArray[np.float64]
DATA = Path(__file__).parents[2] / "shared" / "data" / "landmarks"


def rows_of(found: LandmarkMap, logs: list[SightingLog], label: str, seconds: float, folder: Path) -> list[str]:
    survey = read_survey(folder)
    assert survey is not None
    true = survey.position[np.searchsorted(survey.identity, found.identity)]
    off = np.linalg.norm(se2.act(align(true, found.position), found.position) - true, axis=1)
    lines = []
    for robot, log in zip(found.robots, logs, strict=True):
        assert log.truth is not None
        e = absolute_trajectory_error(log.truth[:, 0], log.truth[:, 1:], robot.timestamps, robot.T_world_robot)
        compared = errors_of(found, robot, log)
        squares = [
            f"{c.mean:.2f} | {c.low:.2f} to {c.high:.2f} of {c.effective:.0f}: {c.verdict}"
            for c in (compared.position, compared.heading)
        ]
        x, y, theta = compared.mounting
        scale = f"{100 * compared.scale:+.1f} ({100 * compared.scale_deviation:.1f})"
        lines.append(
            f"| {label} | {robot.robot} | {e.translation.rmse:.3f} | {np.degrees(e.rotation.rmse):.2f} | "
            f"{' | '.join(squares)} | {scale} | {100 * x:.1f}, {100 * y:.1f}, {np.degrees(theta):.2f} | "
            f"{1e3 * compared.later:.0f} | "
            f"{np.degrees(compared.truth_heading):.2f} | {np.sqrt(np.mean(off**2)):.3f} | {off.max():.3f} | "
            f"{seconds:.0f} |"
        )
    return lines


def mrclam(folder: Path) -> None:
    columns = ("run", "robot", "ATE m", "heading deg", "NEES position (2)", "95 % band of independent",
               "NEES heading (1)", "95 % band of independent", "scale % (deviation)", "body frame cm, cm, deg",
               "later ms", "heading noise deg", "landmarks rmse m", "max m", "CPU s")  # fmt: skip
    print(f"| {' | '.join(columns)} |\n{'| --- ' * len(columns)}|")
    logs = [read_mrclam(folder, n) for n in mrclam_robots(folder)]
    for label, chosen in [*(("alone", [log]) for log in logs), ("merged", logs)]:
        begun = time.process_time()
        found = map_landmarks(chosen)
        print("\n".join(rows_of(found, chosen, label, time.process_time() - begun, folder)), flush=True)


def given_association(full: FactorGraph, features: Features) -> NDArray[np.int64]:
    """Landmark of each feature as the file with association has it."""
    block = next(b for b in full.blocks() if b.kinds == (SE2, Point2))
    return block.keys[in_order_of(full, features), 1]


def in_order_of(full: FactorGraph, features: Features) -> NDArray[np.int64]:
    """Row of the graph's sightings for each feature."""
    block = next(b for b in full.blocks() if b.kinds == (SE2, Point2))
    theirs = np.lexsort((*block.measurement.T, block.keys[:, 0]))
    ours = np.lexsort((*features.measurement.T, features.keys))
    out = np.empty(len(ours), np.int64)
    out[ours] = theirs
    return out


def share_right(found: NDArray[np.int64], given: NDArray[np.int64]) -> float:
    """Share of sightings whose landmark is the given one, each landmark standing for one given one at most."""
    f, rows = np.unique(found, return_inverse=True)
    t, columns = np.unique(given, return_inverse=True)
    table = np.zeros((len(f), len(t)), np.int64)
    np.add.at(table, (rows, columns), 1)
    table[f < 0] = 0
    return float(table[linear_sum_assignment(-table)].sum() / len(found))


def coinciding(full: FactorGraph, solution: Solution, given: NDArray[np.int64]) -> NDArray[np.int64]:
    """The given association with trees taken for one that its own solution puts nearer than a sighting is exact.

    Victoria Park's has three trees twice, 0.07 to 0.23 m from themselves.
    """
    keys, points = solution.keys(Point2), solution.values(Point2).array
    block = next(b for b in full.blocks() if b.kinds == (SE2, Point2))
    blur = float(np.sqrt(1.0 / np.median(block.information[:, 0, 0]))) * np.sqrt(unit_variance(full, solution))
    out = given.copy()
    for a, b in cKDTree(points).query_pairs(2.0 * blur):
        seldom = min((a, b), key=lambda i: np.sum(given == keys[i]))
        out[out == keys[seldom]] = keys[a + b - seldom]
    return out


def unit_variance(full: FactorGraph, solution: Solution) -> float:
    """Cost a degree of freedom of a graph of a chain of poses and landmarks."""
    sightings = sum(len(b.keys) for b in full.blocks() if b.kinds == (SE2, Point2))
    return solution.chi2 / (2 * (sightings - len(full.keys(Point2))))


def solve_given(
    full: FactorGraph, poses: dict[int, Array], kept: NDArray[np.bool_] | None = None, kernel: DCS | None = None
) -> Solution:
    """The graph with given association, solved from the given poses on; with some of its sightings, or robustly."""
    graph = full.copy()
    keys = graph.keys(SE2)
    graph.set_values(keys, np.array([poses[int(key)] for key in keys]))
    block = next(b for b in graph.blocks() if b.kinds == (SE2, Point2))
    seen = se2.act(graph.values(block.keys[:, 0]).array, block.measurement)
    for key in np.unique(block.keys[:, 1]):
        graph.set_value(int(key), np.median(seen[block.keys[:, 1] == key], axis=0))
    if kept is not None:
        graph.remove(np.concatenate(list(graph.block_ids(Role.OBSERVATION)))[~kept])
        alone = np.setdiff1d(graph.keys(Point2), block.keys[kept, 1])
        if len(alone):
            graph.remove_variable(alone)
    if kernel is not None:
        graph.remove(np.concatenate(list(graph.block_ids(Role.OBSERVATION))))
        graph.add(PointObservation(block.keys[:, 0], block.keys[:, 1], block.measurement, information=block.information,
                                   kernel=kernel))  # fmt: skip
    return optimize(graph, init="file", max_iterations=300)


def off_landmark(full: FactorGraph, solution: Solution) -> tuple[Array, Array]:
    """Distance ``(K,)`` of each sighting of the graph from where the solution has its landmark; metres, and chi2."""
    block = next(b for b in full.blocks() if b.kinds == (SE2, Point2))
    poses, points = trajectory(solution), solution.values(Point2).array[np.argsort(solution.keys(Point2))]
    pose = np.searchsorted(np.sort(solution.keys(SE2)), block.keys[:, 0])
    point = np.searchsorted(np.sort(solution.keys(Point2)), block.keys[:, 1])
    off = se2.act(poses[pose], block.measurement) - points[point]
    local = se2.act(se2.inverse(poses[pose]), points[point]) - block.measurement
    return np.hypot(*off.T), np.einsum("ni,nij,nj->n", local, block.information, local)


def odometry_cost(full: FactorGraph, poses: Array) -> float:
    """chi2 of the odometry of a graph at poses in the order of their keys: what no association has a part in."""
    keys = np.sort(full.keys(SE2))
    block = next(b for b in full.blocks() if b.kinds == (SE2, SE2))
    row = np.searchsorted(keys, block.keys)
    error = se2.between(block.measurement, se2.between(poses[row[:, 0]], poses[row[:, 1]]))
    return float(np.einsum("ni,nij,nj->", error, block.information, error))


def trajectory(solution: Solution) -> Array:
    """Poses ``(N, 3)`` in the order of their keys."""
    return solution.values(SE2).array[np.argsort(solution.keys(SE2))]


def distance(own: Array, theirs: Array) -> float:
    """RMSE of positions after alignment."""
    shift = align(theirs[:, :2], own[:, :2])
    return float(np.sqrt(np.mean(np.sum((se2.act(shift, own[:, :2]) - theirs[:, :2]) ** 2, axis=1))))


GROSS = 1.0  # metres from its landmark from which on a given association is no association


def association(folder: Path) -> None:
    print("\n| data | right | double given trees as one | and without those that DCS rejects | landmarks | given | "
          "RMSE to given m | to given with DCS | to given without "
          f"> {GROSS:g} m | rejected by DCS | > {GROSS:g} m off | chi2 of given | odometry's part: given | DCS | own | "
          "CPU ms a sighting |\n" + "| --- " * 16 + "|")  # fmt: skip
    for name in ("world-2000", "victoriaPark"):
        log = read_feature_log(folder / f"{name}-noassoc.g2o.gz")
        full = read_graph(folder / f"{name}-full.g2o.gz").graph
        seen = log.features
        begun = time.process_time()
        mapped = map_features(log)
        spent = time.process_time() - begun
        found, solution = mapped.landmark, mapped.solution
        own = trajectory(solution)
        from_own = dict(zip(np.sort(solution.keys(SE2)).tolist(), own, strict=True))
        theirs = solve_given(full, from_own)
        # the robust one begins at the strict one, not at ours
        robust = solve_given(full, dict(zip(sorted(from_own), trajectory(theirs), strict=True)), kernel=DCS())
        kept = off_landmark(full, theirs)[0] <= GROSS
        cleaned = solve_given(full, from_own, kept)
        given = given_association(full, seen)
        once = coinciding(full, theirs, given)
        accepted = DCS().weight(off_landmark(full, robust)[1]) > 0.5
        sure = accepted[in_order_of(full, seen)]
        print(
            f"| {name} | {100 * share_right(found, given):.2f} % | {100 * share_right(found, once):.2f} % | "
            f"{100 * share_right(found[sure], once[sure]):.2f} % | "
            f"{len(mapped.identity)} | {len(np.unique(given))} | {distance(own, trajectory(theirs)):.3f} | "
            f"{distance(own, trajectory(robust)):.3f} | {distance(own, trajectory(cleaned)):.3f} | "
            f"{np.sum(~accepted)} | {np.sum(~kept)} | "
            f"{theirs.chi2:.3f} | {odometry_cost(full, trajectory(theirs)):.1f} | "
            f"{odometry_cost(full, trajectory(robust)):.1f} | {odometry_cost(full, own):.1f} | "
            f"{1e3 * spent / len(given):.2f} |",
            flush=True,
        )


def circles(folder: Path) -> None:
    """The DLR circles without their identities, judged by those that have one."""
    log = read_feature_log(folder / "dlr.circles")
    assert log.identity is not None
    named = log.identity != UNNAMED
    begun = time.process_time()
    found = map_features(log, identities=False)
    spent = time.process_time() - begun
    own = found.landmark[named]
    print("\n| data | right of those with identity | landmarks | of those with identity | given | CPU ms a sighting |")
    print("| --- | --- | --- | --- | --- | --- |")
    print(
        f"| dlr.circles | {100 * share_right(own, log.identity[named]):.2f} % | {len(found.identity)} | "
        f"{len(np.unique(own[own >= 0]))} | {len(np.unique(log.identity[named]))} | {1e3 * spent / len(named):.2f} |",
        flush=True,
    )


#: Worlds: landmarks on 40 x 30 m, their least distance (m), and what the sensor makes of them.
WORLDS = {
    "sparse": (20, 1.0, SightingModel()),
    "medium": (60, 1.0, SightingModel()),
    "dense": (150, 1.0, SightingModel()),
    "clutter": (60, 1.0, SightingModel(false=0.5)),
    "many missed": (60, 1.0, SightingModel(missed=0.5)),
    "crowd": (150, 0.5, SightingModel(sigma_range=0.1, sigma_bearing=np.radians(2.0))),
    "crowd of 300": (300, 0.5, SightingModel()),
}


def simulated(seeds: int) -> None:
    """Association in worlds whose truth is known; a false sighting should share a landmark with none that is true."""
    print("\n| world | seeds | right mean | right worst | left unclear | false taken for a landmark | "
          "landmarks found / seen | not searched through | CPU ms a sighting |\n" + "| --- " * 9 + "|")  # fmt: skip
    for name, (count, spacing, model) in WORLDS.items():
        right, mistaken, number, unclear, sightings, spent = [], [], [], [], 0, 0.0
        moments = exhausted = 0
        for seed in range(seeds):
            world = landmark_field(count, (40.0, 30.0), seed=seed, spacing=spacing, identified=0.0)
            (run,) = simulate_fleet(world, 1, seed=seed, model=FleetModel(sightings=model, duration=400.0))
            seen = run.sightings
            c, s = np.cos(seen.bearings), np.sin(seen.bearings)
            jacobian = np.array([[c, -seen.ranges * s], [s, seen.ranges * c]]).transpose(2, 0, 1)
            information = np.linalg.inv(jacobian @ model.covariance @ np.swapaxes(jacobian, 1, 2))
            points = np.stack([seen.ranges * c, seen.ranges * s], axis=1)
            log = FeatureLog(Path(name), np.arange(len(run.T_world_robot)), run.increments,
                             np.linalg.inv(run.covariances), Features(seen.poses, points, information), None,
                             ReadReport())  # fmt: skip
            begun = time.process_time()
            mapped = map_features(log)
            spent += time.process_time() - begun
            found = mapped.landmark
            exhausted, moments = exhausted + mapped.exhausted, moments + len(np.unique(seen.poses))
            true = seen.landmarks >= 0
            right.append(share_right(found[true], seen.landmarks[true]))
            unclear.append(np.mean(found[true] < 0))
            mistaken.append(np.mean(np.isin(found[~true], found[true & (found >= 0)])) if (~true).any() else 0.0)
            number.append(len(np.unique(found[true & (found >= 0)])) / len(np.unique(seen.landmarks[true])))
            sightings += len(seen)
        print(f"| {name} | {seeds} | {100 * np.mean(right):.2f} % | {100 * np.min(right):.2f} % | "
              f"{100 * np.mean(unclear):.2f} % | {100 * np.mean(mistaken):.1f} % | {np.mean(number):.3f} | "
              f"{exhausted} of {moments} | {1e3 * spent / sightings:.2f} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--only", choices=("mrclam", "association", "circles", "simulated"))
    parser.add_argument("--seeds", type=int, default=5, help="of each simulated world")
    options = parser.parse_args()
    if options.only in (None, "mrclam"):
        mrclam(options.data / "MRCLAM_Dataset6")
    if options.only in (None, "association"):
        association(options.data)
    if options.only in (None, "circles"):
        circles(options.data)
    if options.only in (None, "simulated"):
        simulated(options.seeds)


if __name__ == "__main__":
    main()
