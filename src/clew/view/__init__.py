"""Pictures of results; draws and computes nothing.

Functions called ``*_figure`` take results and return a matplotlib figure, which a notebook shows and `save_figure`
writes; ``save_*_png`` write pictures that are laid out pixel by pixel. All take a `theme`, `LIGHT` or `DARK`.
"""

from clew.view.convergence import cost_figure
from clew.view.errors import error_figure
from clew.view.graph import before_after_figure, graph_figure
from clew.view.landmarks import save_landmarks_png
from clew.view.map import save_map_png
from clew.view.overview import save_overview_png
from clew.view.report import (
    Report,
    report_of_features,
    report_of_landmarks,
    report_of_merge,
    report_of_run,
    report_of_solution,
    write_report,
)
from clew.view.residuals import residuals_figure
from clew.view.scene import Scene, graph_scene, solution_scene
from clew.view.sparsity import sparsity_figure
from clew.view.style import DARK, LIGHT, Theme, save_figure

__all__ = [
    "DARK",
    "LIGHT",
    "Report",
    "Scene",
    "Theme",
    "before_after_figure",
    "cost_figure",
    "error_figure",
    "graph_figure",
    "graph_scene",
    "report_of_features",
    "report_of_landmarks",
    "report_of_merge",
    "report_of_run",
    "report_of_solution",
    "residuals_figure",
    "save_figure",
    "save_landmarks_png",
    "save_map_png",
    "save_overview_png",
    "solution_scene",
    "sparsity_figure",
    "write_report",
]
