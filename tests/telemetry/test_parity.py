"""Parity of two IMUs: its variance is that of the errors that are stated, and constant errors are not in it."""

from dataclasses import replace

import numpy as np
import pytest

from edl_filter.effects.sensors import delayed
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.parity import pair_of, parity_of, variances

END = 251.75


@pytest.fixture(scope="module")
def telemetry(builtin_flight):
    return read_flight_file(builtin_flight)


def test_the_variance_of_the_parity_is_that_of_random_errors(telemetry):
    """Biases, scale errors and misalignments of both IMUs are drawn with their stated sigmas, and the noise."""
    random = np.random.default_rng(0)
    records = [
        replace(r, errors=(SensorErrors(0.02, 2e-3, 5e-3, 1e-4, 3e-3),))
        for r in (telemetry.driving, telemetry.checking[0])
    ]
    pair = pair_of(*records, END)
    rows, draws = slice(800, 1200, 50), 20000  # high deceleration
    for triad, own in (("force", pair.force), ("rate", pair.rate)):
        values, expected = own[rows], sum(variances(pair, triad, own))[rows]
        difference = np.zeros((draws, *values.shape))
        for record in records:
            e = record.errors[0]
            sigmas = (
                (record.force_noise[0], e.accelerometer_bias, e.accelerometer_scale, e.accelerometer_misalignment)
                if triad == "force"
                else (record.rate_noise[0], e.gyro_bias, e.gyro_scale, e.gyro_scale)
            )
            noise_sigma, bias, scale, misalignment = sigmas
            matrix = misalignment * random.standard_normal((draws, 3, 3))
            matrix[:, range(3), range(3)] = scale * random.standard_normal((draws, 3))
            difference += np.einsum("dij,nj->dni", matrix, values)
            difference += bias * random.standard_normal((draws, 1, 3))
            difference += noise_sigma * random.standard_normal(difference.shape)
        if triad == "force":
            expected = expected - pair.arm_error[rows, None] ** 2
        np.testing.assert_allclose(difference.var(axis=0), expected, rtol=6.0 * np.sqrt(2.0 / draws))


@pytest.mark.parametrize("delay", [-0.06, 0.004])
def test_the_delay_is_within_its_sigmas_and_no_constant_error_is_left(delay, telemetry):
    first, second = telemetry.driving, telemetry.checking[0]
    late = delayed(second.time, 1.01 * second.angular_rate + 1e-3, delay)
    pair = pair_of(first, replace(second, angular_rate=late), END)
    parity = parity_of(pair, "rate", pair.usable, 0.0)
    assert abs(parity.delay - delay) < max(5.0 * parity.delay_sigma, 2e-4) and parity.delay_sigma < 1e-3
    assert np.sqrt(np.nanmean(parity.square[pair.usable]) / 3.0) < 1.2


@pytest.mark.parametrize("triad", ["force", "rate"])
def test_readings_with_much_noise_do_not_change_the_constant_errors(triad, telemetry):
    """A scale error of 1 % that is within their stated noise, about the peak of the deceleration."""
    reading, noise = ("specific_force", "force_noise") if triad == "force" else ("angular_rate", "rate_noise")
    first, second = telemetry.driving, telemetry.checking[0]
    values, sigma, rows = getattr(second, reading).copy(), getattr(second, noise).copy(), slice(800, 1200)
    values[rows] *= 1.01
    sigma[rows] = 1e3 * sigma[rows]
    changed = replace(second, **{reading: values, noise: sigma})
    sound, parity = (
        parity_of(pair, triad, pair.usable, 0.0) for pair in (pair_of(first, r, END) for r in (second, changed))
    )
    outside = np.isfinite(sound.square)
    outside[795:1205] = False
    difference = (parity.value - sound.value)[outside] / np.sqrt(sound.noise[outside])
    assert np.max(np.abs(difference)) < 2.0  # of the fewer samples; 40 to 78 if all have one weight
