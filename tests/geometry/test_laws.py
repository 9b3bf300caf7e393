"""Every law over every manifold, regime and batch shape."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clew.geometry import SE2, SE3, SO2, SO3, Manifold, Point2, Point3
from clew.testing import LAWS, REGIMES, check_manifold

KINDS = (SO2, SE2, SO3, SE3, Point2, Point3)


@pytest.mark.parametrize("shape", [(), (5,), (2, 3)], ids=str)
@pytest.mark.parametrize("regime", REGIMES)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_law(kind: type[Any], law: str, regime: str, shape: tuple[int, ...]) -> None:
    LAWS[law](kind, shape, np.random.default_rng(7), regime)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_class_keeps_the_protocol(kind: type[Any]) -> None:
    assert isinstance(kind.identity(), Manifold)
    check_manifold(kind, samples=20)


@pytest.mark.parametrize("kind", [SE2, SE3], ids=lambda kind: kind.name)
def test_retract_is_not_the_group_exponential(kind: type[Any]) -> None:
    pose = kind.identity()
    delta = np.linspace(-1.0, 1.0, kind.dim)
    np.testing.assert_allclose(pose.retract(delta).translation, delta[: kind.space])
    assert np.abs(pose.retract(delta).array - pose.compose(kind.exp(delta)).array).max() > 0.05
