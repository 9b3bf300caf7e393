"""Laser scans: cleaning, matching, match covariance."""

from clew.scan.laser import LaserScan

__all__ = ["LaserScan"]
