"""Have we been here before? Submaps, descriptors, verification, consistency of closures."""

from clew.place.closure import Closure, Verdict
from clew.place.consistency import ConsistencyOptions, agree
from clew.place.descriptor import describe, similarity
from clew.place.submap import Submap, build_submap, surfels_of
from clew.place.verify import VerificationOptions, verify

__all__ = [
    "Closure",
    "ConsistencyOptions",
    "Submap",
    "Verdict",
    "VerificationOptions",
    "agree",
    "build_submap",
    "describe",
    "similarity",
    "surfels_of",
    "verify",
]
