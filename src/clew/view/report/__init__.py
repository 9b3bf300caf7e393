<<<<<<< HEAD
"""The report: one HTML file that shows what a run, a solve or a merge found."""

from clew.view.report.content import Report
from clew.view.report.page import write_report
from clew.view.report.run import report_of_run
from clew.view.report.solved import report_of_features, report_of_landmarks, report_of_merge, report_of_solution

__all__ = ["Report", "report_of_features",
    "report_of_landmarks", "report_of_merge", "report_of_run", "report_of_solution", "write_report"]
=======
"""The report: one HTML file that shows what a run, a solve or a merge found; its door is `clew.view`."""
>>>>>>> c9fe12d8e879445a9a8adcdbd4a48ba172a5a28b
