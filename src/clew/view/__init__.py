"""Pictures of results; draws and computes nothing."""

from clew.view.graph import plot_graph
from clew.view.landmarks import save_landmarks_png
from clew.view.map import save_map_png
from clew.view.overview import save_overview_png

__all__ = ["plot_graph", "save_landmarks_png", "save_map_png", "save_overview_png"]
