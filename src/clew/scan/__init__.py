"""Laser scans: cleaning, matching, match covariance."""

from clew.scan.align import Alignment, AlignmentOptions, align
from clew.scan.correlate import CorrelativeMatch, LikelihoodPyramid, build_pyramid, correlate
from clew.scan.index import IndexedClouds, SourceClouds, index_cloud, join, merge_surfels
from clew.scan.laser import LaserScan
from clew.scan.points import CleaningOptions, ScanPoints, concatenate, extract_points

__all__ = [
    "Alignment",
    "AlignmentOptions",
    "CleaningOptions",
    "CorrelativeMatch",
    "IndexedClouds",
    "LaserScan",
    "LikelihoodPyramid",
    "ScanPoints",
    "SourceClouds",
    "align",
    "build_pyramid",
    "concatenate",
    "correlate",
    "extract_points",
    "index_cloud",
    "join",
    "merge_surfels",
]
