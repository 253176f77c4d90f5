"""Quiet records: the cubic comes back, and no sample keeps the noise of its own bin."""

import numpy as np
import pytest

from edl_filter.diagnosis.quiet import quiet
from edl_filter.telemetry.record import ImuRecord, SensorErrors


def record(values, interval=0.05, unit=None):
    count = len(values)
    zero, no = np.zeros(count), np.zeros(count, bool)
    return ImuRecord(
        "primary", interval * np.arange(1, count + 1), np.full(count, interval), values, values, np.zeros((count, 3)),
        zero, zero, zero, no, no, np.zeros(count, np.int64) if unit is None else unit, ("a", "b"),
        np.zeros(count, np.int64), ("made",), (SensorErrors(), SensorErrors()),
    )  # fmt: skip


@pytest.mark.parametrize(("interval", "length"), [(0.125, 0.125), (0.05, 0.1), (0.005, 0.1)])
def test_a_cubic_stays_what_it_is(interval, length):
    t = interval * np.arange(400)
    cubic = np.column_stack((t**3 - t, 2.0 * t**2, 5.0 + t))
    found = quiet(record(cubic, interval), length, 1e3).specific_force
    np.testing.assert_allclose(found, cubic, atol=1e-9 * np.abs(cubic).max())


@pytest.mark.parametrize("per_bin", [1, 2, 20])
def test_no_sample_keeps_the_noise_of_its_own_bin(per_bin):
    for k in range(100, 100 + per_bin):
        spike = np.zeros((400, 3))
        spike[k] = 1.0
        found = quiet(record(spike, 0.1 / per_bin), 0.1, 1e3).specific_force[:, 0]
        own = slice(k - k % per_bin, k - k % per_bin + per_bin)
        assert not found[own].any() and np.count_nonzero(found) == 4 and found.sum() == pytest.approx(1.0)


def test_where_samples_or_units_change_they_stay_as_they_were():
    noise = np.random.default_rng(0).normal(size=(60, 3))
    unit = np.repeat([0, 1], 30)
    found = quiet(record(noise, unit=unit), 0.1, 1e3).specific_force
    same = np.all(found == noise, axis=1)
    assert same[26:35].all() and same[:4].all() and same[-4:].all()
    assert not same[4:26].any() and not same[35:56].any()
    short = record(noise[:6])
    assert quiet(short, 0.1, 1e3) is short


def test_after_the_end_they_stay_as_they_were():
    noise = np.random.default_rng(0).normal(size=(60, 3))
    same = np.all(quiet(record(noise), 0.1, 2.0).specific_force == noise, axis=1)
    assert same[36:].all() and not same[4:36].any()  # 36 and its neighbours four further on end by 2 s: no longer
