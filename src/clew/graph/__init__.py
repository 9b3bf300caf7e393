"""The factor graph: variables by kind in arrays, factors by kind in blocks."""
