"""Laser scans: cleaning, features, matching, match covariance; tags in camera images."""

from clew.scan.align import (
    Alignment,
    AlignmentOptions,
    align,
    slope_share,
    with_new_partners,
    without_normal_noise,
)
from clew.scan.beam_times import BeamTimes
from clew.scan.correlate import CorrelativeMatch, LikelihoodPyramid, build_pyramid, correlate
from clew.scan.deskew import deskew, resample
from clew.scan.feature_circles import CircleOptions, Circles, find_circles
from clew.scan.feature_corners import Corners, find_corners
from clew.scan.feature_lines import LineOptions, Lines, find_lines
from clew.scan.feature_reflectors import ReflectorOptions, Reflectors, find_reflectors
from clew.scan.feature_returns import ReturnOptions
from clew.scan.find_beam_times import find_beam_times
from clew.scan.index import IndexedClouds, SourceClouds, index_cloud, join, merge_surfels
from clew.scan.laser import LaserScan
from clew.scan.noise import collinearity_residuals, robust_deviation
from clew.scan.points import CleaningOptions, ScanPoints, concatenate, extract_points, fill_surfaces, gathered
from clew.scan.tags import FAMILIES, Camera, Tags, find_tags

__all__ = [
    "FAMILIES",
    "Alignment",
    "AlignmentOptions",
    "BeamTimes",
    "Camera",
    "CircleOptions",
    "Circles",
    "CleaningOptions",
    "Corners",
    "CorrelativeMatch",
    "IndexedClouds",
    "LaserScan",
    "LikelihoodPyramid",
    "LineOptions",
    "Lines",
    "ReflectorOptions",
    "Reflectors",
    "ReturnOptions",
    "ScanPoints",
    "SourceClouds",
    "Tags",
    "align",
    "build_pyramid",
    "collinearity_residuals",
    "concatenate",
    "correlate",
    "deskew",
    "extract_points",
    "fill_surfaces",
    "find_beam_times",
    "find_circles",
    "find_corners",
    "find_lines",
    "find_reflectors",
    "find_tags",
    "gathered",
    "index_cloud",
    "join",
    "merge_surfels",
    "resample",
    "robust_deviation",
    "slope_share",
    "with_new_partners",
    "without_normal_noise",
]
