"""Worlds of landmarks, with and without an identity that can be read off them, and what a sensor sees of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clew.errors import InputError
from clew.geometry import se2, wrap
from clew.sim.world import Array, Indices

ANONYMOUS = -1  # identity of a landmark that carries none
NO_LANDMARK = -1  # what a false sighting stands for


@dataclass(frozen=True, eq=False)
class LandmarkWorld:
    """Point landmarks in a rectangle.

    Attributes:
        positions: ``(L, 2)`` metres.
        identities: ``(L,)`` what a robot reads off each, `ANONYMOUS` where there is nothing to read.
        size: ``(2,)`` width and height of the rectangle from the origin, metres.
    """

    positions: Array
    identities: Indices
    size: Array

    def __len__(self) -> int:
        return len(self.positions)


@dataclass(frozen=True)
class SightingModel:
    """What a range-bearing sensor makes of landmarks.

    Attributes:
        range_max: landmarks further away are not seen, metres.
        field_of_view: about the robot's x axis, radians.
        sigma_range: standard deviation, metres.
        sigma_bearing: standard deviation, radians.
        missed: probability that a landmark in view is not seen.
        false: mean number of false sightings a pose, evenly spread over the field of view; they carry no
            identity.
        misread: probability that a sighting carries the identity of another landmark of the world.
    """

    range_max: float = 8.0
    field_of_view: float = 2 * np.pi
    sigma_range: float = 0.05
    sigma_bearing: float = np.radians(1.0)
    missed: float = 0.1
    false: float = 0.05
    misread: float = 0.0

    def __post_init__(self) -> None:
        if not (0 < self.range_max < np.inf and 0 < self.field_of_view <= 2 * np.pi):
            raise InputError(f"SightingModel: reach {self.range_max:g} m over {self.field_of_view:g} rad: needs "
                             "a positive reach and a field of view in (0, 2 pi]")
        if min(self.sigma_range, self.sigma_bearing, self.false) < 0:
            raise InputError("SightingModel: standard deviations and rates must not be negative")
        if not (0 <= self.missed <= 1 and 0 <= self.misread <= 1):
            raise InputError("SightingModel: missed and misread are probabilities, in [0, 1]")

    @property
    def covariance(self) -> Array:
        """``(2, 2)`` of (range, bearing), m^2 and rad^2."""
        return np.diag([self.sigma_range**2, self.sigma_bearing**2])


@dataclass(frozen=True, eq=False)
class Sightings:
    """``M`` sightings of landmarks, ordered by pose.

    Attributes:
        poses: ``(M,)`` index of the pose.
        ranges: ``(M,)`` metres.
        bearings: ``(M,)`` radians from the robot's x axis.
        identities: ``(M,)`` as read; `ANONYMOUS` where nothing was.
        landmarks: ``(M,)`` the truth: index of the landmark, `NO_LANDMARK` for a false sighting.
    """

    poses: Indices
    ranges: Array
    bearings: Array
    identities: Indices
    landmarks: Indices

    def __len__(self) -> int:
        return len(self.poses)


def landmark_field(count: int, size: tuple[float, float], *, seed: int, spacing: float = 1.0,
                   identified: float = 0.5, first_identity: int = 1) -> LandmarkWorld:
    """Landmarks thrown at random, no two closer together than `spacing`.

    Args:
        count: number of landmarks.
        size: width and height of the field, metres.
        seed: of positions and of who carries an identity.
        spacing: least distance of two landmarks, metres.
        identified: share of landmarks that carry an identity.
        first_identity: identities count up from here, so that two worlds can share none.

    Raises:
        InputError: so many landmarks do not fit with that spacing, or a share outside of [0, 1].
    """
    if not 0 <= identified <= 1:
        raise InputError(f"landmark_field: identified={identified:g}: must be in [0, 1]")
    rng = np.random.default_rng(seed)
    positions = np.empty((0, 2))
    for _ in range(100 * count):
        if len(positions) == count:
            break
        candidate = rng.random(2) * size
        if np.all(np.hypot(*(positions - candidate).T) >= spacing):
            positions = np.vstack([positions, candidate])
    if len(positions) < count:
        raise InputError(f"landmark_field: {count} landmarks {spacing:g} m apart do not fit into "
                         f"{size[0]:g} x {size[1]:g} m; ask for fewer or a smaller spacing")
    carries = np.zeros(count, dtype=bool)
    carries[rng.permutation(count)[: round(identified * count)]] = True
    identities = np.where(carries, first_identity + np.arange(count), ANONYMOUS)
    return LandmarkWorld(positions, identities, np.asarray(size, dtype=np.float64))


def see_landmarks(world: LandmarkWorld, T_world_robot: Array, model: SightingModel,
                  rng: np.random.Generator) -> Sightings:
    """What a robot at true poses ``(N, 3)`` sees of the landmarks, false sightings included."""
    seen = se2.act(se2.inverse(T_world_robot)[:, None], world.positions[None])  # (N, L, 2)
    distance, direction = np.hypot(seen[..., 0], seen[..., 1]), np.arctan2(seen[..., 1], seen[..., 0])
    visible = (distance < model.range_max) & (np.abs(direction) <= model.field_of_view / 2)
    visible &= rng.random(visible.shape) >= model.missed
    poses, landmarks = np.nonzero(visible)
    ranges = distance[visible] + model.sigma_range * rng.standard_normal(len(poses))
    bearings = direction[visible] + model.sigma_bearing * rng.standard_normal(len(poses))
    identities = world.identities[landmarks]
    named = np.unique(world.identities[world.identities != ANONYMOUS])
    wrong = (identities != ANONYMOUS) & (rng.random(len(poses)) < model.misread)
    if wrong.any() and len(named) > 1:
        shift = rng.integers(1, len(named), wrong.sum())
        identities[wrong] = named[(np.searchsorted(named, identities[wrong]) + shift) % len(named)]
    count = rng.poisson(model.false, len(T_world_robot))
    false = np.repeat(np.arange(len(T_world_robot)), count)
    blank = np.full(len(false), ANONYMOUS)
    poses = np.concatenate([poses, false])
    order = np.argsort(poses, kind="stable")
    spread = model.field_of_view * (rng.random(len(false)) - 0.5)
    # Evenly over the area of the field of view.
    reach = model.range_max * np.sqrt(rng.random(len(false)))
    return Sightings(
        poses[order],
        np.maximum(np.concatenate([ranges, reach]), 1e-3)[order],
        wrap(np.concatenate([bearings, spread]))[order],
        np.concatenate([identities, blank])[order],
        np.concatenate([landmarks, np.full(len(false), NO_LANDMARK)])[order],
    )
