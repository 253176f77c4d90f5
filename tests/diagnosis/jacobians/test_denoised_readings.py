"""Denoised readings: a cubic is reproduced, and no sample contains the noise of its own bin."""

import numpy as np
import pytest

from edl_filter.diagnosis.jacobians.denoised_readings import denoise
from edl_filter.telemetry.record import ImuRecord, SensorErrors


def record_of(values, interval=0.05, unit=None):
    """A record whose forces and rates are `values` ``(N, 3)``."""
    count = len(values)
    zero, no = np.zeros(count), np.zeros(count, bool)
    return ImuRecord(
        "primary", interval * np.arange(1, count + 1), np.full(count, interval), values, values, np.zeros((count, 3)),
        zero, zero, zero, no, no, np.zeros(count, np.int64) if unit is None else unit, ("a", "b"),
        np.zeros(count, np.int64), ("simulated",), (SensorErrors(), SensorErrors()),
    )  # fmt: skip


@pytest.mark.parametrize(("interval", "length"), [(0.125, 0.125), (0.05, 0.1), (0.005, 0.1)])
def test_a_cubic_is_reproduced(interval, length):
    t = interval * np.arange(400)
    cubic = np.column_stack((t**3 - t, 2.0 * t**2, 5.0 + t))
    denoised = denoise(record_of(cubic, interval), length, 1e3)
    for values in (denoised.specific_force, denoised.angular_rate):
        np.testing.assert_allclose(values, cubic, atol=1e-9 * np.abs(cubic).max())


@pytest.mark.parametrize("per_bin", [1, 2, 20])
def test_no_sample_contains_the_noise_of_its_own_bin(per_bin):
    for k in range(100, 100 + per_bin):
        spike = np.zeros((400, 3))
        spike[k] = 1.0
        denoised = denoise(record_of(spike, 0.1 / per_bin), 0.1, 1e3).specific_force[:, 0]
        own_bin = slice(k - k % per_bin, k - k % per_bin + per_bin)
        assert not denoised[own_bin].any()
        assert np.count_nonzero(denoised) == 4 and denoised.sum() == pytest.approx(1.0)


def test_readings_near_a_change_of_instrument_are_not_changed():
    noise = np.random.default_rng(0).normal(size=(60, 3))
    unit = np.repeat([0, 1], 30)
    denoised = denoise(record_of(noise, unit=unit), 0.1, 1e3).specific_force
    unchanged = np.all(denoised == noise, axis=1)
    assert unchanged[26:35].all() and unchanged[:4].all() and unchanged[-4:].all()
    assert not unchanged[4:26].any() and not unchanged[35:56].any()
    short = record_of(noise[:6])
    assert denoise(short, 0.1, 1e3) is short


def test_readings_after_the_end_are_not_changed():
    """Nor those whose interpolation would need a later one: of sample 36 a neighbour ends after 2 s."""
    noise = np.random.default_rng(0).normal(size=(60, 3))
    unchanged = np.all(denoise(record_of(noise), 0.1, 2.0).specific_force == noise, axis=1)
    assert unchanged[36:].all() and not unchanged[4:36].any()
