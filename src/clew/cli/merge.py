"""``clew merge``: the graphs of several robots in, one graph out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet

if TYPE_CHECKING:
    from clew.fleet import MergedFleet


def merge(
    inputs: Annotated[list[Path], typer.Argument(
        help="Output folders of runs (graph.g2o, landmarks.csv), or g2o files; one a robot.", metavar="OUT...",
        show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the merged graph.", metavar="OUT",
                                         show_default=False)],
    as_json: Json = False,
    quiet: Quiet = False,
    log_level: LogLevelOption = LogLevel.WARNING,
) -> None:
    """Merge robots that share landmarks or have relative poses between their graphs; no initial guess is needed.

    Where the robots stand to each other is told from at least three landmarks of the same identity, from a
    constellation of landmarks that cannot be chance, or from edges between the robots' poses (the top byte of a
    vertex id is the robot's letter). Robots that cannot be placed are not merged. The result is in the frame of
    the first robot; report.html and the picture show it.

    **Examples**

    `clew merge out1 out2 out3 -o all`
    """
    from clew.cli.progress import stages
    from clew.cli.terminal import messages
    from clew.fleet import merge as merge_robots
    from clew.fleet import read_robots, write_merged
    from clew.io import ensure_output_folder
    from clew.view import report_of_merge, write_report

    with stages(messages(quiet)) as shown:
        shown.begin("reading")
        robots = read_robots(inputs, progress=shown.counter("robots", "each solved by itself"))
        merged = merge_robots(robots, progress=shown.counter("merging", "pairs of robots, then all as one"))
        shown.begin("writing", note="files, report")
        ensure_output_folder(output)
        write_merged(merged, output)
        _draw(merged, output)
        write_report(output / "report.html", report_of_merge(merged))
    summary = summarise(merged)
    if as_json:
        typer.echo(json.dumps(summary, indent=2))
    elif not quiet:
        typer.echo(_as_text(merged, summary))
        typer.echo(f"look at {output / 'report.html'} (clew view {output}); the rest is beside it")


def _draw(merged: MergedFleet, folder: Path) -> None:
    """Write ``landmarks.png``, or ``graph.png`` where there are no landmarks, with a colour for each robot."""
    from clew.geometry import Point2
    from clew.view import graph_figure, save_figure, save_landmarks_png, solution_scene

    solution, names = merged.solution, merged.names
    title = f"{len(names)} robots merged"
    if Point2 not in solution.kinds:
        scene = solution_scene(solution, robots={name: merged.pose_keys(k) for k, name in enumerate(names)})
        save_figure(graph_figure(scene, title), folder / "graph.png")
        return
    keys = solution.keys(Point2)
    identities = [merged.identities.get(int(key), "") for key in keys]
    save_landmarks_png(
        folder / "landmarks.png",
        [(name, merged.poses(k).array[:, :2]) for k, name in enumerate(names)],
        solution.values(Point2).array, solution.covariances(Point2), identities if any(identities) else None, title,
        f"{len(solution.keys()):,} poses, {len(keys):,} landmarks, {len(merged.shared):,} of them in common",
    )  # fmt: skip


def summarise(merged: MergedFleet) -> dict[str, object]:
    """What became of the merge, for JSON."""
    return {
        "robots": list(merged.names),
        "frames": {name: frame.tolist() for name, frame in zip(merged.names, merged.frames, strict=True)},
        "links": [
            {
                "robots": [merged.names[a], merged.names[b]],
                "support": link.support,
                "edges": 0 if link.edges is None else len(link.edges.edges),
                "rejected_edges": 0 if link.edges is None else link.edges.count - len(link.edges.edges),
            }
            for (a, b), link in merged.links.items()
        ],
        "shared_landmarks": len(merged.shared),
        "chi2": merged.solution.chi2,
        "status": merged.solution.status.name.lower(),
    }


def _as_text(merged: MergedFleet, summary: dict[str, object]) -> str:
    counts = ", ".join(f"{count:,} {name}" for name, count in merged.graph.counts.items())
    lines = [f"{len(merged.names)} robots: {counts}; {summary['shared_landmarks']:,} landmarks in common"]
    for (a, b), link in merged.links.items():
        what = f"{link.support} landmarks agree" if link.edges is None else (
            f"{len(link.edges.edges)} of {link.edges.count} relative poses agree")
        lines.append(f"{merged.names[a]} - {merged.names[b]}: {what}")
    lines.append(f"chi2 {merged.solution.chi2:.6g}; {merged.solution.status.value}")
    return "\n".join(lines)
