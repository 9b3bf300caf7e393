"""Measurement models: one file a model, with residual, analytic Jacobian and formula."""

from clew.factors.bearing import Bearing
from clew.factors.between import Between
from clew.factors.calibrated_sighting import CalibratedBearing, CalibratedRange
from clew.factors.custom import CustomFactor
from clew.factors.point_observation import PointObservation
from clew.factors.position import Position
from clew.factors.preintegrated_motion import PreintegratedMotion
from clew.factors.prior import Prior
from clew.factors.range import Range
from clew.factors.range_bearing import RangeBearing

__all__ = [
    "Bearing",
    "Between",
    "CalibratedBearing",
    "CalibratedRange",
    "CustomFactor",
    "PointObservation",
    "Position",
    "PreintegratedMotion",
    "Prior",
    "Range",
    "RangeBearing",
]
