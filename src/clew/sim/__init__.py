"""Simulated worlds, robots and sensors with known truth."""
