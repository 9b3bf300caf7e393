"""What factors store, and what they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clew.errors import InputError
from clew.factors import (
    Bearing,
    Between,
    CustomFactor,
    PointObservation,
    Position,
    Prior,
    Range,
    RangeBearing,
)
from clew.geometry import SE2, SE3, Point2, Point3
from clew.graph import Role
from clew.noise import Huber


def test_a_single_factor_is_a_block_of_one() -> None:
    factor = Between(3, 7, SE2(1, 2, 0.5), sigmas=(0.1, 0.1, 0.05), kernel=Huber(), role="loop")
    assert len(factor) == 1
    assert factor.residual_dim == 3
    assert factor.keys.tolist() == [[3, 7]]
    assert factor.keys.dtype == np.int64
    assert factor.kinds == (SE2, SE2)
    assert factor.role is Role.LOOP
    assert factor.kernel == Huber()
    np.testing.assert_allclose(factor.measurement, [[1, 2, 0.5]])
    np.testing.assert_allclose(factor.information, [np.diag([100, 100, 400])])
    assert repr(factor) == "Between(1 x (SE2, SE2), role=loop, kernel=Huber(scale=1.345))"


def test_blocks_broadcast_keys_measurements_and_noise() -> None:
    factor = Between(np.arange(5), np.arange(5) + 1, SE3.identity((5,)), sigmas=0.1)
    assert factor.measurement.shape == (5, 7)
    assert factor.information.shape == (5, 6, 6)
    star = PointObservation(0, np.arange(4), [1.0, 2.0], sigmas=np.ones((4, 1)))
    assert star.keys.tolist() == [[0, 0], [0, 1], [0, 2], [0, 3]]
    assert star.measurement.shape == (4, 2)
    repeated = RangeBearing(0, 1, [1.0, 2.0, 3.0], 0.5, sigmas=(0.1, 0.01))
    assert repeated.keys.shape == (3, 2)
    assert repeated.measurement[:, 1].tolist() == [0.5] * 3
    assert Prior(0, Point3(1, 2, 3), covariance=np.eye(3)).kinds == (Point3,)


def test_kinds_roles_and_native_names() -> None:
    mounted = Position(0, Point3(1, 2, 3), sigmas=1.0, T_robot_sensor=SE3([0, 0, 2]))
    assert mounted.kinds == (SE3,)
    assert mounted.role is Role.OBSERVATION
    assert mounted.native is None
    np.testing.assert_array_equal(mounted.T_robot_sensor, [0, 0, 2, 0, 0, 0, 1])
    assert Prior(0, SE2.identity(), sigmas=1.0).role is Role.PRIOR
    assert Between(0, 1, [0, 0, 0], sigmas=1.0).role is Role.ODOMETRY
    assert Range(0, 1, 2.0, sigmas=1.0, space=3).kinds == (SE3, Point3)
    assert Bearing(0, 1, 0.1, 0.2, sigmas=1.0).kinds == (SE3, Point3)
    names = [
        Prior.native,
        Between.native,
        PointObservation.native,
        RangeBearing.native,
        Bearing.native,
        Range.native,
    ]
    assert names == ["prior", "between", "point", "range_bearing", "bearing", "range"]


def test_factors_are_immutable_and_own_their_data() -> None:
    source = np.zeros((2, 3))
    factor = Between([0, 1], [1, 2], source, sigmas=1.0)
    source[:] = 9.0
    assert np.all(factor.measurement == 0)
    for array in (factor.keys, factor.measurement, factor.information):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def _nothing(x: Any) -> Any:
    return x


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Between(0, 1, SE2.identity()), "Between: give exactly one of sigmas"),
        (
            lambda: Between(0, 1, Point2(0, 0), sigmas=1),
            "Between: measurement: expected SE2 or SE3, got Point2",
        ),
        (
            lambda: Between(0, 1, [1, 2], sigmas=1),
            r"Between: measurement: expected SE2 or SE3, got an array of shape \(2,\)",
        ),
        (lambda: Between(0, 1, [1, np.nan, 0], sigmas=1), r"measurement: entry \(1,\) is not finite"),
        (lambda: Between(0.5, 1, [0, 0, 0], sigmas=1), "key 0 must be an integer"),
        (lambda: Between([0, 1], [1, 2, 3], [0, 0, 0], sigmas=1), "keys are of different lengths: 2, 3"),
        (lambda: Between([0, 1], [1, 2], np.zeros((3, 3)), sigmas=1), "2 rows of keys, but 3 measurements"),
        (lambda: Between([[0]], 1, [0, 0, 0], sigmas=1), "must be one integer or"),
        (lambda: Between(0, 1, [0, 0, 0], sigmas=1, kernel="huber"), "kernel must be a robust kernel"),
        (
            lambda: Between(0, 1, [0, 0, 0], sigmas=1, role="guess"),
            "role must be one of odometry, observation, loop, prior",
        ),
        (lambda: Between(0, 1, [0, 0, 0], sigmas=[1, 2]), "Between: sigmas: expected shape"),
        (lambda: Between(0, 1, [0, 0, 0], information=-np.eye(3)), "not positive semidefinite"),
        (lambda: Prior(0, [0, 0, 0], sigmas=1), "value must be an SE2, SE3, Point2 or Point3, got list"),
        (
            lambda: PointObservation(0, 1, [1, 2], sigmas=1, T_robot_sensor=SE3.identity()),
            "T_robot_sensor: expected SE2",
        ),
        (
            lambda: PointObservation(0, 1, [1, 2], sigmas=1, T_robot_sensor=SE2.identity((2,))),
            "one pose for the whole block",
        ),
        (
            lambda: RangeBearing(0, 1, [1, 2], [1, 2, 3], sigmas=1),
            "range and bearing are of different lengths",
        ),
        (lambda: RangeBearing(0, 1, "far", 0, sigmas=1), "RangeBearing: range"),
        (lambda: Range(0, 1, 1.0, sigmas=1, space=4), "space must be 2 or 3"),
        (lambda: Range(0, 1, [[1.0]], sigmas=1), "range must be a number"),
        (lambda: CustomFactor(0, _nothing, kinds=(int,), sigmas=1), "kinds must be some of"),
        (lambda: CustomFactor((0, 1), _nothing, kinds=(SE2, SE2, SE2), sigmas=1), "2 keys for 3 kinds"),
        (
            lambda: CustomFactor(0, _nothing, kinds=(SE2,), sigmas=1, measurement=[np.inf]),
            "measurement must be finite",
        ),
    ],
)
def test_bad_input_is_refused_in_one_clear_line(make: Any, says: str) -> None:
    with pytest.raises(InputError, match=says) as raised:
        make()
    assert "\n" not in str(raised.value)
