"""Every factor through one harness, and against forward differentiation of its own residual."""

from __future__ import annotations

import numpy as np
import pytest

from clew.geometry import forward_jacobians
from clew.testing import check_factor, random_elements
from factors.models import every_factor

FACTORS = every_factor()


@pytest.mark.parametrize("name", FACTORS)
def test_the_laws_of_a_factor(name: str) -> None:
    check_factor(FACTORS[name], samples=200)


@pytest.mark.parametrize("name", FACTORS)
def test_analytic_and_forward_jacobians_agree(name: str) -> None:
    factor = FACTORS[name]
    rng = np.random.default_rng(2)
    values = [random_elements(kind, (len(factor),), rng) for kind in factor.kinds]
    error, analytic = factor.linearise(*values)
    value, forward = forward_jacobians(factor.residual, factor.kinds, values, factor.measurement)
    np.testing.assert_array_equal(error, value)
    for ours, theirs in zip(analytic, forward, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())


@pytest.mark.parametrize("name", FACTORS)
def test_a_block_is_its_measurements_one_by_one(name: str) -> None:
    factor = FACTORS[name]
    rng = np.random.default_rng(4)
    values = [random_elements(kind, (len(factor),), rng) for kind in factor.kinds]
    whole = factor.residual(*values, measurement=factor.measurement)
    for row in (0, len(factor) - 1):
        one = factor.residual(
            *(v[row : row + 1] for v in values), measurement=factor.measurement[row : row + 1]
        )
        np.testing.assert_allclose(one[0], whole[row], rtol=1e-13, atol=1e-13)
