"""Have we been here before? Submaps, descriptors, verification, consistency of closures."""

from clew.place.association import (
    NEW,
    UNCLEAR,
    Gates,
    chi_square_limit,
    compatibility,
    joint_compatibility,
    nearest_neighbour,
)
from clew.place.closure import Closure, Verdict
from clew.place.consistency import ConsistencyOptions, agree
from clew.place.descriptor import describe, similarity
from clew.place.joining import JoinOptions, join_landmarks, landmark_density
from clew.place.submap import Submap, build_submap, surfels_of
from clew.place.verify import VerificationOptions, verify

__all__ = [
    "NEW",
    "UNCLEAR",
    "Closure",
    "ConsistencyOptions",
    "Gates",
    "JoinOptions",
    "Submap",
    "Verdict",
    "VerificationOptions",
    "agree",
    "build_submap",
    "chi_square_limit",
    "compatibility",
    "describe",
    "join_landmarks",
    "joint_compatibility",
    "landmark_density",
    "nearest_neighbour",
    "similarity",
    "surfels_of",
    "verify",
]
