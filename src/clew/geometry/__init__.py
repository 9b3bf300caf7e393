"""Rigid motions and points as batches of arrays: SE2, SE3, SO2, SO3, Point2, Point3."""
