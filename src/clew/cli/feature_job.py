"""The job of `clew run` on a drive with features, whose identities are given or have to be found."""

from __future__ import annotations

import json as json_
import sys
import time
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
from clew.fleet import write_landmarks
from clew.io import FeatureLog, ensure_output_folder, read_feature_log, write_graph, write_tum
from clew.slam.landmarks import FeatureMap, map_features
from clew.view import report_of_features, save_landmarks_png, write_report


def run_features(path: Path, out: Path, identities: bool, json: bool, quiet: bool) -> None:
    """Map a drive with features and write everything into the output folder.

    Writes ``trajectory.tum`` (the key of a pose as its timestamp), ``graph.g2o``, ``landmarks.csv``, ``landmarks.png``,
    ``report.html`` and ``summary.json``.

    Args:
        path: a file of features (`clew.io.is_feature_log`).
        out: output folder; made if it is not there.
        identities: use the identities of the log where it has any.
        json: print the summary as JSON.
        quiet: print nothing but errors.

    Raises:
        InputError: a file that is broken, or without features.
    """
    console = messages(quiet)
    begun = time.perf_counter()
    with console.status(f"reading {path.name}"):
        log = read_feature_log(path)
    given = identities and log.identity is not None
    if not given and len(log.keys) < 2:
        raise InputError(f"{path}: {len(log.keys)} pose; there is no drive in that")
    ensure_output_folder(out)
    with stages(console) as shown:
        shown.begin("mapping", total=None if given else len(log.features.keys), note="features")
        found = map_features(log, identities=identities, progress=shown.show)
    summary = {"log": path.name, **_summary(found, log, given), "version": __version__}
    _write(found, path.name, given, out)
    write_report(out / "report.html", report_of_features(found, path.name, dict(sorted(log.report.skipped.items()))))
    summary["wall_seconds"] = round(time.perf_counter() - begun, 3)
    write_summary(summary, out / "summary.json")
    if json:
        sys.stdout.write(json_.dumps(summary) + "\n")
    _report(summary, found, out, console)


def _write(found: FeatureMap, name: str, given: bool, out: Path) -> None:
    write_tum(out / "trajectory.tum", found.keys.astype(np.float64), found.T_world_robot)
    write_graph(out / "graph.g2o", found.graph)
    # a number that was counted here means nothing to another robot: such landmarks have no identity in the file
    names = [str(number) if given else "" for number in found.identity.tolist()]
    write_landmarks(out / "landmarks.csv", names, found.position, found.covariance, found.sightings)
    save_landmarks_png(
        out / "landmarks.png",
        [("path", found.T_world_robot[:, :2]), ("odometry alone", found.T_odom_robot[:, :2])],
        found.position, found.covariance, None, name,
        f"{len(found.keys):,} poses, {int(found.sightings.sum()):,} sightings of "
        f"{count(len(found.identity), 'landmark')}, "
        + ("identities given" if given else "identities found"),
    )  # fmt: skip


def _summary(found: FeatureMap, log: FeatureLog, given: bool) -> dict[str, object]:
    return {
        "poses": len(found.keys),
        "landmarks": len(found.identity),
        "sightings": int(found.sightings.sum()),
        "without_landmark": int(np.sum(found.landmark < 0)),
        "identities": "given" if given else "found",
        "moments_not_searched_through": found.exhausted,
        "chi2": found.solution.chi2,
        "status": found.solution.status.name,
        "unit_variance": found.unit_variance,
        "variance_components": None if found.components is None else asdict(found.components),
        "skipped": dict(sorted(log.report.skipped.items())),
    }


def _report(summary: dict[str, object], found: FeatureMap, out: Path, console: Console) -> None:
    console.print(
        f"{count(len(found.keys), 'pose')}, {count(int(found.sightings.sum()), 'sighting')} of "
        f"{count(len(found.identity), 'landmark')} (identities {summary['identities']}), "
        f"{summary['without_landmark']} sightings of none; "
        f"{summary['wall_seconds']} s",
    )
    parts = summary["variance_components"]
    if isinstance(parts, dict):
        noise = ", ".join(f"{name} {np.sqrt(value):.2g}" for name, value in parts.items())
        console.print(f"noise found, as a multiple of what the file says: {noise}")
    if summary["moments_not_searched_through"]:
        console.print(
            f"at {summary['moments_not_searched_through']} poses landmarks stand so close for their noise that not all "
            "ways to tell them apart were tried",
        )
    skipped = summary["skipped"]
    assert isinstance(skipped, dict)
    if skipped:
        console.print("left out: " + ", ".join(f"{n} {reason}" for reason, n in skipped.items()))
    console.print(f"look at {out / 'report.html'}; everything else is beside it")
