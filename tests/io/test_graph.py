"""Pose-graph files: every tag, repairs, broken lines, round trips, real files."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from carmen_lines import DATA
from clew.errors import InputError
from clew.factors import Bearing, Between, PointObservation, Position, Prior, Range
from clew.geometry import SE2, SE3, Point2, Point3
from clew.graph import Factor, FactorGraph, Role
from clew.io import GraphFile, read_graph, write_graph


def read(tmp_path: Path, text: str, **options: str) -> GraphFile:
    path = tmp_path / "graph.g2o"
    path.write_text(text)
    return read_graph(path, **options)


def blocks(file: GraphFile) -> list[Factor]:
    return list(file.graph.blocks())


PLANAR = """\
# a comment
VERTEX_SE2 0 1 2 0.5
VERTEX_SE2 5 2 2 3.5
VERTEX_XY 3 4 5
FIX 0
EDGE_SE2 0 5 1 0 0.25 1 2 3 20 5 60
EDGE_SE2_XY 5 3 0.5 -0.5 4 1 9
EDGE_BEARING_SE2_XY 0 3 0.7 100
EDGE_RANGE_SE2_XY 0 3 3.5 400
EDGE_PRIOR_SE2 5 2 2 -2.5 1 0 0 1 0 1
PARAMS_STRANGE 1 2 3
"""


def test_every_planar_tag(tmp_path: Path) -> None:
    file = read(tmp_path, PLANAR)
    graph = file.graph
    assert file.has_values
    np.testing.assert_allclose(graph.value(5).array, [2, 2, 3.5 - 2 * np.pi])
    np.testing.assert_array_equal(graph.value(3).array, [4, 5])
    assert graph.is_constant(0)
    assert not graph.is_constant(5)
    between, seen, bearing, distance, prior = blocks(file)
    assert isinstance(between, Between)
    assert between.keys.tolist() == [[0, 5]]
    assert between.role == Role.ODOMETRY  # neighbours among the poses; the landmark has an id in between
    np.testing.assert_array_equal(between.measurement, [[1, 0, 0.25]])
    np.testing.assert_array_equal(between.information, [[[1, 2, 3], [2, 20, 5], [3, 5, 60]]])
    assert isinstance(seen, PointObservation)
    assert seen.kinds == (SE2, Point2)
    np.testing.assert_array_equal(seen.information, [[[4, 1], [1, 9]]])
    assert isinstance(bearing, Bearing)
    assert isinstance(distance, Range)
    assert (bearing.measurement.item(), distance.measurement.item()) == (0.7, 3.5)
    assert isinstance(prior, Prior)
    assert file.report.unknown == ((11, "PARAMS_STRANGE 1 2 3"),)
    assert file.report.unknown_tags == {"PARAMS_STRANGE": 1}
    assert file.report.fixed.tolist() == [0]


IDENTITY6 = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
SPATIAL = """\
PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1
PARAMS_SE3OFFSET 2 0.5 0 0 0 0 1 0
VERTEX_SE3:QUAT 1 0 0 0 0 0 0 -1
VERTEX_TRACKXYZ 2 1 2 3
"""


def test_spatial_tags_and_sensor_offsets(tmp_path: Path) -> None:
    text = SPATIAL + f"""\
