"""A graph in a few lines of text."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from clew.graph.factor_graph import FactorGraph


def summarise(graph: FactorGraph) -> str:
    """Variables by kind and factors by type, role and kernel, one line each."""
    lines = [f"factor graph with {len(graph):,} variables and {graph.factor_count:,} factors"]
    for variables in graph.variables():
        held = int(variables.constant.sum())
        note = f" ({held:,} held constant)" if held else ""
        lines.append(f"  {len(variables.keys):>9,} {variables.kind.__name__}{note}")
    for block in graph.blocks():
        kernel = "" if block.kernel is None else f", {type(block.kernel).__name__}({block.kernel.scale:g})"
        arity = ", ".join(kind.__name__ for kind in block.kinds)
        lines.append(f"  {len(block):>9,} {type(block).__name__} of {arity}: {block.role.value}{kernel}")
    return "\n".join(lines)
