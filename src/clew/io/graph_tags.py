"""The records of pose-graph files: g2o's (github.com/RainerKuemmerle/g2o) and TORO's (openslam.org/toro)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from clew.geometry import SE2, SE3, Point2, Point3


@dataclass(frozen=True)
class Tag:
    """Fields of one kind of record.

    Attributes:
        name: the first word of the line.
        kinds: manifold of each variable whose id follows.
        measurement: how many numbers follow as value or measurement.
        residual: size of the information matrix, whose upper triangle follows row by row; 0 if none does.
        parameter: whether the id of a ``PARAMS`` line may stand behind the ids.
    """

    name: str
    kinds: tuple[type[Any], ...]
    measurement: int
    residual: int = 0
    parameter: bool = False

    @property
    def numbers(self) -> int:
        """How many numbers follow the ids."""
        return self.measurement + self.residual * (self.residual + 1) // 2


VERTICES = (
    Tag("VERTEX_SE2", (SE2,), 3),
    Tag("VERTEX2", (SE2,), 3),  # TORO
    Tag("VERTEX_SE3:QUAT", (SE3,), 7),
    Tag("VERTEX3", (SE3,), 6),  # TORO: x y z roll pitch yaw
    Tag("VERTEX_XY", (Point2,), 2),
    Tag("VERTEX_TRACKXYZ", (Point3,), 3),
)
EDGES = (
    Tag("EDGE_SE2", (SE2, SE2), 3, 3),
    Tag("EDGE2", (SE2, SE2), 3, 3),  # TORO, with an order of its own in the information
    Tag("EDGE_SE3:QUAT", (SE3, SE3), 7, 6),
    Tag("EDGE3", (SE3, SE3), 6, 6),  # TORO
    Tag("EDGE_SE2_XY", (SE2, Point2), 2, 2),
    Tag("EDGE_BEARING_SE2_XY", (SE2, Point2), 1, 1),
    Tag("EDGE_RANGE_SE2_XY", (SE2, Point2), 1, 1),
    Tag("EDGE_SE3_TRACKXYZ", (SE3, Point3), 3, 3, parameter=True),
    Tag("EDGE_PRIOR_SE2", (SE2,), 3, 3),
    Tag("EDGE_SE2_PRIOR", (SE2,), 3, 3),
    Tag("EDGE_SE3_PRIOR", (SE3,), 7, 6, parameter=True),
)
#: Columns of the upper triangle, row by row, in TORO's order I11 I12 I22 I33 I13 I23.
TORO_ORDER = (0, 1, 4, 2, 5, 3)


@dataclass(frozen=True)
class Offset:
    """A ``PARAMS`` record: where a sensor sits on the robot.

    Attributes:
        name: the first word of the line.
        kind: manifold of the offset.
    """

    name: str
    kind: type[Any]


OFFSETS = (Offset("PARAMS_SE3OFFSET", SE3), Offset("PARAMS_SE2OFFSET", SE2))

#: What the native parser is asked for: tag, ids, numbers, whether a parameter's id may follow the ids.
RECORDS = [(tag.name, len(tag.kinds), tag.numbers, tag.parameter) for tag in VERTICES + EDGES] + [
    (offset.name, 1, offset.kind.storage, False) for offset in OFFSETS]
