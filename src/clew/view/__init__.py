"""Pictures of results; draws and computes nothing."""

from clew.view.graph import plot_graph
from clew.view.landmarks import save_landmarks_png
from clew.view.map import save_map_png
from clew.view.overview import save_overview_png
from clew.view.report import (
    Report,
    report_of_landmarks,
    report_of_merge,
    report_of_run,
    report_of_solution,
    write_report,
)

__all__ = [
    "Report",
    "plot_graph",
    "report_of_landmarks",
    "report_of_merge",
    "report_of_run",
    "report_of_solution",
    "save_landmarks_png",
    "save_map_png",
    "save_overview_png",
    "write_report",
]
