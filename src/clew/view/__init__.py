"""Pictures of results; draws and computes nothing.

Functions called ``*_figure`` take results and return a matplotlib figure, which a notebook shows and `save_figure`
writes; ``save_*_png`` write pictures that are laid out pixel by pixel. All take a `theme`, `LIGHT` or `DARK`.

The names are loaded when they are first used: a report needs no matplotlib, and a picture no browser page.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from clew.view.convergence import cost_figure
    from clew.view.errors import error_figure
    from clew.view.graph import before_after_figure, graph_figure
    from clew.view.landmarks import save_landmarks_png
    from clew.view.map import save_map_png
    from clew.view.overview import save_overview_png
    from clew.view.report.content import Report
    from clew.view.report.page import write_report
    from clew.view.report.run import report_of_run
    from clew.view.report.solved import (
        report_of_features,
        report_of_landmarks,
        report_of_merge,
        report_of_solution,
    )
    from clew.view.residuals import residuals_figure
    from clew.view.scene import Scene, graph_scene, solution_scene
    from clew.view.sparsity import sparsity_figure
    from clew.view.style import DARK, LIGHT, Theme, save_figure

# public name -> module of this room
_MODULES = {
    "cost_figure": "convergence",
    "error_figure": "errors",
    **dict.fromkeys(("before_after_figure", "graph_figure"), "graph"),
    "save_landmarks_png": "landmarks",
    "save_map_png": "map",
    "save_overview_png": "overview",
    "Report": "report.content",
    "write_report": "report.page",
    "report_of_run": "report.run",
    **dict.fromkeys(
        ("report_of_features", "report_of_landmarks", "report_of_merge", "report_of_solution"), "report.solved"
    ),
    "residuals_figure": "residuals",
    **dict.fromkeys(("Scene", "graph_scene", "solution_scene"), "scene"),
    "sparsity_figure": "sparsity",
    **dict.fromkeys(("DARK", "LIGHT", "Theme", "save_figure"), "style"),
}

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


def __getattr__(name: str) -> Any:
    module = _MODULES.get(name)
    if module is None:
        raise AttributeError(f"module 'clew.view' has no attribute {name!r}")
    value = getattr(import_module(f"clew.view.{module}"), name)
    globals()[name] = value
    return value
