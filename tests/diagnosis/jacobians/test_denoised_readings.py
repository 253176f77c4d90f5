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


def test_a_coarse_triad_does_not_contain_its_neighbours():
    """A polynomial of fifth degree is reproduced, and the other triad keeps its neighbours."""
    t = 0.125 * np.arange(200)
    quintic = np.column_stack(((t - 10.0) ** 5, t**4, 1.0 - t))
    denoised = denoise(record_of(quintic, 0.125), 0.125, 1e3, ["force"])
    np.testing.assert_allclose(denoised.specific_force, quintic, atol=1e-9 * np.abs(quintic).max())
    spike = np.zeros((200, 3))
    spike[100] = 1.0
    denoised = denoise(record_of(spike, 0.125), 0.125, 1e3, ["force"])
    np.testing.assert_array_equal(np.flatnonzero(denoised.specific_force[:, 0]), [96, 97, 98, 102, 103, 104])
    np.testing.assert_array_equal(np.flatnonzero(denoised.angular_rate[:, 0]), [98, 99, 101, 102])


def test_a_scale_error_that_is_not_there_is_not_seen_in_coarse_readings():
    """Regression of an error that is carried on upon the denoised reading; with neighbours it is -4/3 of q²/12."""
    rng, q, count = np.random.default_rng(4), 0.08, 40000
    t = 0.125 * np.arange(count)
    frequency, phase = rng.uniform(0.1, 0.4, 20), rng.uniform(0.0, 6.0, 20)
    true = 0.06 * np.sin(2.0 * np.pi * t[:, None] * frequency + phase).sum(axis=1)
    counts = np.round(np.cumsum(true + 0.02 * rng.normal(size=count)) / q)
    read = np.repeat(q * np.diff(counts, prepend=0.0)[:, None], 3, axis=1)
    square, scales = np.mean(true**2), []
    for coarse in ((), ("force",)):
        column = denoise(record_of(read, 0.125), 0.125, 1e9, coarse).specific_force[10:-10, 0]
        scales.append(np.mean(column * (read[:, 0] - true)[10:-10]) / square)
    sigma = q / np.sqrt(6.0 * square * count)
    assert abs(scales[1]) < 5.0 * sigma
    assert scales[0] == pytest.approx(-(q**2) / 9.0 / square, abs=5.0 * sigma) and scales[0] < -20.0 * sigma
