"""Readings of a gyro integrated between any two moments."""

from __future__ import annotations

import numpy as np
import pytest

from clew.motion import GyroBuffer, TurnRates


def buffer_of(times: np.ndarray, rates: np.ndarray, batch: int = 7) -> GyroBuffer:
    buffer = GyroBuffer()
    for k in range(0, len(times), batch):
        buffer.add(TurnRates(times[k : k + batch], rates[k : k + batch]))
    return buffer


def turn(buffer: GyroBuffer, first: float, last: float) -> np.ndarray | None:
    heading = buffer.at(last)
    assert heading is not None
    return heading.since(buffer.at(first))


def test_turns_are_the_integral_of_rates_that_change_linearly() -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.004, 0.02, 500))
    rates = 0.5 * np.sin(times)
    buffer = buffer_of(times, rates)
    for first, last in ((times[3], times[10]), (0.5, 3.0), (times[20] + 1e-3, times[20] + 2e-3)):
        told = turn(buffer, first, last)
        assert told is not None
        fine = np.linspace(first, last, 20001)
        assert told[1] == pytest.approx(np.trapezoid(np.interp(fine, times, rates), fine), abs=1e-7)
        assert told[0] == pytest.approx(last - first)
    told = turn(buffer, 1.0, 2.5)
    assert told is not None
    assert told[2] == pytest.approx(0.5 * (np.sin(2.475) - np.sin(0.975)), abs=5e-3)  # over the last 50 ms


def test_the_last_rate_goes_on_for_a_moment_and_no_longer() -> None:
    buffer = buffer_of(np.arange(0.0, 1.0, 0.01), np.full(100, 0.3))
    told = turn(buffer, 0.5, 1.1)
    assert told is not None
    assert told[1] == pytest.approx(0.18)
    assert buffer.at(1.5) is None
    assert buffer.at(-0.1) is None
    assert GyroBuffer().at(0.0) is None


def test_nothing_is_told_across_a_gap() -> None:
    times = np.concatenate([np.arange(0.0, 1.0, 0.01), np.arange(2.0, 3.0, 0.01)])
    buffer = buffer_of(times, np.ones(200))
    assert turn(buffer, 0.5, 2.5) is None
    assert buffer.at(1.1) is None
    told = turn(buffer, 2.2, 2.7)
    assert told is not None
    assert told[1] == pytest.approx(0.5)


def test_readings_that_are_not_later_are_left_out() -> None:
    times = np.array([0.0, 0.1, 0.05, 0.1, 0.2])
    buffer = buffer_of(times, np.array([1.0, 1.0, 50.0, 50.0, 1.0]), batch=2)
    assert len(buffer) == 3
    told = turn(buffer, 0.0, 0.2)
    assert told is not None
    assert told[1] == pytest.approx(0.2)


def test_a_long_log_keeps_its_angle() -> None:
    times = np.arange(0.0, 200.0, 0.01)
    buffer = GyroBuffer()
    buffer.add(TurnRates(times[:50], np.ones(50)))
    early = buffer.at(0.3)
    for k in range(50, len(times), 50):
        buffer.add(TurnRates(times[k : k + 50], np.ones(50)))
    late = buffer.at(199.0)
    assert late is not None
    told = late.since(early)
    assert told is not None
    assert told[1] == pytest.approx(198.7)
