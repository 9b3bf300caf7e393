"""Files: one format a module."""

from clew.io.log import Log, Measurement, ReadReport
from clew.io.open_log import open_log

__all__ = ["Log", "Measurement", "ReadReport", "open_log"]
