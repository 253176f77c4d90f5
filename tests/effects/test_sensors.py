"""Effects on the readings of an IMU, against numbers worked out by hand."""

import numpy as np
import pytest
from standins import FORCE, RATE, N, T, on

from edl_filter.effects import EffectInstance
from edl_filter.effects.registry import catalogue, find_effect


@pytest.mark.parametrize(
    ("name", "values", "force", "rate"),
    [
        ("accelerometer_bias", {"bx": 0.1, "bz": -0.2}, [-39.9, 2.0, -0.2], [0.2, 0.0, -0.1]),
        ("accelerometer_scale", {"sx": 0.01, "sy": -0.02}, [-40.4, 1.96, 0.0], [0.2, 0.0, -0.1]),
        # a quarter turn about z takes x to y and y to -x
        ("accelerometer_misalignment", {"mz": np.pi / 2.0}, [-2.0, -40.0, 0.0], [0.2, 0.0, -0.1]),
        ("gyro_bias", {"by": 1e-3}, [-40.0, 2.0, 0.0], [0.2, 1e-3, -0.1]),
        ("gyro_scale", {"sx": 0.05, "sz": 0.1}, [-40.0, 2.0, 0.0], [0.21, 0.0, -0.11]),
        # a constant is the same at any delay
        ("imu_time_offset", {"tau": 0.3}, [-40.0, 2.0, 0.0], [0.2, 0.0, -0.1]),
    ],
)
def test_readings(name, values, force, rate):
    effect, p = on(name, **values)
    read_force, read_rate = effect.imu(p, T, FORCE, RATE)
    np.testing.assert_allclose(read_force, np.tile(force, (N, 1)), atol=1e-13)
    np.testing.assert_allclose(read_rate, np.tile(rate, (N, 1)), atol=1e-13)


def test_a_delay_of_a_linear_rate_is_a_constant():
    """A rate that rises by 0.01 rad/s² is 0.003 rad/s lower 0.3 s before; intervals of 5 s, ends left out."""
    effect, p = on("imu_time_offset", tau=0.3)
    rate = np.outer(0.01 * (T - 2.5), [1.0, -1.0, 0.0])
    _, delayed = effect.imu(p, T, FORCE, rate)
    np.testing.assert_allclose((delayed - rate)[1:-1], np.tile([-0.003, 0.003, 0.0], (N - 2, 1)), atol=1e-13)


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if e.acts("imu") and n != "imu_time_offset"])
def test_corrected_is_the_inverse_of_imu(name):
    """In both orders, at three times the plausible sizes; a shift in time is its own case (`test_sensor_chain`)."""
    effect = find_effect(name)
    p = EffectInstance(
        effect, {q.name: 3.0 * q.sigma * s for q, s in zip(effect.sizes, (1, -1, 0.5), strict=True)}
    ).values
    rng = np.random.default_rng(3)
    force, rate = 40.0 * rng.normal(size=(N, 3)), 0.2 * rng.normal(size=(N, 3))
    assert not all(np.array_equal(a, b) for a, b in zip(effect.imu(p, T, force, rate), (force, rate), strict=True))
    for first, second in ((effect.imu, effect.corrected), (effect.corrected, effect.imu)):
        back_force, back_rate = second(p, T, *first(p, T, force, rate))
        np.testing.assert_allclose(back_force, force, atol=1e-12)
        np.testing.assert_allclose(back_rate, rate, atol=1e-14)


@pytest.mark.parametrize("axis", range(3))
def test_a_small_misalignment_is_a_cross_product(axis):
    """``R(m) f = f + m × f`` to first order: by central differences."""
    effect, step = find_effect("accelerometer_misalignment"), 1e-6
    name = f"m{'xyz'[axis]}"
    plus, minus = (effect.imu(on(effect.name, **{name: s})[1], T, FORCE, RATE)[0] for s in (step, -step))
    np.testing.assert_allclose((plus - minus) / (2.0 * step), np.cross(np.eye(3)[axis], FORCE), atol=1e-8)


def test_the_lever_arm_is_the_displacement():
    effect, p = on("imu_lever_arm", dx=0.1, dy=-0.2, dz=0.3)
    np.testing.assert_array_equal(effect.imu_position(p), [0.1, -0.2, 0.3])
