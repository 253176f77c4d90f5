"""Centre of mass, bias and misalignment: closed forms, injected errors, and the biases of the real flights."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.telemetry import calibration
from edl_filter.telemetry.record import ImuRecord

vectors = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


def record(name, time, interval, force, rate=None, position=None):
    n = len(time)
    return ImuRecord(
        name=name,
        time=np.asarray(time, float),
        interval=np.broadcast_to(np.asarray(interval, float), n).copy(),
        specific_force=np.asarray(force, float),
        angular_rate=np.zeros((n, 3)) if rate is None else rate,
        position=np.zeros((n, 3)) if position is None else np.broadcast_to(position, (n, 3)),
        force_noise=np.full(n, 0.003),
        rate_noise=np.full(n, 1e-5),
        shared_rate_noise=np.full(n, 1e-5),
        coning_corrected=np.zeros(n, bool),
        sculling_corrected=np.zeros(n, bool),
        unit=np.zeros(n, np.int64),
        units=("unit",),
        source=np.zeros(n, np.int64),
        sources=("simulated",),
        errors=(SensorErrors(),),
    )


def entry_force(time):
    """Axial pulse of an entry with small lateral oscillations."""
    axial = -57.0 * np.exp(-(((time - 121.0) / 45.0) ** 2))
    return np.stack((axial, 0.01 * axial * np.sin(2.1 * time), 0.01 * axial * np.cos(1.9 * time)), -1)


# --- centre of mass


@given(vectors, vectors, vectors, vectors)
def test_correction_is_the_rigid_body_formula(force, rate, acceleration, position):
    lever_arm_matrix = rotations.cross_matrix(acceleration) + np.linalg.matrix_power(rotations.cross_matrix(rate), 2)
    corrected = calibration.centre_of_mass_correction(
        force[None] + lever_arm_matrix @ position, rate[None], acceleration[None], position
    )
    np.testing.assert_allclose(corrected[0], force, atol=1e-13)


def test_correction_cancels_the_motion_of_a_sensor_on_a_rotating_body():
    # A body that rotates by exp(phi(t)) about a fixed centre: second difference of the sensor's path
    position, h = np.array([-0.3839, -0.2503, 0.4460]), 1e-4

    def path(t):
        return rotations.rotate(rotations.from_rotation_vector([0.21 * t + 0.05 * t**3, 0.0, 0.0]), position)

    t = 0.8
    inertial = (path(t + h) - 2 * path(t) + path(t - h)) / h**2
    body = rotations.rotate(rotations.from_rotation_vector([-0.21 * t - 0.05 * t**3, 0.0, 0.0]), inertial)
    rate, acceleration = [[0.21 + 0.15 * t**2, 0.0, 0.0]], [[0.3 * t, 0.0, 0.0]]
    np.testing.assert_allclose(
        calibration.centre_of_mass_correction(body[None], rate, acceleration, position), 0.0, atol=1e-7
    )


def test_record_at_the_centre_of_mass_has_zero_positions():
    time = 0.125 * np.arange(1, 9)
    rate = np.tile([0.21, 0.0, 0.0], (8, 1))
    # Constant spin: the lateral accelerometers measure -w^2 r
    force = np.tile([0.0, -(0.21**2) * 0.5, 0.0], (8, 1))
    transferred = calibration.at_centre_of_mass(
        record("backshell", time, 0.125, force, rate, (0.1, 0.5, 0.0)), np.zeros((8, 3))
    )
    np.testing.assert_allclose(transferred.specific_force, 0.0, atol=1e-16)
    np.testing.assert_array_equal(transferred.position, 0.0)
    np.testing.assert_array_equal(transferred.angular_rate, rate)


# --- bias


def test_bias_is_the_slope_of_a_linear_fit_to_the_velocity():
    rng = np.random.default_rng(4)
    interval = rng.choice([0.125, 0.25], 300)
    time = np.cumsum(interval) - 50.0
    force = rng.normal(0.004, 0.003, (300, 3))
    bias, sigma = calibration.bias_from_velocity_slope(time, interval, force, -100.0, 100.0)
    edges = np.concatenate(([-50.0], time))
    velocity = np.concatenate((np.zeros((1, 3)), np.cumsum(force * interval[:, None], axis=0)))
    np.testing.assert_allclose(bias, np.polyfit(edges, velocity, 1)[0], rtol=1e-10)
    assert np.all(sigma > 0.0)


def test_bias_sigma_is_consistent_and_tends_to_the_closed_form():
    # Slope of a random walk: variance 6/5 sigma^2 / N, larger than the fit's formal one
    rng = np.random.default_rng(5)
    n, trials = 400, 600
    time = 0.25 * np.arange(1, n + 1)
    force = rng.normal(0.002, 0.003, (n, trials))
    bias, sigma = calibration.bias_from_velocity_slope(time, np.full(n, 0.25), force, 0.0, 100.0)
    assert sigma.mean() == pytest.approx(np.sqrt(1.2 / n) * 0.003, rel=0.01)
    chi_square = np.sum(((bias - 0.002) / sigma) ** 2)
    assert abs(chi_square - trials) < 4.0 * np.sqrt(2.0 * trials)


def test_bias_uses_only_its_window():
    time = np.arange(1.0, 21.0)
    force = np.where(time > 10.0, 5.0, 0.25)
    bias, sigma = calibration.bias_from_velocity_slope(time, np.ones(20), force, 2.0, 10.0)
    assert bias == pytest.approx(0.25)
    assert sigma == pytest.approx(0.0, abs=1e-12)


def test_invalid_bias_window_raises():
    time, interval, force = np.arange(1.0, 11.0), np.ones(10), np.zeros((10, 3))
    with pytest.raises(InputError, match=r"window 8\.0 to 10\.0 s holds 2 samples; at least 3"):
        calibration.bias_from_velocity_slope(time, interval, force, 8.0, 10.0)
    with pytest.raises(InputError, match="holds NaN"):
        calibration.bias_from_velocity_slope(time, interval, np.full((10, 3), np.nan), 0.0, 10.0)
    with pytest.raises(InputError, match=r"has a gap after 5\.000 s"):
        calibration.bias_from_velocity_slope(time + 3.0 * (time > 5.0), interval, force, 0.0, 20.0)


@pytest.mark.parametrize(
    ("table", "entry", "expected"),
    [("2TRANSFORMED.TAB", 126462085.4, 0.00374), ("1TRANSFORMED.TAB", 128278194.3, -0.00392)],
    ids=["spirit", "opportunity"],
)
def test_axial_bias_of_the_real_backshell_units(mer_folder, table, entry, expected):
    # Facts file section 2: means over the 14 minutes before entry, archive's z axis (the body's x)
    rows = np.loadtxt(mer_folder / "DATA" / table, max_rows=3800)
    time, first = np.unique(rows[:, 0], return_index=True)
    axial = rows[first, 14]
    interval = np.diff(time, prepend=time[0] - 0.25)
    bias, sigma = calibration.bias_from_velocity_slope(time - entry, interval, axial, -850.0, -10.0)
    assert sigma == pytest.approx(np.sqrt(1.2 / 3360) * 0.003, rel=0.1)
    assert abs(bias - expected) < 3.0 * sigma


# --- misalignment


def test_misalignment_recovers_a_rotation_with_different_samplings_and_a_gap():
    rng = np.random.default_rng(6)
    fine, coarse = 0.125 * np.arange(1, 2041), 0.25 * np.arange(1, 1021)
    m = np.array([0.0, -2.0e-3, 5.0e-3])
    bias = np.array([0.0, 0.004, -0.003])
    truth = entry_force(fine - 0.0625)
    rover = rotations.rotate(rotations.from_rotation_vector(m), truth) + bias
    rover += rng.normal(0.0, 0.003, rover.shape)
    rover[1700:1707] = np.nan
    backshell = truth.reshape(-1, 2, 3).mean(axis=1) + rng.normal(0.0, 0.003, (1020, 3))
    result = calibration.misalignment(record("backshell", coarse, 0.25, backshell), record("rover", fine, 0.125, rover))
    fit = result.all
    np.testing.assert_allclose(fit.slope, [m[2], -m[1]], atol=5e-5)
    assert np.all(np.abs(fit.slope - [m[2], -m[1]]) < 4.0 * fit.slope_sigma)
    assert np.all(np.abs(fit.offset - bias[1:]) < 4.0 * fit.offset_sigma)
    assert (fit.start, fit.end) == (0.0, 250.0)
    assert fit.samples == sum(w.samples for w in result.windows)
    # 440 intervals of 0.25 s after 140 s, without the four that contain the seven missing samples
    assert [w.samples for w in result.windows] == [40, 436]
    # Ten seconds without load hardly determine an angle: the sigma is large
    assert np.all(result.windows[0].slope_sigma > 20.0 * result.windows[1].slope_sigma)


def test_projection_is_least_squares_with_consistent_sigmas():
    rng = np.random.default_rng(7)
    axial = -np.linspace(0.0, 50.0, 300)
    truth = np.array([0.1, -0.2]) + np.outer(axial, [0.005, -0.002])
    normalised_errors = []
    for _ in range(200):
        noise = rng.normal(0.0, 0.01, (300, 2))
        slope, sigma, offset, offset_sigma, rms = calibration.misalignment_by_projection(axial, truth + noise)
        normalised_errors.append(
            np.concatenate(((slope - [0.005, -0.002]) / sigma, (offset - [0.1, -0.2]) / offset_sigma))
        )
    assert np.std(normalised_errors) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(rms, 0.01, rtol=0.15)
    expected = np.linalg.lstsq(np.stack((axial, np.ones(300)), -1), truth + noise)
    np.testing.assert_allclose([slope, offset], expected[0], rtol=1e-9)


def test_sigma_is_enlarged_for_autocorrelated_residuals():
    rng = np.random.default_rng(8)
    axial = -np.linspace(0.0, 50.0, 500)
    normalised_errors = []
    for _ in range(200):
        noise = np.zeros((500, 2))
        innovation = rng.normal(0.0, 0.01, (500, 2))
        for i in range(1, 500):
            noise[i] = 0.8 * noise[i - 1] + innovation[i]
        slope, sigma, *_ = calibration.misalignment_by_projection(axial, noise)
        normalised_errors.append(slope / sigma)
    assert 0.8 < np.std(normalised_errors) < 1.3


def test_invalid_misalignment_input_raises():
    time = 0.25 * np.arange(1, 81)
    a = record("backshell", time, 0.25, entry_force(time))
    with pytest.raises(InputError, match="'rover' is not at the centre of mass"):
        calibration.misalignment(a, replace(a, name="rover", position=np.ones((80, 3))))
    with pytest.raises(InputError, match=r"window 140\.0 to 250\.0 s holds 0 common samples"):
        calibration.misalignment(a, a)
    with pytest.raises(InputError, match="at least one window"):
        calibration.misalignment(a, a, windows=())
    with pytest.raises(InputError, match="axial force does not vary"):
        calibration.misalignment_by_projection(np.ones(9), np.zeros((9, 2)))
    with pytest.raises(InputError, match="at least 4 common samples; there are 3"):
        calibration.misalignment_by_projection(np.ones(3), np.zeros((3, 2)))


def test_misalignment_of_a_record_with_itself_is_zero():
    time = 0.25 * np.arange(1, 1001)
    a = record("backshell", time, 0.25, entry_force(time))
    fit = calibration.misalignment(a, a).all
    np.testing.assert_allclose(fit.slope, 0.0, atol=1e-15)
    np.testing.assert_allclose(fit.residual_rms, 0.0, atol=1e-14)
