from __future__ import annotations
def diagnose(posterior, gauge, status, search):
    return status, tuple(str(p) for p in gauge.parts)
