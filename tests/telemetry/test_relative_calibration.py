"""Calibration of one IMU against another: a simulated rigid body with known errors, and both rovers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.simulation import Scenario, simulate
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.record import ImuRecord
from edl_filter.telemetry.relative_calibration import relative_calibration

DT, FINE = 0.125, 25
REFERENCE, CHECKED = np.array([-0.38, -0.45, -0.25]), np.array([0.2, -0.17, 0.24])
TRUE = {
    "lever_arm": CHECKED - REFERENCE + [0.012, -0.006, 0.009],
    "rate_alignment": np.array([-3e-3, 4e-4, 5e-4]),
    "force_alignment": np.array([-3e-3, -7e-4, 2e-4]),
    "axial_scale": 1.2e-3,
    "force_bias": np.array([0.03, 0.01, -0.01]),
    "rate_bias": np.array([2e-6, 4e-5, -3e-5]),
    "delay": 4e-4,
}


#: Largest error of an estimate without noise, m and the like: what is left of the interpolation of samples of 0.125 s.
INTERPOLATION = 1e-4


def motion(t):
    """Rates, their derivative and specific force at the centre of mass of a spinning, oscillating body."""
    w, a = 2.0 * np.pi * 0.7, 0.12
    rate = np.stack((0.22 + 1e-4 * t, a * np.sin(w * t), a * np.cos(0.9 * w * t)), axis=-1)
    acceleration = np.stack((np.full_like(t, 1e-4), a * w * np.cos(w * t), -0.9 * a * w * np.sin(0.9 * w * t)), axis=-1)
    peak = 45.0 * np.exp(-(((t - 60.0) / 40.0) ** 2)) + 5.0
    force = np.stack((-peak, 0.4 * np.sin(w * t), 0.4 * np.cos(w * t)), axis=-1)
    return rate, acceleration, force


def record(name, rates, forces, position, count):
    return ImuRecord(
        name=name, time=DT * np.arange(1, count + 1), interval=np.full(count, DT), specific_force=forces,
        angular_rate=rates, position=np.tile(position, (count, 1)), force_noise=np.full(count, 3e-3),
        rate_noise=np.full(count, 6e-5), shared_rate_noise=np.zeros(count), coning_corrected=np.zeros(count, bool),
        sculling_corrected=np.zeros(count, bool), unit=np.zeros(count, int), units=(name,), source=np.zeros(count, int),
        sources=("flight",), errors=(SensorErrors(),),
    )  # fmt: skip


def means(values, count):
    return values.reshape(count, FINE, 3).mean(axis=1)


def coloured(rng, count, sigma):
    """First-order Gauss-Markov noise with a correlation of 0.8 from sample to sample."""
    x = sigma * rng.standard_normal((count, 3))
    for i in range(1, count):
        x[i] = 0.8 * x[i - 1] + 0.6 * x[i]
    return x


def two_records(seed=0, noise=1.0, count=1000):
    rng = np.random.default_rng(seed)
    t = DT / FINE * (np.arange(count * FINE) + 0.5)

    def read(time, place):
        rate, acceleration, force = motion(time)
        return rate, force + np.cross(acceleration, place) + np.cross(rate, np.cross(rate, place))

    rate, force = (means(x, count) for x in read(t, REFERENCE))
    reference = record("primary", rate, force, REFERENCE, count)
    rate, force = read(t - TRUE["delay"], REFERENCE + TRUE["lever_arm"])
    rate = rate + np.cross(rate, TRUE["rate_alignment"]) + TRUE["rate_bias"]
    force = force + np.cross(force, TRUE["force_alignment"]) + TRUE["force_bias"]
    force[:, 0] *= 1.0 + TRUE["axial_scale"]
    rate, force = means(rate, count), means(force, count)
    rate += noise * 6e-5 * rng.standard_normal((count, 3))
    force += noise * coloured(rng, count, 0.01)
    return reference, record("secondary", rate, force, CHECKED, count)


def test_the_errors_of_a_rigid_body_without_noise_come_back():
    estimate = relative_calibration(*two_records(noise=0.0), -np.inf, np.inf)
    scales = {"lever_arm": INTERPOLATION, "rate_alignment": 5e-6, "force_alignment": 2e-4, "axial_scale": 2e-5,
              "force_bias": 5e-4, "rate_bias": 1e-6, "delay": 1e-6}  # fmt: skip
    for name, true in TRUE.items():
        np.testing.assert_allclose(getattr(estimate, name), true, rtol=0.0, atol=scales[name], err_msg=name)
    np.testing.assert_allclose(estimate.stated_lever_arm, CHECKED - REFERENCE)


def test_the_sigmas_are_those_of_the_errors_also_with_coloured_noise():
    errors, count = [], 30
    for seed in range(count):
        estimate = relative_calibration(*two_records(seed), -np.inf, np.inf)
        normalised = ((getattr(estimate, n) - true) / getattr(estimate, f"{n}_sigma") for n, true in TRUE.items())
        errors.append(np.concatenate([np.atleast_1d(e) for e in normalised]))
    squares = np.sum(np.square(errors), axis=0)
    # a sigma from some 25 blocks is itself known to 14 %, so that the limits are those of Student's t: 1.09 times wider
    assert np.all(squares < 1.25 * chi2.isf(1e-4, count))
    assert np.all(squares > chi2.ppf(1e-4, count) / 1.25)


def test_a_gap_and_samples_that_are_no_readings_are_left_out():
    reference, checked = two_records(noise=0.0)
    force = checked.specific_force.copy()
    force[300:310] = np.nan
    turned = np.zeros(len(force), bool)
    turned[600:650] = True
    rate = checked.angular_rate + 0.1 * turned[:, None]
    estimate = relative_calibration(
        reference, replace(checked, specific_force=force, angular_rate=rate, coning_corrected=turned), 0.0, 125.0
    )
    assert estimate.samples < 1000 - 60
    np.testing.assert_allclose(estimate.lever_arm, TRUE["lever_arm"], atol=INTERPOLATION)


def test_positions_that_change_in_flight_are_those_of_each_sample():
    reference, checked = two_records(noise=0.0)
    shift = np.where(np.arange(1000)[:, None] < 500, [0.05, 0.0, 0.0], 0.0)
    rate, acceleration, _ = motion(reference.time - 0.5 * DT)
    moved = []
    for item in (reference, checked):
        arm = np.cross(acceleration, shift) + np.cross(rate, np.cross(rate, shift))
        moved.append(replace(item, position=item.position + shift, specific_force=item.specific_force + arm))
    estimate = relative_calibration(*moved, -np.inf, np.inf)
    np.testing.assert_allclose(estimate.lever_arm, TRUE["lever_arm"], atol=INTERPOLATION)


def test_too_few_common_samples_give_none():
    reference, checked = two_records(count=200)
    assert relative_calibration(reference, checked, 0.0, 10.0) is None
    assert relative_calibration(reference, replace(checked, coning_corrected=np.ones(200, bool)), 0.0, 25.0) is None


# --- the rovers -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "lever_arm"), [("spirit", (0.576, 0.270, 0.482)), ("opportunity", (0.573, 0.271, 0.482))]
)
def test_the_rovers_imus(request, name, lever_arm):
    """The lever arms of an independent regression of the two records; readings of one time, and the stated axes."""
    (estimate,) = request.getfixturevalue(name).calibrations.values()
    np.testing.assert_allclose(estimate.lever_arm, lever_arm, atol=2e-3)
    np.testing.assert_allclose(estimate.lever_arm, estimate.stated_lever_arm, atol=2e-3)
    assert abs(estimate.delay) < 4.0 * estimate.delay_sigma < 1e-4
    assert np.all(np.abs(np.degrees(estimate.rate_alignment)) < 0.005)
    assert np.all(estimate.rate_rms < 1.1 * np.sqrt(2.0) * 5.8e-5)


@pytest.mark.parametrize("axes", [[1], [0, 1, 2]])
def test_gyros_that_read_zero_leave_what_they_determine_unknown(axes):
    """Without a warning of numpy, as the other parameters stay known."""
    count = 1200
    rate, _, force = motion(DT * np.arange(count))
    rate[:, axes] = 0.0
    rng = np.random.default_rng(3)
    records = [
        record(name, rate, force + 3e-3 * rng.standard_normal(force.shape), place, count)
        for name, place in (("a", REFERENCE), ("b", CHECKED))
    ]
    estimate = relative_calibration(*records, -np.inf, np.inf)
    sigmas = estimate.rate_alignment_sigma, estimate.lever_arm_sigma, estimate.rate_bias_sigma
    assert np.isfinite(sigmas).all() and np.all(estimate.force_bias_sigma < 0.01)
    if len(axes) == 3:
        assert np.all(estimate.rate_alignment_sigma[1:] > 1e3) and np.all(estimate.lever_arm_sigma > 1e3)


@pytest.mark.parametrize(("seed", "offset"), [(1, -0.04), (2, 0.03), (3, 0.04)])
def test_the_lever_arm_is_within_its_sigmas_where_the_samples_do_not_resolve_the_motion(seed, offset, tmp_path):
    """An offset centre of mass: at 1.2 Hz and 8 Hz the interpolation errs in phase with the lever arm's acceleration.

    With one weight for all samples of an axis the errors are up to eight sigmas.
    """
    scenario = Scenario.load("builtin:mer", [f"effects=[{{name: com_offset, parameters: {{dz: {offset}}}}}]"])
    flight = simulate(scenario, seed=seed)
    telemetry = read_flight_file(flight.write(tmp_path / "flight.h5"))
    end = flight.motion.deployed - 1.0
    estimate = relative_calibration(telemetry.driving, telemetry.checking[0], -np.inf, end)
    assert np.max(np.abs(estimate.lever_arm - estimate.stated_lever_arm) / estimate.lever_arm_sigma) < 3.5
    assert np.max(estimate.lever_arm_sigma) < 1e-3 and abs(estimate.delay) < 3.5 * estimate.delay_sigma
