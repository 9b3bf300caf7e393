"""The checks for users fail when something is wrong, and say what."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from clew.factors import Between, CustomFactor, PointObservation, RangeBearing
from clew.geometry import SE2, SE3, Dual, Point2, se2, se3
from clew.noise import Cauchy, Huber
from clew.testing import LAWS, check_factor, check_kernel, check_manifold


class SignSlip(RangeBearing):
    def predict_jacobian(self, q: Any) -> Any:
        return super().predict_jacobian(q) * np.array([[1.0], [-1.0]])


class ForgottenSensor(PointObservation):
    def jacobians(self, *values: Any, measurement: Any) -> Any:
        _, by_pose, by_point = PointObservation(0, 1, [0, 0], sigmas=1.0).view_jacobians(*values)
        return by_pose, by_point


class NoRotationJacobian(Between):
    """Right only where the rotation error is zero."""

    def jacobians(self, *values: Any, measurement: Any) -> Any:
        relative = se3.between(*values)
        by_b = np.zeros((len(relative), 6, 6))
        by_b[:, :3, :3] = se3.local_jacobians(measurement, relative)[1][:, :3, :3]
        by_b[:, 3:, 3:] = np.eye(3)
        return -by_b @ se3.adjoint(se3.inverse(relative)), by_b


class NotANumber(RangeBearing):
    def predict_jacobian(self, q: Any) -> Any:
        return np.full((*q.shape, 2), np.nan)


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (SignSlip(0, 1, 1.0, 0.0, sigmas=1.0), r"jacobians by key 0 \(SE2\) is wrong: d residual\[1\]"),
        (
            ForgottenSensor(0, 1, [1.0, 2.0], sigmas=1.0, T_robot_sensor=SE2(1, 2, 0.5)),
            r"by key 0 \(SE2\) is wrong",
        ),
        (NoRotationJacobian(0, 1, SE3.identity(), sigmas=1.0), r"d residual\[[345]\] / d tangent\[[345]\]"),
        (NotANumber(0, 1, 1.0, 0.0, sigmas=1.0), "is wrong"),
        (
            CustomFactor(0, lambda x: x - x.mean(axis=0), kinds=(Point2,), sigmas=[1, 1]),
            "depends on other rows",
        ),
        (CustomFactor(0, lambda x: 0.0 * x, kinds=(Point2,), sigmas=[1, 1]), "all residuals are zero"),
        (CustomFactor(0, lambda x: x, kinds=(Point2,), sigmas=1.0), "its noise asks for"),
        (
            CustomFactor(0, lambda x: 5 * np.sign(np.sin(x * 1e5)), kinds=(Point2,), sigmas=[1, 1]),
            "jumps in most samples",
        ),
    ],
)
def test_broken_factors_are_caught(factor: Any, says: str) -> None:
    with pytest.raises(AssertionError, match=says):
        check_factor(factor)


def test_values_of_your_own_may_be_objects() -> None:
    factor = Between(0, 1, SE2(1, 0, 0), sigmas=1.0)
    check_factor(factor, (SE2([0, 1], 0, 3.0), SE2([1, 2], 0, -3.0)))
    with pytest.raises(AssertionError, match="1 values for 2 keys"):
        check_factor(factor, (SE2.identity((2,)),))


class WrongWeight(Cauchy):
    def weight(self, s: Any) -> Any:
        return super().weight(s) ** 2


class Unscaled(Huber):
    def rho(self, s: Any) -> Any:
        return 0.5 * super().rho(s)


class Offset(Huber):
    def rho(self, s: Any) -> Any:
        return super().rho(s) + 0.1


class Growing(Huber):
    def weight(self, s: Any) -> Any:
        return 1.0 + s

    def rho(self, s: Any) -> Any:
        return s + 0.5 * s * s


@pytest.mark.parametrize(
    ("kernel", "says"),
    [
        (WrongWeight(1.0), "but the slope of rho is"),
        (Unscaled(1.0), "but the slope of rho is"),
        (Offset(1.0), r"rho\(0\) is 0.1"),
        (Growing(1.0), "not in"),
    ],
)
def test_broken_kernels_are_caught(kernel: Any, says: str) -> None:
    with pytest.raises(AssertionError, match=says):
        check_kernel(kernel)


def _broken(law_module: Any, **replacements: Any) -> Any:
    functions = {name: getattr(law_module, name) for name in dir(law_module) if not name.startswith("_")}
    return SimpleNamespace(**{**functions, **replacements})


def _scaled_tangents(a: Any) -> Any:
    return Dual(a.value, 1.001 * a.tangents) if isinstance(a, Dual) else a


BROKEN = {
    "closure": {"compose": lambda a, b: se2.compose(a, b) + np.array([0, 0, 2 * np.pi])},
    "identity": {"compose": lambda a, b: se2.compose(a, b + 1e-9)},
    "inverse": {"inverse": lambda a: -a},
    "associativity": {"compose": lambda a, b: se2.compose(a, b * np.array([1, 1, 1 + 1e-6]))},
    "exponential": {"exp": lambda u: se2.canonical(u)},
    "chart": {
        "retract": lambda a, u: se2.compose(a, se2.exp(u)),
        "local": lambda a, b: se2.log(se2.between(a, b)),
    },
    "adjoint": {"adjoint": lambda a: np.swapaxes(se2.adjoint(a), -1, -2)},
    "jacobians": {"act_jacobians": lambda a, p: tuple(1.0001 * j for j in se2.act_jacobians(a, p))},
    "duals": {"between": lambda a, b: _scaled_tangents(se2.between(a, b))},
}


@pytest.mark.parametrize("law", LAWS)
def test_each_law_catches_a_planted_bug(law: str) -> None:
    class Bent(SE2):
        __slots__ = ()
        functions = _broken(se2, **BROKEN[law])

    with pytest.raises(AssertionError):
        LAWS[law](Bent, (20,), np.random.default_rng(0), "generic")
    with pytest.raises(AssertionError):
        check_manifold(Bent, samples=20)
