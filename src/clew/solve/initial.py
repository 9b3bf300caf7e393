from __future__ import annotations
def initial_guess(problem, current, init, robust):
    return current, "file"
