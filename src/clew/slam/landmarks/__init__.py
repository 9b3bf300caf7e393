"""Landmark SLAM: robots that recognise landmarks, alone or several in one map."""

from clew.slam.landmarks.estimate import LandmarkMap, RobotEstimate, map_landmarks
from clew.slam.landmarks.features import FeatureMap, map_features
from clew.slam.landmarks.mapper import AssociationConfig, LandmarkMapper
from clew.slam.landmarks.model import Calibration, MarkNoise, Marks, SensorModel, SightingNoise
from clew.slam.landmarks.track import KEYS_A_ROBOT

__all__ = [
    "KEYS_A_ROBOT",
    "AssociationConfig",
    "Calibration",
    "FeatureMap",
    "LandmarkMap",
    "LandmarkMapper",
    "MarkNoise",
    "Marks",
    "RobotEstimate",
    "SensorModel",
    "SightingNoise",
    "map_features",
    "map_landmarks",
]
