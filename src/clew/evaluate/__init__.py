"""Trajectory, relation and map metrics."""
