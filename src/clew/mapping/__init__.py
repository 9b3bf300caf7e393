"""Occupancy grids from scans at known poses."""
