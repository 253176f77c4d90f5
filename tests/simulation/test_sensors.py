"""Readings of an IMU, against fine sampling of the true motion and the form of its errors."""

import numpy as np
import pytest

from edl_filter import rotations
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.simulation.sensors import (
    Instrument,
    counted,
    delayed_rates,
    draw_errors,
    read,
    step_means,
    true_means,
)

ARM = np.array([0.3, -0.4, 0.5])
SIGMAS = SensorErrors(5e-4, 1e-4, 1e-4, 2e-6, 5e-5)


def felt(motion, time, arm, after=False):
    """Specific force at `arm` at steps' ends, from the derivatives: no integral in it."""
    slope = motion.before if after else motion.after
    rate, turning, force = motion.state[:, 10:13], slope[:, 10:13], slope[:, 13:16]
    w = rate[1:]
    return force + np.cross(turning, arm) + np.cross(w, np.cross(w, arm))


def test_means_over_steps_are_the_motions(mer_flight):
    """Means of neighbouring steps about a node are its value, to second order, where all runs smoothly."""
    m = mer_flight.motion
    force, rate = step_means(m, ARM)
    calm = slice(4000, 18000)
    expected = felt(m, m.time, ARM)[calm]
    middle = 0.5 * (force[:-1] + force[1:])[calm]
    np.testing.assert_allclose(middle, expected[: len(middle)], rtol=0.0, atol=5e-3)
    np.testing.assert_allclose(0.5 * (rate[:-1] + rate[1:])[calm], m.state[1:, 10:13][calm], rtol=0.0, atol=2e-4)


def test_means_add_up_to_the_velocity_gained(mer_flight):
    m = mer_flight.motion
    force, rate = step_means(m, np.zeros(3))
    h = m.time[1]
    np.testing.assert_allclose(force.sum(axis=0) * h, m.state[-1, 13:16], rtol=1e-9)
    np.testing.assert_allclose(rate.sum(axis=0) * h, m.state[-1, 16:19], rtol=1e-9)


def test_samples_are_means_of_steps_and_end_at_their_times(mer_flight):
    m = mer_flight.motion
    time, force, _ = true_means(m, ARM, 0.125, 0.0, ())
    assert time[0] == pytest.approx(0.125) and len(time) == (len(m.time) - 1) // 10
    np.testing.assert_allclose(force[700], step_means(m, ARM)[0][7000:7010].mean(axis=0), rtol=1e-12)


def test_a_delay_is_a_shift_of_the_integral(mer_flight):
    """A delay of whole steps gives the steps before; the catalogue's effect agrees."""
    m = mer_flight.motion
    rate = step_means(m, ARM)[1]
    np.testing.assert_allclose(delayed_rates(m, 0.05)[4:], rate[:-4], rtol=0.0, atol=1e-9)
    time, _, late = true_means(m, ARM, 0.125, 0.06, ())
    effect = EffectInstance(find_effect("imu_time_offset"), {"tau": 0.06})
    calm = (time > 5.0) & (time < m.deployed - 5.0)
    np.testing.assert_allclose(late[calm], true_means(m, ARM, 0.125, 0.0, (effect,))[2][calm], rtol=0.0, atol=1e-7)


def test_errors_act_in_their_order():
    """f_m = (1 + s) ∘ (R(m) f) + b, in body axes, then rotated to the instrument's."""
    random = np.random.default_rng(5)
    mounting = rotations.normalise([0.3, -0.2, 0.5, 0.7])
    instrument = Instrument(0.1, mounting, ARM, 0.0, 0.0, SIGMAS)
    errors = draw_errors(random, SensorErrors(0.1, 0.1, 0.1, 0.1, 0.1))
    force, rate, time = random.standard_normal((5, 3)), random.standard_normal((5, 3)), np.arange(1.0, 6.0)
    imu = read(random, instrument, errors, time, force, rate)
    r = rotations.to_matrix(rotations.from_rotation_vector(errors["accelerometer_misalignment"]))
    expected = (1.0 + errors["accelerometer_scale"]) * (force @ r.T) + errors["accelerometer_bias"]
    np.testing.assert_allclose(rotations.rotate(mounting, imu.specific_force), expected, atol=1e-12)
    expected = (1.0 + errors["gyro_scale"]) * rate + errors["gyro_bias"]
    np.testing.assert_allclose(rotations.rotate(mounting, imu.angular_rate), expected, atol=1e-12)


def test_noise_and_errors_have_their_sigmas():
    random = np.random.default_rng(6)
    instrument = Instrument(0.1, np.array([0.0, 0.0, 0.0, 1.0]), ARM, 3e-3, 2e-5, SIGMAS)
    none = {name: np.zeros(3) for name in vars(SIGMAS)}
    zeros = np.zeros((20000, 3))
    imu = read(random, instrument, none, np.arange(20000.0), zeros, zeros)
    np.testing.assert_allclose(imu.specific_force.std(axis=0), 3e-3, rtol=0.03)
    np.testing.assert_allclose(imu.angular_rate.std(axis=0), 2e-5, rtol=0.03)
    draws = [draw_errors(random, SIGMAS) for _ in range(2000)]
    for name, sigma in vars(SIGMAS).items():
        assert np.std([d[name] for d in draws]) == pytest.approx(sigma, rel=0.05)


def test_counts_lose_nothing():
    """Increments are whole counts, and their sum is never off by more than half a count."""
    mean = np.random.default_rng(7).standard_normal((500, 3))
    read_ = counted(mean, 0.1, 1e-3)
    counts = read_ * 0.1 / 1e-3
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(np.cumsum(read_ - mean, axis=0) * 0.1).max() <= 0.5e-3 + 1e-12
    assert counted(mean, 0.1, 0.0) is mean
