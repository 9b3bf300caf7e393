"""How a solve ended, in sentences that say what to do."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """End of a solve; ``status.value`` is a sentence for people."""

    CONVERGED = "Converged: another step would not lower the cost by a visible amount."
    MAX_ITERATIONS = (
        "Stopped at the iteration limit while the cost was still falling; raise max_iterations or start from "
        "another initial guess."
    )
    STALLED = (
        "No step lowers the cost although the gradient is not zero; look for a factor whose Jacobian is "
        "wrong or for a cost that is not smooth."
    )
    UNDERCONSTRAINED = (
        "The measurements leave some variables free to move; the values given are one of many solutions. "
        "The diagnosis names the variables and directions."
    )
    DIVERGED = (
        "The steps led away from any minimum; use method='levenberg-marquardt', another initial guess or a "
        "robust kernel."
    )
    NOT_FINITE = (
        "A cost or step is infinite or not a number; look for infinite information or values out of range."
    )
    STOPPED = "Stopped by the callback."
    NOTHING_TO_DO = "All variables are constant or there are none; the values are those that were given."

    @property
    def ok(self) -> bool:
        """Whether the values are a minimum of the cost."""
        return self in (Status.CONVERGED, Status.NOTHING_TO_DO)
