"""Have we been here before? Submaps, descriptors, verification, consistency of closures."""

from clew.place.association import (
    NEW,
    UNCLEAR,
    Gates,
    chi_square_limit,
    compatibility,
    nearest_neighbour,
)
from clew.place.closure import Closure, Verdict
from clew.place.consistency import ConsistencyOptions, agree
from clew.place.descriptor import Descriptor, DescriptorIndex, PairDistances, RingSpectra, TurnedRings
from clew.place.joining import JoinOptions, evidence_of_one, join_landmarks, landmark_density
from clew.place.joint import JointAssociation, joint_compatibility
from clew.place.sequence import along_all, blurred, evidence_along, told
from clew.place.submap import Submap, build_submap, surfels_of
from clew.place.verify import VerificationOptions, look_back, verify

__all__ = [
    "NEW",
    "UNCLEAR",
    "Closure",
    "ConsistencyOptions",
    "Descriptor",
    "DescriptorIndex",
    "Gates",
    "JoinOptions",
    "JointAssociation",
    "PairDistances",
    "RingSpectra",
    "Submap",
    "TurnedRings",
    "Verdict",
    "VerificationOptions",
    "agree",
    "along_all",
    "blurred",
    "build_submap",
    "chi_square_limit",
    "compatibility",
    "evidence_along",
    "evidence_of_one",
    "join_landmarks",
    "joint_compatibility",
    "landmark_density",
    "look_back",
    "nearest_neighbour",
    "surfels_of",
    "told",
    "verify",
]
