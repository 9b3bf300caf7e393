"""How much noisier or quieter the measurements are than their file says, found from their residuals.

Three variance components: translations and rotations of the odometry, and sightings (Förstner 1979, "Ein Verfahren zur
Schätzung von Varianz- und Kovarianzkomponenten"). The squared residuals of a component, weighted, over its redundancy
(its share of the degrees of freedom, from the engine's marginals) say by what its variance is to be multiplied.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between, PointObservation
from clew.slam.landmarks.linearised import expected_squares
from clew.solve import Solution

Array = NDArray[np.float64]

#: What the file says counts as much as so many redundant numbers.
_PRIOR_WEIGHT = 20.0
_SMALLEST, _LARGEST = 1e-4, 1e4


@dataclass(frozen=True)
class VarianceComponents:
    """Variances as multiples of what the file says.

    Attributes:
        translation, rotation: of the odometry.
        sightings: of the sightings.
    """

    translation: float = 1.0
    rotation: float = 1.0
    sightings: float = 1.0

    def change(self, other: VarianceComponents) -> float:
        """Largest change of a component, as a share."""
        pairs = zip(astuple(self), astuple(other), strict=True)
        return max(float(abs(a - b) / max(a, b)) for a, b in pairs)

    def quieter(self, other: VarianceComponents) -> float:
        """How many times smaller the variance of the sightings is than with others."""
        return other.sightings / self.sightings

    def of_motion(self, covariance: Array) -> Array:
        """Covariances ``(..., 3, 3)`` of relative poses, corrected."""
        scale = np.sqrt([self.translation, self.translation, self.rotation])
        corrected: Array = covariance * scale[:, None] * scale
        return corrected

    def motion_information(self, information: Array) -> Array:
        """Information ``(..., 3, 3)`` of relative poses, corrected."""
        scale = 1.0 / np.sqrt([self.translation, self.translation, self.rotation])
        corrected: Array = information * scale[:, None] * scale
        return corrected

    def updated(
        self, solution: Solution, motions: Between, sightings: PointObservation, squares: tuple[Array, Array]
    ) -> VarianceComponents:
        """Components that fit the residuals of a solution, whose factors were weighted with these components.

        `squares` are the `expected_squares` of the sightings.
        """
        weighed, redundancy = _squares(motions, *expected_squares(solution, motions))
        seen, seen_redundancy = _squares(sightings, *squares)
        return VarianceComponents(
            _estimate(self.translation, weighed[:2].sum(), redundancy[:2].sum()),
            _estimate(self.rotation, weighed[2], redundancy[2]),
            _estimate(self.sightings, seen.sum(), seen_redundancy.sum()),
        )


def inverted(information: Array) -> Array:
    """Covariances ``(..., d, d)`` of information matrices."""
    return np.asarray(np.linalg.inv(information), np.float64)


def _squares(factor: Between | PointObservation, error: Array, expected: Array) -> tuple[Array, Array]:
    """Weighted squared residuals and redundancy of each dimension ``(d,)``, summed over the factor."""
    weighed = (np.einsum("nij,nj->ni", factor.information, error) * error).sum(axis=0)
    uncertain = expected - error[:, :, None] * error[:, None, :]
    absorbed = np.einsum("nij,nji->i", factor.information, uncertain)
    return weighed, len(error) - absorbed


def _estimate(old: float, squares: float, redundancy: float) -> float:
    """The new variance: squares over redundancy, with the file's word as prior."""
    new = (_PRIOR_WEIGHT + old * squares) / (_PRIOR_WEIGHT + max(redundancy, 0.0))
    return float(min(max(new, _SMALLEST), _LARGEST))
