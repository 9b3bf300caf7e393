"""Robust kernels: their laws, and values worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clew.errors import InputError
from clew.noise import DCS, Cauchy, GemanMcClure, Huber, Kernel, PseudoHuber, Tukey, Welsch
from clew.testing import check_kernel

KERNELS = (Huber, PseudoHuber, Cauchy, GemanMcClure, Welsch, Tukey, DCS)


@pytest.mark.parametrize("kernel", KERNELS)
def test_laws_with_the_default_scale(kernel: type[Any]) -> None:
    assert isinstance(kernel(), Kernel)
    if kernel is not DCS:
        check_kernel(kernel())


@pytest.mark.parametrize("kernel", KERNELS)
@given(scale=st.floats(0.01, 100.0))
def test_laws_with_any_scale(kernel: type[Any], scale: float) -> None:
    check_kernel(kernel(scale))


def test_native_numbers() -> None:
    assert [kernel.native_id for kernel in KERNELS] == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("kernel", "s", "rho", "weight"),
    [
        (Huber(2.0), 9.0, 2 * 2 * 3 - 4, 2 / 3),
        (Huber(2.0), 4.0, 4.0, 1.0),
        (PseudoHuber(1.0), 8.0, 2 * (3 - 1), 1 / 3),
        (Cauchy(2.0), 4.0, 4 * np.log(2), 0.5),
        (GemanMcClure(1.0), 3.0, 0.75, 1 / 16),
        (Welsch(1.0), 2.0, 1 - np.exp(-2), np.exp(-2)),
        (Tukey(2.0), 1.0, 4 / 3 * (1 - 0.75**3), 0.75**2),
        (Tukey(2.0), 100.0, 4 / 3, 0.0),
        (DCS(1.0), 3.0, 2.0, 0.25),
        (DCS(5.0), 5.0, 5.0, 1.0),
    ],
    ids=str,
)
def test_values_by_hand(kernel: Kernel, s: float, rho: float, weight: float) -> None:
    np.testing.assert_allclose(kernel.rho(np.array([s])), [rho], rtol=1e-14)
    np.testing.assert_allclose(kernel.weight(np.array([s])), [weight], rtol=1e-14, atol=1e-300)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_a_scale_that_makes_no_sense_is_refused(kernel: type[Any], scale: float) -> None:
    with pytest.raises(InputError, match="scale must be positive"):
        kernel(scale)
