"""``clew evaluate`` on files with known errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from clew.cli.evaluate import evaluate, told_of_beams
from clew.cli.self_evaluation import in_plane, measure_pairs, without_motion
from clew.errors import InputError
from clew.geometry import se2
from clew.io import open_log, read_tum, write_tum
from clew.scan import BeamTimes, LaserScan, extract_points, index_cloud, join
from clew.sim import Drive, LaserModel, OdometryModel, drive, hall, office_building, simulate, tour, write_carmen


@pytest.fixture
def app() -> typer.Typer:
    app = typer.Typer(rich_markup_mode="rich")
    app.command()(evaluate)
    return app


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A straight drive of 40 m, its estimate that is 1 % too long, and a relation that says so."""
    times = np.arange(81.0)
    true = np.column_stack([0.5 * times, np.zeros((81, 2))])
    write_tum(tmp_path / "truth.tum", times, true)
    write_tum(tmp_path / "estimate.tum", times, true * [1.01, 1.0, 1.0])
    (tmp_path / "relations").write_text("0 20 10 0 0 0 0 0\n0 60 30 0 0 0 0 0\n500 501 1 0 0 0 0 0\n")
    return tmp_path


def run(app: typer.Typer, *arguments: object) -> str:
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_json_holds_the_known_errors(app: typer.Typer, files: Path) -> None:
    report = json.loads(run(app, files / "estimate.tum", "--relations", files / "relations", "--truth",
                            files / "truth.tum", "--json"))
    assert report["poses"] == 81
    assert (report["relations"]["used"], report["relations"]["unused"]) == (2, 1)
    assert report["relations"]["translation_m"]["mean"] == pytest.approx(0.2, abs=1e-6)
    assert report["relations"]["translation_m"]["std"] == pytest.approx(0.1, abs=1e-6)
    assert report["absolute"]["translation_m"]["max"] == pytest.approx(0.2, abs=1e-6)
    assert report["relative"]["delta_m"] == 10.0
    assert report["relative"]["translation_m"]["mean"] == pytest.approx(0.1, abs=1e-6)


def test_table_holds_them_too(app: typer.Typer, files: Path) -> None:
    output = run(app, files / "estimate.tum", "--relations", files / "relations", "--truth", files / "truth.tum",
                 "--delta", "20s")
    for text in ("relations", "0.2000", "absolute", "drift over 20s", "0.1000"):
        assert text in output


def test_help_shows_examples(app: typer.Typer) -> None:
    assert "clew evaluate out/trajectory.tum --relations" in run(app, "--help")


@pytest.mark.parametrize(("options", "message"), [
    ([], "nothing to compare with"),
    (["--truth", "truth.tum", "--delta", "far"], "--delta far"),
    (["--truth", "truth.tum", "--delta", "-1m"], "--delta -1m"),
    (["--truth", "missing.tum"], "missing.tum"),
    (["--relations", "truth.tum", "--tolerance", "-1"], "tolerance of -1"),
])
def test_bad_requests_are_one_clear_line(app: typer.Typer, files: Path, monkeypatch: pytest.MonkeyPatch,
                                         options: list[str], message: str) -> None:
    monkeypatch.chdir(files)
    with pytest.raises(InputError, match=message) as caught:
        run(app, "estimate.tum", *options)
    assert "\n" not in str(caught.value)


# --- --self ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def laps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two laps in a hall, recorded; the true trajectory, and one whose second lap is 3 cm and 0.5 degrees off."""
    folder = tmp_path_factory.mktemp("laps")
    angle = 2 * np.pi * np.arange(160) / 80
    poses = np.column_stack([20 + 5 * np.cos(angle), 15 + 5 * np.sin(angle), angle + np.pi / 2])
    driven = Drive(0.5 * np.arange(160.0), se2.canonical(poses))
    log = simulate(hall(1), driven, LaserModel(beams=181), OdometryModel.medium(), 1)
    write_carmen(log, folder / "laps.log")
    write_tum(folder / "true.tum", log.timestamps, log.T_world_robot)
    off = log.T_world_robot.copy()
    off[80:] = se2.compose(off[80:], np.array([0.03, 0.0, np.radians(0.5)]))
    write_tum(folder / "off.tum", log.timestamps, off)
    return folder


@pytest.mark.parametrize(("name", "metres", "degrees"), [("true", 0.0, 0.0), ("off", 0.03, 0.5)])
def test_self_measures_the_error_between_laps(
    app: typer.Typer, laps: Path, name: str, metres: float, degrees: float
) -> None:
    report = json.loads(run(app, laps / f"{name}.tum", "--self", laps / "laps.log", "--json"))["self"]
    assert report["pairs"]["used"] > 40
    assert report["pairs"]["translation_m"]["median"] == pytest.approx(metres, abs=0.005)
    assert report["pairs"]["rotation_deg"]["median"] == pytest.approx(degrees, abs=0.08)
    assert report["alignment_disagreement_m"] < 0.004
    # A median of 0.67 sigma of noise and rounding; the laps that do not fit make it more.
    if metres == 0.0:
        assert 0.004 < report["spread"]["median_m"] < 0.009
    else:
        assert report["spread"]["median_m"] > 0.01


def test_self_prints_both_measures(app: typer.Typer, laps: Path) -> None:
    output = run(app, laps / "true.tum", "--self", laps / "laps.log")
    assert "revisits, own scans" in output
    assert "returns about their walls: median 0." in output


