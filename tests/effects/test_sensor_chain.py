"""Sensor effects: their forms, their order, their inverses, and whose samples they change."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.effects import Effect, EffectInstance, Parameter
from edl_filter.effects.registry import find_effect
from edl_filter.effects.sensor_chain import (
    apply_sensor_effects,
    check_imus,
    corrected_record,
    effects_in,
    log_abs_det_jacobian,
    moved_position,
    moved_record,
    samples_of,
)
from edl_filter.effects.sensors import delayed
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.rotations import from_rotation_vector, rotate
from edl_filter.telemetry.record import ImuRecord, Telemetry

N, DT = 400, 0.125


def record(units=("primary",), name="primary"):
    time = DT * np.arange(1, N + 1)
    rng = np.random.default_rng(3)
    wave = np.sin(2 * np.pi * (0.4 * time[:, None] + rng.uniform(size=3)))
    return ImuRecord(
        name=name, time=time, interval=np.full(N, DT), specific_force=-40.0 + 10.0 * wave, angular_rate=0.2 * wave,
        position=np.zeros((N, 3)), force_noise=np.full(N, 1e-3), rate_noise=np.full(N, 1e-5),
        shared_rate_noise=np.zeros(N), coning_corrected=np.zeros(N, bool), sculling_corrected=np.zeros(N, bool),
        unit=np.arange(N) * len(units) // N, units=units, source=np.zeros(N, int), sources=("test",),
        errors=tuple(SensorErrors() for _ in units),
    )  # fmt: skip


def active(name, imu=None, **values):
    return EffectInstance(find_effect(name), values, imu)


small = st.floats(-0.05, 0.05)


def as_read(true, effects):
    """What sensors with `effects` read of the true motion in a record: the inverse of `corrected_record`."""
    force, rate = apply_sensor_effects(effects, true.time, true.specific_force, true.angular_rate)
    return replace(true, specific_force=force, angular_rate=rate)


SENSOR = {
    "accelerometer_bias": "b", "accelerometer_scale": "s", "accelerometer_misalignment": "m", "gyro_bias": "b",
    "gyro_scale": "s",
}  # fmt: skip


def test_misalignment_then_scale_then_bias_however_listed():
    listed = [
        active("accelerometer_bias", bx=0.1, bz=-0.2),
        active("accelerometer_scale", sx=0.01, sy=0.02),
        active("accelerometer_misalignment", mx=0.01, my=-0.02, mz=0.03),
    ]
    f = record().specific_force
    turned = rotate(from_rotation_vector([0.01, -0.02, 0.03]), f)
    expected = (1 + np.array([0.01, 0.02, 0.0])) * turned + [0.1, 0.0, -0.2]
    for order in (listed, listed[::-1]):
        np.testing.assert_allclose(as_read(record(), order).specific_force, expected, rtol=1e-14)


def test_effects_of_one_instrument_are_those_of_all_samples_of_its_record():
    """The simulation, which has no records yet, and the reconstruction find the same effects in an IMU."""
    effects = [active("gyro_bias", imu, bx=1.0) for imu in (None, "primary", "secondary", "other")]
    for name, driving in (("primary", True), ("secondary", False), ("third", True)):
        own = record((name,), name)
        expected = [a for a in effects if samples_of(own, a.imu, driving).all()]
        assert effects_in(effects, name, driving) == expected
        assert all(not samples_of(own, a.imu, driving).any() for a in effects if a not in expected)


def test_an_imu_is_moved_by_the_sum_of_its_displacements():
    """In a record of two instruments those of each act on its own samples; effects without a place move nothing."""
    joined = record(("backshell", "rover"), "driving")
    effects = [
        active("imu_lever_arm", dx=0.1), active("gyro_bias", bx=1.0), active("imu_lever_arm", "rover", dy=-0.2),
        active("imu_lever_arm", "driving", dz=0.3), active("imu_lever_arm", "other", dz=9.0),
    ]  # fmt: skip
    moved = moved_record(joined, effects, until=0.0).position
    first = joined.unit == 0
    np.testing.assert_array_equal(moved[first], np.tile([0.1, 0.0, 0.3], (first.sum(), 1)))
    np.testing.assert_array_equal(moved[~first], np.tile([0.0, -0.2, 0.3], ((~first).sum(), 1)))
    stated = np.ones((5, 3))
    np.testing.assert_allclose(moved_position(stated, effects[:3]), np.tile([1.1, 0.8, 1.0], (5, 1)), rtol=1e-15)
    assert moved_position(stated, effects[1:2]) is stated
    assert moved_record(joined, effects[1:2], until=0.0) is joined


@given(st.lists(st.tuples(st.sampled_from(sorted(SENSOR)), small, small, small), max_size=5))
def test_correction_undoes_what_the_sensors_did(entries):
    effects = [
        active(name, **dict(zip((SENSOR[name] + a for a in "xyz"), values, strict=True))) for name, *values in entries
    ]
    there_and_back = corrected_record(as_read(record(), effects), effects)
    np.testing.assert_allclose(there_and_back.specific_force, record().specific_force, rtol=1e-12)
    np.testing.assert_allclose(there_and_back.angular_rate, record().angular_rate, rtol=1e-11, atol=1e-13)


def test_delayed_means_are_those_of_the_earlier_signal():
    time = DT * np.arange(1, N + 1)

    def means(at):  # of cos(2 t) over each interval
        return np.tile(((np.sin(2 * at) - np.sin(2 * (at - DT))) / (2 * DT))[:, None], 3)

    inside = slice(10, -10)
    for delay in (0.03, 0.1, -0.2):
        np.testing.assert_allclose(delayed(time, means(time), delay)[inside], means(time - delay)[inside], atol=2e-5)


def test_time_offset_is_undone_by_its_opposite():
    late = [active("imu_time_offset", tau=0.1)]
    back = corrected_record(as_read(record(), late), late)
    np.testing.assert_allclose(back.angular_rate[5:-5], record().angular_rate[5:-5], atol=2e-4)
    np.testing.assert_array_equal(back.specific_force, record().specific_force)


def test_delay_holds_at_the_ends_and_keeps_what_is_unknown_unknown():
    mean = np.ones((20, 3)) * [1.0, 2.0, 3.0]
    time = DT * np.arange(1, 21)
    np.testing.assert_allclose(delayed(time, mean, 0.3), mean, rtol=1e-12)
    mean[7] = np.nan
    shifted = delayed(time, mean, 0.3)
    assert np.isnan(shifted[7]).all() and np.isfinite(np.delete(shifted, 7, axis=0)).all()


def test_an_effect_sits_in_one_instrument():
    joined = record(("backshell", "rover"), "driving")
    changed = {
        imu: corrected_record(joined, [active("gyro_bias", imu, bx=1.0)]).angular_rate[:, 0]
        != joined.angular_rate[:, 0]
        for imu in (None, "backshell", "rover", "driving", "other")
    }
    first = joined.unit == 0
    np.testing.assert_array_equal(changed[None], first)
    np.testing.assert_array_equal(changed["backshell"], first)
    np.testing.assert_array_equal(changed["rover"], ~first)
    assert changed["driving"].all() and not changed["other"].any()
    assert corrected_record(joined, [active("gyro_bias", bx=1.0)], driving=False) is joined


def test_an_unknown_imu_is_refused():
    telemetry = Telemetry(record(), (replace(record(), name="secondary", units=("secondary",)),))
    check_imus(telemetry, [active("gyro_bias", "secondary", bx=1.0)], "m.yaml")
    with pytest.raises(InputError, match=r"m.yaml: effects.0.imu: found 'third', .* accepted: primary, secondary"):
        check_imus(telemetry, [active("gyro_bias", "third", bx=1.0)], "m.yaml")


def test_the_default_inverse_converges():
    class Cubic(Effect):
        name = "cubic"
        parameters = (Parameter("k", "s^4/m^2", "cubic error", 1e-6),)

        def imu(self, p, time, force, rate):
            return force + p["k"] * force**3, rate

    effects = [EffectInstance(Cubic(), {"k": 1e-6})]
    back = corrected_record(as_read(record(), effects), effects)
    np.testing.assert_allclose(back.specific_force, record().specific_force, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("accelerometer_scale", {"sx": 0.01, "sy": -0.02, "sz": 0.0}, -np.log(1.01) - np.log(0.98)),
        ("gyro_scale", {"sx": 0.0, "sy": 0.0, "sz": 0.003}, -np.log(1.003)),
        ("accelerometer_misalignment", {"mx": 0.01, "my": 0.02, "mz": -0.01}, 0.0),
        ("gyro_bias", {"bx": 1e-3}, 0.0),
        ("imu_time_offset", {"tau": 0.07}, 0.0),
        ("mass", {"k": 0.1}, 0.0),
    ],
)
def test_log_jacobian_of_the_correction(name, values, expected):
    """Minus the log of the scale, and zero where readings are rotated, shifted or unchanged."""
    effect = find_effect(name)
    active = EffectInstance(effect, {q.name: 0.0 for q in effect.parameters} | values)
    assert log_abs_det_jacobian(record(), (active,)) == pytest.approx(expected, abs=2e-6)


def test_log_jacobian_of_an_effect_in_one_of_two_instruments():
    """The mean is over the samples that are asked for, each with the effects of its own instrument."""
    joined = record(("backshell", "rover"), "driving")
    effects = (active("accelerometer_scale", sx=0.01, sy=-0.02, sz=0.0),)
    expected = -np.log(1.01) - np.log(0.98)
    first, last, both = np.arange(N // 4), np.arange(3 * N // 4, N), np.arange(N)
    for samples, share in ((first, 1.0), (last, 0.0), (both, 0.5), (None, 0.5)):
        actual = log_abs_det_jacobian(joined, effects, samples=samples)
        assert actual == pytest.approx(share * expected, abs=2e-6)
