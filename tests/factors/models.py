"""One example of every built-in factor, in the plane and in space, with and without a sensor offset."""

from __future__ import annotations

from typing import Any

import numpy as np

from clew.factors import Bearing, Between, PointObservation, Position, Prior, Range, RangeBearing
from clew.geometry import SE2, SE3, Point2, Point3
from clew.graph import Factor
from clew.testing import random_elements

COUNT = 40


def every_factor() -> dict[str, Factor]:
    """Factors by a readable name; the measurements are random over the full range of angles."""
    rng = np.random.default_rng(17)
    first = np.arange(COUNT)
    factors: dict[str, Factor] = {}

    def draw(kind: type[Any]) -> Any:
        return kind.from_array(random_elements(kind, (COUNT,), rng))

    for kind in (SE2, SE3, Point2, Point3):
        factors[f"Prior {kind.name}"] = Prior(first, draw(kind), sigmas=0.1)
    for kind in (SE2, SE3):
        factors[f"Between {kind.name}"] = Between(first, first + 1, draw(kind), sigmas=0.1)
    for pose, point in ((SE2, Point2), (SE3, Point3)):
        for mounted in (False, True):
            sensor = pose.from_array(random_elements(pose, (), rng)) if mounted else None
            common: dict[str, Any] = {"sigmas": 0.1, "T_robot_sensor": sensor}
            distance = rng.uniform(1.0, 9.0, COUNT)
            bearing = rng.uniform(-np.pi, np.pi, COUNT)
            elevation = rng.uniform(-1.5, 1.5, COUNT) if pose is SE3 else None
            label = f"{pose.space}D{' mounted' if mounted else ''}"
            factors[f"PointObservation {label}"] = PointObservation(first, first, draw(point), **common)
            factors[f"RangeBearing {label}"] = RangeBearing(
                first, first, distance, bearing, elevation, **common
            )
            factors[f"Bearing {label}"] = Bearing(first, first, bearing, elevation, **common)
            factors[f"Range {label}"] = Range(first, first, distance, space=pose.space, **common)
            factors[f"Position {label}"] = Position(first, draw(point), **common)
    return factors
