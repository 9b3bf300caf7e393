"""``clew evaluate``: a trajectory against true relations, a true trajectory, or its own scans."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet
from clew.errors import InputError

if TYPE_CHECKING:
    from clew.cli.self_evaluation import SelfEvaluation
    from clew.evaluate import ErrorStatistics
    from clew.scan import BeamTimes


def evaluate(
    trajectory: Annotated[Path, typer.Argument(
        help="Trajectory to judge, TUM format: timestamp x y z qx qy qz qw.", metavar="TRAJECTORY",
        show_default=False)],
    relations: Annotated[Path | None, typer.Option(
        help="True relations: t1 t2 x y z roll pitch yaw.", metavar="FILE", show_default=False)] = None,
    truth: Annotated[Path | None, typer.Option(
        help="True trajectory, TUM format.", metavar="FILE", show_default=False)] = None,
    own_log: Annotated[Path | None, typer.Option(
        "--self", help="The log that the trajectory was made from: judge it by its own scans.", metavar="LOG",
        show_default=False)] = None,
    delta: Annotated[str, typer.Option(
        help="Distance (10m) or time (5s) over which drift is measured with --truth.")] = "10m",
    tolerance: Annotated[float | None, typer.Option(
        help="Greatest difference of timestamps, seconds (0.5 for --relations, 0.05 for --truth).",
        show_default=False)] = None,
    json: Json = False,
    quiet: Quiet = False,
    log_level: LogLevelOption = LogLevel.WARNING,
) -> None:
    """Compare a trajectory with the truth, or with its own scans.

    With --relations: mean and deviation of the errors of relative poses (Kümmerle et al. 2009), the field's
    measure for laser logs. With --truth: distance from the true trajectory after the best rigid alignment, and
    drift over a fixed distance or time. With --self, which needs no truth: relative poses between visits of one
    place against the alignment of the two scans, and the spread of returns about their walls. Give one or more.

    **Examples**

    `clew evaluate out/trajectory.tum --relations intel.relations`

    `clew evaluate out/trajectory.tum --truth truth.tum --delta 5s --json`

    `clew evaluate out/trajectory.tum --self intel.clf.bz2`
    """
    from clew.evaluate import absolute_trajectory_error, relation_errors, relative_pose_error
    from clew.io import read_relations, read_tum

    if relations is None and truth is None and own_log is None:
        raise InputError("nothing to compare with: give --relations FILE, --truth FILE, --self LOG, or several of them")
    length, along = _parse_delta(delta)
    timestamps, poses = read_tum(trajectory)
    report: dict[str, object] = {"trajectory": str(trajectory), "poses": len(timestamps)}
    rows: list[tuple[str, int, int | None, ErrorStatistics, ErrorStatistics]] = []
    if relations is not None:
        of_relations = relation_errors(timestamps, poses, read_relations(relations),
                                       tolerance=0.5 if tolerance is None else tolerance)
        if not of_relations.used:
            raise InputError(
                f"{relations}: none of its {of_relations.unused} relations has poses of {trajectory} near both of its "
                "times; give relations of the same log"
            )
        report["relations"] = of_relations.to_dict()
        rows.append(("relations", of_relations.used, of_relations.unused, of_relations.translation,
                     of_relations.rotation))
    if truth is not None:
        true_timestamps, true_poses = read_tum(truth)
        near = 0.05 if tolerance is None else tolerance
        absolute = absolute_trajectory_error(true_timestamps, true_poses, timestamps, poses, tolerance=near)
        drift = relative_pose_error(true_timestamps, true_poses, timestamps, poses, delta=length, along=along,
                                    tolerance=near)
        report["absolute"] = absolute.to_dict()
        report["relative"] = drift.to_dict()
        rows.append(("absolute, aligned", absolute.used, absolute.unused, absolute.translation, absolute.rotation))
        rows.append((f"drift over {delta}", drift.used, None, drift.translation, drift.rotation))
    of_itself = None
    if own_log is not None:
        from clew.cli.progress import stages
        from clew.cli.self_evaluation import evaluate_self, in_plane
        from clew.cli.terminal import messages
        from clew.io import open_log

        with stages(messages(quiet)) as shown:
            shown.begin("reading")
            log = open_log(own_log)
            of_itself = evaluate_self(timestamps, in_plane(poses), log, shown.counter("aligning", "pairs of scans"))
        report["self"] = of_itself.to_dict()
        pairs = of_itself.pairs
        rows.append(("revisits, own scans", pairs.used, pairs.unused, pairs.translation, pairs.rotation))
    if json:
        _print_json(report)
    elif not quiet:
        _print_table(trajectory, rows)
        if of_itself is not None:
            _print_spread(of_itself)


def _parse_delta(text: str) -> tuple[float, Literal["distance", "time"]]:
    """Metres or seconds of ``10m`` or ``5s``."""
    try:
        value = float(text[:-1])
    except ValueError:
        value = float("nan")
    if text[-1:] not in ("m", "s") or not 0.0 < value < float("inf"):
        raise InputError(f"--delta {text}: give a distance such as 10m or a time such as 5s")
    return value, "distance" if text[-1] == "m" else "time"


def _print_json(report: dict[str, object]) -> None:
    import json

    typer.echo(json.dumps(report, indent=2))


def _print_table(trajectory: Path,
                 rows: list[tuple[str, int, int | None, ErrorStatistics, ErrorStatistics]]) -> None:
    import numpy as np
    from rich.table import Table

    from clew.cli.terminal import results

    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column("error", no_wrap=True)
    for name in ("unit", "mean", "std", "rmse", "median", "max", "used", "unused"):
        table.add_column(name, justify="right", no_wrap=True)
    for name, used, unused, translation, rotation in rows:
        for label, unit, scale, digits, errors in ((name, "m", 1.0, 4, translation),
                                                   ("", "deg", 180 / np.pi, 3, rotation)):
            values = (errors.mean, errors.std, errors.rmse, errors.median, errors.max)
            counts = (str(used), "" if unused is None else str(unused)) if label else ("", "")
            table.add_row(label, unit, *(f"{value * scale:.{digits}f}" for value in values), *counts)
    console = results()
    console.print(str(trajectory), soft_wrap=True, markup=False)
    console.print(table, width=max(console.width, 100), crop=False)


def _print_spread(of_itself: SelfEvaluation) -> None:
    from clew.cli.terminal import results

    spread = of_itself.spread
    results().print(
        f"returns about their walls: median {100 * spread.median:.2f} cm, rms {100 * spread.rms:.2f} cm "
        f"({spread.used} returns, {spread.unused} without a wall)", soft_wrap=True)
    if of_itself.beam_times:
        results().print(
            f"motion within scans taken out: {told_of_beams(of_itself.beam_times)}, found from the scans",
            soft_wrap=True)


def told_of_beams(times: BeamTimes) -> str:
    """When the beams of a scan were measured, in words."""
    sweep, interlace = (1000 * seconds for seconds in (times.sweep, times.interlace))
    swept = f"sweep of {sweep:.1f} ms" if isfinite(times.sweep_deviation) else "sweep not found"
    if isfinite(times.interlace_deviation):
        return f"{swept}, every second beam {interlace:.1f} ms later"
    return f"{swept}, of every second beam nothing found"
