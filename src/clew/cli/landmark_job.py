"""The job of `clew run` on a folder of robots that recognise landmarks."""

from __future__ import annotations

import json as json_
import sys
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console

from clew._version import __version__
from clew.cli.description import count
from clew.cli.outputs import write_summary
from clew.cli.progress import stages
from clew.cli.terminal import messages
from clew.errors import InputError
from clew.evaluate import absolute_trajectory_error, align
from clew.fleet import write_landmarks
from clew.geometry import se2
from clew.io import (
    SightingLog,
    SurveyedLandmarks,
    ensure_output_folder,
    mrclam_robots,
    read_mrclam,
    read_survey,
    write_graph,
    write_tum,
)
from clew.slam.landmarks import LandmarkMap, map_landmarks
from clew.solve import Solution, optimize
from clew.view import report_of_landmarks, save_landmarks_png, write_report


def run_landmarks(folder: Path, out: Path, robot: int | None, json: bool, quiet: bool) -> None:
    """Map what one robot of a folder saw, or all of them together, and write everything into the output folder.

    Writes ``trajectory.tum`` (one a robot, ``trajectory_robotN.tum``, for several), ``graph.g2o``, ``landmarks.csv``,
    ``landmarks.png``, ``report.html`` and ``summary.json``.

    Args:
        folder: a folder of the UTIAS MRCLAM data (`clew.io.is_mrclam`).
        out: output folder; made if it is not there.
        robot: number of the robot, or None for all.
        json: print the summary as JSON.
        quiet: print nothing but errors.

    Raises:
        InputError: files that are missing or broken, a robot that is not there or saw too little, or robots that have
            no landmarks in common.
    """
    numbers = (robot,) if robot is not None else mrclam_robots(folder)
    if not numbers:
        raise InputError(f"{folder}: holds no RobotN_Odometry.dat; give a folder of the UTIAS MRCLAM data")
    console = messages(quiet)
    begun = time.perf_counter()
    with console.status(f"reading {folder.name}"):
        logs = [read_mrclam(folder, number) for number in numbers]
        survey = read_survey(folder)
    ensure_output_folder(out)
    with stages(console) as shown:
        notes = {"mapping": "sightings of landmarks", "calibrating": "rounds at most", "joining": "rounds at most"}
        found = map_landmarks(logs, progress=shown.stages(notes))
    solution = optimize(found.graph, init="file", max_iterations=0)
    summary = {"log": folder.name, **_summary(found, solution, logs, survey), "version": __version__}
    summary["wall_seconds"] = round(time.perf_counter() - begun, 3)
    _write(found, folder.name, out)
    skipped = summary["skipped"]
    assert isinstance(skipped, dict)
    write_report(out / "report.html", report_of_landmarks(found, solution, folder.name, skipped))
    write_summary(summary, out / "summary.json")
    if json:
        sys.stdout.write(json_.dumps(summary) + "\n")
    _report(summary, found, out, console)


def _write(found: LandmarkMap, name: str, out: Path) -> None:
    alone = len(found.robots) == 1
    for robot in found.robots:
        file = "trajectory.tum" if alone else f"trajectory_robot{robot.robot}.tum"
        write_tum(out / file, robot.timestamps, robot.T_world_robot)
    write_graph(out / "graph.g2o", found.graph)
    names = [str(number) for number in found.identity]
    write_landmarks(out / "landmarks.csv", names, found.position, found.covariance, found.sightings)
    save_landmarks_png(
        out / "landmarks.png",
        [(f"robot {robot.robot}", robot.T_world_robot[:, :2]) for robot in found.robots],
        found.position, found.covariance, names, name,
        f"{sum(len(r.timestamps) for r in found.robots):,} poses, {int(found.sightings.sum()):,} sightings of "
        f"{count(len(found.identity), 'landmark')}",
    )  # fmt: skip


def _summary(
    found: LandmarkMap, solution: Solution, logs: list[SightingLog], survey: SurveyedLandmarks | None
) -> dict[str, object]:
    """Numbers of a run; the cost is that of the graph that is written, `solution`, without what is put beside it."""
    skipped: Counter[str] = Counter()
    for log in logs:
        skipped += log.report.skipped
    robots = []
    for robot, log in zip(found.robots, logs, strict=True):
        entry: dict[str, object] = {
            "robot": robot.robot,
            "poses": len(robot.timestamps),
            "landmark_sightings": len(log.landmarks),
            "robot_sightings": len(log.robots),
            "model": robot.model.to_dict(),
        }
        if log.truth is not None:
            try:
                error = absolute_trajectory_error(
                    log.truth[:, 0], log.truth[:, 1:], robot.timestamps, robot.T_world_robot
                )
                entry["ate_m"] = round(error.translation.rmse, 4)
            except InputError as reason:  # the map does not need the truth
                entry["truth_not_used"] = str(reason)
        robots.append(entry)
    summary: dict[str, object] = {
        "robots": robots,
        "landmarks": len(found.identity),
        "sightings": int(found.sightings.sum()),
        "marks": asdict(found.marks),
        "chi2": solution.chi2,
        "status": found.solution.status.name,
        "skipped": dict(sorted(skipped.items())),
    }
    common = [] if survey is None else [i for i in found.identity.tolist() if i in survey.identity]
    if survey is not None and len(common) >= 2:
        own = found.position[np.isin(found.identity, common)]
        true = survey.position[[survey.identity.tolist().index(i) for i in common]]
        errors = np.linalg.norm(se2.act(align(true, own), own) - true, axis=1)
        summary["landmark_error_m"] = {
            "rmse": round(float(np.sqrt(np.mean(errors**2))), 4), "max": round(float(errors.max()), 4),
        }  # fmt: skip
    return summary


def _report(summary: dict[str, object], found: LandmarkMap, out: Path, console: Console) -> None:
    robots = summary["robots"]
    assert isinstance(robots, list)
    for robot in robots:
        error = f", error against the truth {robot['ate_m']} m (ATE, RMSE)" if "ate_m" in robot else ""
        if "truth_not_used" in robot:
            error = f"; the truth is not used: {robot['truth_not_used']}"
        console.print(
            f"robot {robot['robot']}: {count(robot['poses'], 'pose')}, "
            f"{count(robot['landmark_sightings'], 'sighting')} of landmarks, {robot['robot_sightings']:,} of robots"
            f"{error}",
            highlight=False,
        )
    console.print(f"{count(len(found.identity), 'landmark')}, {summary['wall_seconds']} s", highlight=False)
    skipped = summary["skipped"]
    assert isinstance(skipped, dict)
    if skipped:
        console.print("left out: " + ", ".join(f"{n} {reason}" for reason, n in skipped.items()), highlight=False)
    console.print(f"look at {out / 'report.html'} (clew view {out}); the rest is beside it", highlight=False)