def test_self_finds_out_when_beams_were_measured_whatever_the_poses(app: typer.Typer, tmp_path: Path) -> None:
    """The file does not say that every second beam comes later; a bent trajectory is not judged the better for it."""
    world = office_building(3)
    laser = LaserModel(361, resolution=0.001, sigma_range=0.005, sweep=1 / 150, interlace=1 / 75)
    log = simulate(world, drive(tour(world, 3, 200.0), rate=5.0, duration=120.0), laser, OdometryModel.medium(), 3)
    write_carmen(log, tmp_path / "drive.log")
    bent = log.T_world_robot.copy()
    bent[:, 0] += 0.1 * np.sin(0.1 * log.timestamps)  # 10 cm to and fro in a minute
    reports = {}
    for name, poses in (("true", log.T_world_robot), ("bent", bent)):
        write_tum(tmp_path / f"{name}.tum", log.timestamps, poses)
        arguments = (tmp_path / f"{name}.tum", "--self", tmp_path / "drive.log")
        reports[name] = json.loads(run(app, *arguments, "--json"))["self"]
        assert reports[name]["interlace_found_s"] == pytest.approx(1 / 75, rel=0.08)
    assert "motion within scans taken out" in run(app, *arguments)
    assert reports["true"]["spread"]["median_m"] < 0.006
    assert reports["bent"]["spread"]["median_m"] > 1.1 * reports["true"]["spread"]["median_m"]


def test_self_bounds_a_sweep_by_the_scans_of_the_log_not_by_the_poses(app: typer.Typer, tmp_path: Path) -> None:
    """Scans seem to take 100 ms, though one comes every 50: of a trajectory with every third that must not be lost."""
    world = office_building(3)
    laser = LaserModel(181, resolution=0.001, sigma_range=0.005, sweep=0.1)
    log = simulate(world, drive(tour(world, 3, 200.0), rate=20.0, duration=100.0), laser, OdometryModel.medium(), 3)
    write_carmen(log, tmp_path / "drive.log")
    write_tum(tmp_path / "third.tum", log.timestamps[::3], log.T_world_robot[::3])
    arguments = (tmp_path / "third.tum", "--self", tmp_path / "drive.log")
    assert json.loads(run(app, *arguments, "--json"))["self"]["sweep_found_s"] == 0.0


@pytest.mark.parametrize(("times", "said"), [
    (BeamTimes(0.0067, 0.0133, 0.001, 0.001), "sweep of 6.7 ms, every second beam 13.3 ms later"),
    (BeamTimes(0.0, 0.0133, np.inf, 0.001), "sweep not found, every second beam 13.3 ms later"),
    (BeamTimes(0.18, 0.0, 0.001, np.inf), "sweep of 180.0 ms, of every second beam nothing found"),
])
def test_what_was_not_found_is_not_said_to_be_zero(times: BeamTimes, said: str) -> None:
    assert told_of_beams(times) == said


def test_self_takes_the_motion_out_of_sweeps() -> None:
    """Scans of a turning laser that drives and turns, against scans taken all at once on the same way."""
    angle = np.arange(30.0) * 0.05
    way = Drive(0.1 * np.arange(30.0),
                np.column_stack([20 + 3 * np.sin(angle), 15 - 3 * np.cos(angle), angle]))
    at_once = LaserModel(450, np.radians(359.2), range_max=30.0, sigma_range=1e-4, resolution=1e-4)
    sweeping = replace(at_once, sweep=0.1)
    clouds = []
    for laser in (at_once, sweeping):
        log = simulate(hall(1), way, laser, OdometryModel.medium(), 1)
        scans = [m for m in log.measurements() if isinstance(m, LaserScan)]
        clouds.append((scans, without_motion(scans, log.timestamps, log.T_world_robot)))
    (_, plain), (swept, still) = clouds
    assert all(before is after for before, after in zip(clouds[0][0], plain, strict=True))

    def apart(scan: LaserScan, other: LaserScan) -> float:
        tree = cKDTree(extract_points(other).points)
        return float(np.median(tree.query(extract_points(scan).points)[0]))

    middle = range(5, 25)
    assert np.median([apart(still[k], plain[k]) for k in middle]) < 0.5 * np.median(
        [apart(swept[k], plain[k]) for k in middle])


def test_self_with_the_log_of_another_drive_is_refused(app: typer.Typer, laps: Path, files: Path) -> None:
    write_tum(files / "late.tum", 1e6 + np.arange(5.0), np.zeros((5, 3)))
    with pytest.raises(InputError, match="the log that the trajectory was made from"):
        run(app, files / "late.tum", "--self", laps / "laps.log")


def test_pairs_are_measured_alike_from_either_side(laps: Path) -> None:
    scans = [m for m in open_log(laps / "laps.log").measurements() if isinstance(m, LaserScan)]
    first = np.arange(0, 76, 4)
    rows = np.concatenate([first, first + 81])  # not quite the same places, so that the two directions differ
    clouds = join([index_cloud(extract_points(scans[row])) for row in rows])
    poses = read_tum(laps / "true.tum")[1][rows]
    pairs = np.stack([np.arange(19), 19 + np.arange(19)], axis=1).astype(np.int32)
    T_there, known, gaps = measure_pairs(clouds, pairs, in_plane(poses))
    T_back, known_back, gaps_back = measure_pairs(clouds, np.ascontiguousarray(pairs[:, ::-1]), in_plane(poses))
    np.testing.assert_array_equal(known, known_back)
    assert known.sum() > 3
    assert gaps[known, 0].max() > 1e-3  # so that it matters which way the mean is taken
    np.testing.assert_allclose(gaps[known, 1], gaps_back[known, 1], atol=1e-9)
    np.testing.assert_allclose(se2.compose(T_there, T_back)[known], 0.0, atol=1e-6)