VERTEX_SE3:QUAT 4 1 2 3 0.5 0.5 0.5 0.5
EDGE_SE3:QUAT 1 4 1 2 3 0.5 0.5 0.5 0.5 {IDENTITY6}
EDGE_SE3_TRACKXYZ 1 2 0 1 2 3 1 0 0 1 0 1
EDGE_SE3_TRACKXYZ 4 2 2 1 2 3 1 0 0 1 0 1
EDGE_SE3_PRIOR 1 0 0 0 0 0 0 0 1 {IDENTITY6}
EDGE_SE3_PRIOR 1 2 0.5 0 0 0 0 1 0 {IDENTITY6}
EDGE_SE3_PRIOR 1 9 9 9 0 0 0 1 {IDENTITY6}
"""
    file = read(tmp_path, text)
    between, centred, offset, prior = blocks(file)
    assert isinstance(between, Between)
    assert isinstance(prior, Prior)
    assert centred.T_robot_sensor is None
    assert centred.kinds == (SE3, Point3)
    np.testing.assert_array_equal(offset.T_robot_sensor, [0.5, 0, 0, 0, 0, 1, 0])
    np.testing.assert_array_equal(file.graph.value(1).array, [0, 0, 0, 0, 0, 0, 1])  # qw >= 0
    # Without a parameter, with the identity, and with an offset: all say where the *robot* is.
    np.testing.assert_allclose(prior.measurement, [[9, 9, 9, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, 1],
                                                   [0, 0, 0, 0, 0, 0, 1]], atol=1e-12)


def test_prior_seen_through_an_offset_weighs_the_same_errors(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    root = rng.normal(size=(6, 6))
    omega = root @ root.T
    o, z = SE3.exp(rng.normal(size=6)), SE3.exp(rng.normal(size=6))
    numbers = [*z.array, *omega[np.triu_indices(6)]]
    text = "PARAMS_SE3OFFSET 7 " + " ".join(map(repr, o.array.tolist()))
    text += "\nVERTEX_SE3:QUAT 1 0 0 0 0 0 0 1\n"
    text += "EDGE_SE3_PRIOR 1 7 " + " ".join(repr(float(n)) for n in numbers) + "\n"
    prior, = blocks(read(tmp_path, text))
    x = z @ o.inverse()
    for _ in range(5):
        moved = x.retract(1e-5 * rng.normal(size=6))
        seen = z.local(moved @ o)
        error = prior.residual(moved.array[None], measurement=prior.measurement)[0]
        assert error @ prior.information[0] @ error == pytest.approx(seen @ omega @ seen, rel=1e-3)


def test_unit_of_the_rotation_information(tmp_path: Path) -> None:
    text = "EDGE_SE3:QUAT 0 1 1 0 0 0 0 0 1  9 0 0 1 0 0  9 0 0 1 0  9 0 0 1  9 0 0  9 0  9"
    radians, half_angles = (blocks(read(tmp_path, text, rotation_information=unit))[0].information[0]
                            for unit in ("radians", "g2o"))
    np.testing.assert_array_equal(np.diag(radians), [9] * 6)
    np.testing.assert_array_equal(np.diag(half_angles), [9, 9, 9, 2.25, 2.25, 2.25])
    assert radians[0, 3] == 1
    assert half_angles[0, 3] == 0.5
    with pytest.raises(InputError, match="choose radians or g2o"):
        read(tmp_path, text, rotation_information="degrees")


def test_toro(tmp_path: Path) -> None:
    file = read(tmp_path, "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0.5 11 12 22 33 13 23\n")
    np.testing.assert_array_equal(blocks(file)[0].information, [[[11, 12, 13], [12, 22, 23], [13, 23, 33]]])
    file = read(tmp_path, f"VERTEX3 0 1 2 3 0 0 {np.pi / 2}\nEDGE3 0 1 1 0 0 {np.pi} 0 0 {IDENTITY6}\n")
    np.testing.assert_allclose(file.graph.value(0).array, [1, 2, 3, 0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_allclose(blocks(file)[0].measurement, [[1, 0, 0, 1, 0, 0, 0]], atol=1e-15)


def test_no_vertices_and_missing_ones(tmp_path: Path) -> None:
    file = read(tmp_path, "EDGE_SE2 4 2 1 0 0 1 0 0 1 0 1\nEDGE_SE2_XY 4 9 1 0 1 0 1\n")
    assert not file.has_values
    assert file.report.created.tolist() == [2, 4, 9]
    assert not np.any(file.graph.value(4).array)
    file = read(tmp_path, "VERTEX_SE2 4 1 1 1\nEDGE_SE2 4 2 1 0 0 1 0 0 1 0 1\n")
    assert file.has_values
    assert file.report.created.tolist() == [2]


def test_indefinite_information_is_reduced_and_named(tmp_path: Path) -> None:
    good, bad = "1 0 0 1 0 1", "1 0 5 1 0 1"
    file = read(tmp_path, f"EDGE_SE2 0 1 1 0 0 {good}\n\nEDGE_SE2 1 2 1 0 0 {bad}\n"
                "EDGE_SE2 2 3 1 0 0 0 0 0 0 0 0\n")
    assert file.report.reduced.tolist() == [3]
    np.testing.assert_array_equal(blocks(file)[0].information[:2], [np.eye(3)] * 2)
    with pytest.raises(InputError, match="line 1: EDGE_SE2: the information matrix has a negative"):
        read(tmp_path, "EDGE_SE2 0 1 1 0 0 1 0 0 -1 0 1\n")
    with pytest.raises(InputError, match="line 2"):
        read(tmp_path, "\nEDGE_SE2_XY 0 1 1 0 1 2 1\n")


def test_features_belong_to_the_vertex_before(tmp_path: Path) -> None:
    lines = ["VERTEX_SE2 7 0 0 0", "DATA_FEATURE_POINTXY 0 2 1 2 3 0.5 4", "VERTEX_SE2 3 1 0 0", "FIX 7",
             "DATA_FEATURE_POINTXY 0 2 5 6 1 0 1", "EDGE_SE2 3 7 1 0 0 1 0 0 1 0 1",
             "DATA_FEATURE_POINTXY 0 2 7 8 1 0 1"]
    file = read(tmp_path, "\n".join(lines))
    assert file.features is not None
    assert file.features.keys.tolist() == [7, 3, 3]
    np.testing.assert_array_equal(file.features.measurement, [[1, 2], [5, 6], [7, 8]])
    np.testing.assert_array_equal(file.features.information[0], [[3, 0.5], [0.5, 4]])
    write_graph(tmp_path / "again.g2o", file.graph, features=file.features)
    again = read_graph(tmp_path / "again.g2o")
    assert again.features is not None
    np.testing.assert_array_equal(again.features.keys, file.features.keys)
    np.testing.assert_array_equal(again.features.measurement, file.features.measurement)


@pytest.mark.parametrize(("text", "says"), [
    ("VERTEX_SE2 0 0 0\n", "line 1: VERTEX_SE2: a finite number expected, found the end of the line"),
    ("VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 x 0 0\n", "line 2: EDGE_SE2: an integer id expected, found 'x'"),
    ("VERTEX_SE2 1.5 0 0 0\n", "line 1: .* integer"), ("VERTEX_XY 0 nan 0\n", "line 1: .* finite number"),
    ("VERTEX_XY 0 1 2 3\n", "line 1: .* end of the line expected, found '3'"),
    ("VERTEX_XY 99999999999999999999 1 2\n", "line 1"), ("VERTEX_XY 0 1e999 2\n", "line 1"),
    ("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 0\n", "line 1: the quaternion"), ("FIX a\n", "line 1: FIX"),
    ("VERTEX_SE2 0 0 0 0\nFIX 3\n", "line 2: FIX refers to vertex 3"),
    ("DATA_FEATURE_POINTXY 0 2 1 1 1 0 1", "line 1"),
    ("VERTEX_SE2 0 0 0 0\nVERTEX_XY 0 0 0\n", "line 2: .* vertex 0 for a Point2, but it is a SE2"),
    ("VERTEX_XY 0 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n", "line 2: EDGE_SE2 takes vertex 0 for a SE2"),
    ("EDGE_SE2 3 3 1 0 0 1 0 0 1 0 1\n", "line 1: EDGE_SE2 joins vertex 3 with itself"),
    ("EDGE_SE3_TRACKXYZ 1 2 7 1 2 3 1 0 0 1 0 1\n", "line 1: .* parameter 7"), ("", "empty"),
    ("FLASER 1 2 3\nHELLO\n", r"no vertices and no edges .* \(found: FLASER, HELLO\)"),
    ("\x00\x01\x02\x03" * 9, "binary"),
])
def test_broken_files_name_file_and_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as error:
        read(tmp_path, text)
    assert str(tmp_path / "graph.g2o") in str(error.value)
    assert "\n" not in str(error.value)


def assert_equivalent(a: FactorGraph, b: FactorGraph, atol: float = 0.0) -> None:
    assert a.counts == b.counts
    for left, right in zip(a.variables(), b.variables(), strict=True):
        np.testing.assert_array_equal(left.keys, right.keys)
        np.testing.assert_array_equal(left.constant, right.constant)
        np.testing.assert_allclose(left.values, right.values, rtol=0, atol=atol)
    for one, other in zip(a.blocks(), b.blocks(), strict=True):
        assert type(one) is type(other)
        np.testing.assert_array_equal(one.keys, other.keys)
        np.testing.assert_allclose(one.measurement, other.measurement, rtol=0, atol=atol)
        np.testing.assert_allclose(one.information, other.information, rtol=1e-14, atol=atol)
        assert (one.T_robot_sensor is None) == (other.T_robot_sensor is None)


@pytest.mark.parametrize("name", ["g.g2o", "g.g2o.gz", "g.g2o.bz2"])
def test_what_was_read_is_written_again(tmp_path: Path, name: str) -> None:
    original = read(tmp_path, PLANAR)
    write_graph(tmp_path / name, original.graph, unknown=original.report.unknown)
    again = read_graph(tmp_path / name)
    assert_equivalent(original.graph, again.graph, 1e-15)
    assert again.report.unknown_tags == original.report.unknown_tags
    first = (tmp_path / name).read_bytes()
    write_graph(tmp_path / name, original.graph, unknown=original.report.unknown)
    assert (tmp_path / name).read_bytes() == first


def test_spatial_round_trip_in_both_styles_and_units(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    graph = FactorGraph()
    keys = graph.add_pose(SE3.exp(rng.normal(size=(20, 6))), key=np.arange(20) + (ord("a") << 56))
    roots = rng.normal(size=(19, 6, 6))
    graph.add(Between(keys[:-1], keys[1:], SE3.exp(rng.normal(size=(19, 6))), role="odometry",
                      information=roots @ np.swapaxes(roots, 1, 2)))
    for options in ({}, {"rotation_information": "g2o"}):
        write_graph(tmp_path / "g", graph, **options)  # type: ignore[arg-type]  # all options are text
        assert_equivalent(graph, read_graph(tmp_path / "g", **options).graph, 1e-14)
    write_graph(tmp_path / "g", graph, style="toro")
    assert (tmp_path / "g").read_text().startswith("VERTEX3 ")
    assert_equivalent(graph, read_graph(tmp_path / "g").graph, 1e-12)
    graph.add_point(np.ones(3), key=5)
    sensor = SE3.exp(rng.normal(size=6))
    graph.add(PointObservation(keys[0], 5, np.ones(3), sigmas=1.0, T_robot_sensor=sensor))
    write_graph(tmp_path / "g", graph)
    assert_equivalent(graph, read_graph(tmp_path / "g").graph, 1e-14)


def test_what_no_file_can_hold_is_refused(tmp_path: Path) -> None:
    graph = FactorGraph()
    key = graph.add_pose(SE2(0, 0, 0))
    graph.add(Position(key, [1.0, 2.0], sigmas=1.0))
    with pytest.raises(InputError, match="g2o files have no record for Position of SE2"):
        write_graph(tmp_path / "g", graph)
    graph = FactorGraph()
    graph.add_point([1.0, 2.0])
    with pytest.raises(InputError, match="TORO files have no record for variables of kind Point2"):
        write_graph(tmp_path / "g", graph, style="toro")
    assert not (tmp_path / "g").exists()


REAL = [
    ("graphs2d/CSAIL.g2o", {"SE2": 1045}, 1172, 0), ("graphs2d/intel.g2o", {"SE2": 1728}, 2512, 0),
    ("graphs2d/FR079_P_toro.graph", {"SE2": 989}, 1217, 0),
    ("graphs3d/cubicle.g2o", {"SE3": 5750}, 16869, 5021),
    ("graphs3d/parking-garage.g2o", {"SE3": 1661}, 6275, 0),
    ("landmarks/victoriaPark-full.g2o.gz", {"SE2": 6969, "Point2": 151}, 6968 + 3640, 0),
    ("landmarks/victoriaPark-noassoc.g2o.gz", {"SE2": 6969}, 6968, 0),
    ("multirobot/example_4robots/0.g2o", {"SE3": 32}, 44, 0),
]


@pytest.mark.parametrize(("name", "variables", "factors", "reduced"), REAL)
def test_real_files(tmp_path: Path, name: str, variables: dict[str, int], factors: int,
                    reduced: int) -> None:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs the real graph {path}")
    file = read_graph(path)
    assert {kind.name: len(file.graph.keys(kind)) for kind in file.graph.kinds} == variables
    assert file.graph.factor_count == factors
    assert len(file.report.reduced) == reduced
    write_graph(tmp_path / "g.gz", file.graph, features=file.features)
    assert_equivalent(file.graph, read_graph(tmp_path / "g.gz").graph, 1e-12)
    if "noassoc" in name:
        assert file.features is not None
        assert len(file.features.keys) == 3640
        before = gzip.decompress(path.read_bytes()).decode().split("DATA_FEATURE_POINTXY")[0]
        vertex = [line for line in before.splitlines() if line.startswith("VERTEX")][-1]
        assert file.features.keys[0] == int(vertex.split()[1])


def test_real_toro_edges_point_from_the_first_vertex_to_the_second() -> None:
    path = DATA / "graphs2d" / "FR079_P_toro.graph"
    if not path.exists():
        pytest.skip(f"needs the real graph {path}")
    file = read_graph(path)
    odometry, = file.graph.blocks(Role.ODOMETRY)
    ends = [file.graph.values(odometry.keys[:, i]).array for i in range(2)]
    error = odometry.residual(*ends, measurement=odometry.measurement)
    assert np.median(np.abs(error), axis=0).max() < 0.01
