"""What a robot that sees landmarks has measured so far, as arrays that grow."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Growing:
    """Rows appended one by one or in batches, kept in one array that doubles when it is full."""

    def __init__(self, shape: tuple[int, ...], dtype: type = np.float64) -> None:
        self._data: NDArray[Any] = np.empty((64, *shape), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def extend(self, rows: NDArray[Any]) -> None:
        """Append rows."""
        needed = self._count + len(rows)
        if needed > len(self._data):
            larger = np.empty((max(needed, 2 * len(self._data)), *self._data.shape[1:]), self._data.dtype)
            larger[: self._count] = self._data[: self._count]
            self._data = larger
        self._data[self._count : needed] = rows
        self._count = needed

    @property
    def array(self) -> NDArray[Any]:
        """All rows; a view."""
        return self._data[: self._count]


class Motions:
    """Relative poses from each pose to the next."""

    def __init__(self) -> None:
        self._keys = Growing((2,), np.int64)
        self._motion = Growing((3,))
        self._information = Growing((3, 3))

    def append(self, start: int, end: int, motion: Array, information: Array) -> None:
        """One more."""
        self._keys.extend(np.array([[start, end]]))
        self._motion.extend(motion[None])
        self._information.extend(information[None])

    def __len__(self) -> int:
        return len(self._keys)

    @property
    def keys(self) -> Indices:
        """``(S, 2)`` keys of the poses."""
        return np.asarray(self._keys.array, np.int64)

    @property
    def motion(self) -> Array:
        """``(S, 3)``."""
        return np.asarray(self._motion.array, np.float64)

    @property
    def information(self) -> Array:
        """``(S, 3, 3)``."""
        return np.asarray(self._information.array, np.float64)


class Seen:
    """Sightings with the landmark that each is taken for.

    Attributes:
        landmark: see there; may be set.
    """

    def __init__(self) -> None:
        self._pose = Growing((), np.int64)
        self._z = Growing((2,))
        self._noise = Growing((2, 2))
        self._landmark = Growing((), np.int64)

    def extend(self, pose: int, z: Array, noise: Array, landmark: Indices) -> None:
        """Sightings from one pose."""
        self._pose.extend(np.full(len(z), pose))
        self._z.extend(z)
        self._noise.extend(noise)
        self._landmark.extend(landmark)

    def __len__(self) -> int:
        return len(self._z)

    @property
    def pose(self) -> Indices:
        """``(K,)`` keys of the poses."""
        return np.asarray(self._pose.array, np.int64)

    @property
    def z(self) -> Array:
        """``(K, 2)`` in the frame of the pose, metres."""
        return np.asarray(self._z.array, np.float64)

    @property
    def noise(self) -> Array:
        """``(K, 2, 2)`` covariance as claimed."""
        return np.asarray(self._noise.array, np.float64)

    @property
    def landmark(self) -> Indices:
        """``(K,)`` key of each sighting's landmark, -1 for those of none; writing to it changes the record."""
        return np.asarray(self._landmark.array, np.int64)
