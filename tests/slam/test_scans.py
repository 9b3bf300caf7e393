"""What is kept of scans and of decided closures, in little memory."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from clew.place import Closure, Verdict
from clew.scan import LaserScan
from clew.slam.closure_log import ClosureLog
from clew.slam.scans import ScanStore


def scan(k: int) -> LaserScan:
    return LaserScan(float(k), np.full(5, 1.0 + 0.001 * k), -1.0, 0.5, 0.1, 30.0, np.zeros(3), np.ones(5))


def test_every_scan_has_a_row_and_ranges_are_kept_in_single_precision() -> None:
    store = ScanStore(most=10)
    for k in range(6):
        store.add(scan(k), k // 3, np.array([k, 0.0, 0.0]), None if k < 2 else np.array([0.0, k, 0.0]),
                  np.zeros(3))
    assert len(store) == 6
    np.testing.assert_array_equal(store.keyframes, [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(store.T_keyframe_robot[:, 0], np.arange(6))
    np.testing.assert_array_equal(store.T_odom_robot[:, 1], np.arange(2, 6))
    numbers, scans = store.kept()
    np.testing.assert_array_equal(numbers, np.arange(6))
    assert scans[4].ranges.dtype == np.float32
    assert scans[4].intensities is None
    np.testing.assert_allclose(scans[4].ranges, 1.004, rtol=1e-7)


def test_of_a_robot_that_stands_only_some_scans_are_kept_evenly() -> None:
    store = ScanStore(most=16)
    for k in range(1000):
        store.add(scan(k), 0, np.zeros(3), None, np.zeros(3))
        assert len(store.kept()[0]) <= 16
    numbers, _ = store.kept()
    assert len(numbers) >= 8
    assert len(np.unique(np.diff(numbers))) == 1
    assert numbers[0] == 0
    assert numbers[-1] >= 900
    store.add(scan(1000), 1, np.zeros(3), None, np.zeros(3))
    store.add(scan(1001), 1, np.zeros(3), None, np.zeros(3))
    np.testing.assert_array_equal(store.kept()[0][-2:], [1000, 1001])  # the next keyframe begins anew


def test_scans_go_with_their_keyframe_and_their_rows_stay() -> None:
    store = ScanStore(most=4)
    for k in range(9):
        store.add(scan(k), k // 3, np.zeros(3), None, np.zeros(3))
    store.forget(1)
    store.forget(77)
    np.testing.assert_array_equal(store.kept()[0], [0, 1, 2, 6, 7, 8])
    assert len(store) == len(store.timestamps) == 9


def closure(source: int, verdict: Verdict) -> Closure:
    rng = np.random.default_rng(source)
    return Closure(source, source // 2, 0.5, verdict, rng.standard_normal(3), rng.standard_normal((3, 3)), 0.25, 0.75,
                   innovation=(0.5, 0.125), T_predicted=rng.standard_normal(3))  # fmt: skip


def same(a: Closure, b: Closure) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in fields(Closure)]
    return all(type(x) is type(y) and np.array_equal(x, y, equal_nan=isinstance(x, np.ndarray)) for x, y in pairs)


def test_closures_come_back_as_they_were() -> None:
    log = ClosureLog()
    assert list(log) == []
    given = [closure(k, verdict) for k, verdict in enumerate(Verdict)]
    log.add(given)
    assert len(log) == len(given)
    assert all(same(a, b) for a, b in zip(log, given, strict=True))
    assert not same(given[0], given[1])
    log.forget(3)
    assert [c.source for c in log] == [c.source for c in given if c.source != 3]
