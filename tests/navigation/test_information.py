"""Information gains against closed forms: position and velocity of a drifting vehicle, and a batch estimate of them."""

from functools import partialmethod

import numpy as np
import pytest

from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation.constraints import LandingSite
from edl_filter.navigation.filter import Settings, build_problem, run_filter, run_filter_without
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.information import mutual_information
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.leave_one_out import (
    LEAST_EXPLAINED,
    check_constraints,
    check_entry_state,
    information_of_prior,
)
from edl_filter.navigation.smoother import smooth
from edl_filter.planet import Planet
from edl_filter.telemetry.record import InitialState

# A planet without gravity or rotation: everything is linear, and the axes are independent
PLANET = Planet("none", 1e-20, 0.0, 1.0, 3.4e6, 0.0, 1e-30, 0.0)
POSITION, VELOCITY = np.array([3.4e6, 0.0, 0.0]), np.array([-10.0, 3.0, 0.0])
PRIOR = np.diag([100.0**2, 1.0])  # of position (m) and velocity (m/s), each axis


class Beacon(LandingSite):
    """The same measurement under another name."""

    name = "beacon"


@pytest.fixture(params=["ukf", "ekf"], autouse=True)
def method(request, monkeypatch):
    """Every test runs with both filters."""
    monkeypatch.setattr(Settings, "__init__", partialmethod(Settings.__init__, method=request.param))


def samples(n=400, dt=0.125):
    zero, quiet = np.zeros((n, 3)), np.full(n, 1e-9)
    return Samples(
        time=dt * np.arange(1, n + 1), interval=np.full(n, dt), force=zero, rate=zero, mean_force=zero, mean_rate=zero,
        force_noise=quiet, rate_noise=quiet, shared_rate_noise=quiet, coning_corrected=np.zeros(n, bool),
        unit=np.zeros(n, int),
    )  # fmt: skip


def problem(*constraints):
    covariance = np.diag([PRIOR[0, 0]] * 3 + [PRIOR[1, 1]] * 3 + [1e-8] * 3)
    initial = InitialState(0.0, POSITION, VELOCITY, np.array([0.0, 0.0, 0.0, 1.0]), covariance)
    return build_problem(samples(), initial, EntryErrors(), (SensorErrors(),), constraints, PLANET, Settings())


def fix(kind, time, sigma, shift=0.0):
    return kind(time, POSITION + VELOCITY * time + shift, sigma**2 * np.eye(3), PLANET)


FIXES = ((Beacon, 10.0, 80.0), (LandingSite, 20.0, 30.0), (Beacon, 30.0, 40.0), (Beacon, 45.0, 50.0))


def posterior(fixes):
    """Covariance (2, 2) of one axis' position and velocity at time 0, by a batch estimate."""
    information = np.linalg.inv(PRIOR)
    for _, time, sigma in fixes:
        row = np.array([[1.0, time]]) / sigma
        information = information + row.T @ row
    return np.linalg.inv(information)


def fall(before, after):
    """Half the fall of the logarithm of the determinant, three axes together."""
    return 1.5 * (np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1])


def checks_of(*constraints):
    p = problem(*constraints)
    filter_pass = run_filter(p)
    return p, filter_pass, {s.name: s for s in check_constraints(p, filter_pass)}


def test_one_number_gains_as_a_channel_of_its_signal_to_noise_ratio():
    assert mutual_information(np.array([[9.0]]), np.array([[4.0]])) == pytest.approx(0.5 * np.log(1.0 + 9.0 / 4.0))


def test_directions_of_the_prediction_add_up_and_negative_variances_count_as_zero():
    """A rounding error of the covariance is no loss of information."""
    prediction, noise = np.diag([0.5, 8.0, -0.25]), np.diag([1.0, 4.0, 1.0])
    assert mutual_information(prediction, noise) == pytest.approx(0.5 * np.log(1.5 * 3.0))


def test_mutual_information_is_the_fall_of_the_determinant_in_a_kalman_update():
    rng = np.random.default_rng(3)
    a, b, h = rng.normal(size=(4, 4)), rng.normal(size=(2, 2)), rng.normal(size=(2, 4))
    prior, noise = a @ a.T, b @ b.T + np.eye(2)
    prediction = h @ prior @ h.T
    after = prior - prior @ h.T @ np.linalg.solve(prediction + noise, h @ prior)
    expected = 0.5 * (np.linalg.slogdet(prior)[1] - np.linalg.slogdet(after)[1])
    assert mutual_information(prediction, noise) == pytest.approx(expected, rel=1e-9)


def test_gains_in_order_are_those_of_the_batch_estimate_and_sum_to_all_information():
    _, _, checks = checks_of(*(fix(*f) for f in FIXES))
    expected = [fall(posterior(FIXES[:k]), posterior(FIXES[: k + 1])) for k in range(len(FIXES))]
    np.testing.assert_allclose(checks["beacon"].information, np.take(expected, [0, 2, 3]), rtol=1e-5)
    np.testing.assert_allclose(checks["landing"].information, expected[1:2], rtol=1e-5)
    total = sum(s.information.sum() for s in checks.values())
    assert total == pytest.approx(fall(PRIOR, posterior(FIXES)), rel=1e-5)


@pytest.mark.parametrize("name", ["beacon", "landing"])
def test_the_gain_beyond_all_others_is_what_the_estimate_loses_without_the_constraint(name):
    p, filter_pass, checks = checks_of(*(fix(*f) for f in FIXES))
    remaining_fixes = [f for f in FIXES if f[0].name != name]
    gain = checks[name].left_out_information
    assert gain == pytest.approx(fall(posterior(remaining_fixes), posterior(FIXES)), rel=1e-5)
    # without process noise the states at all times have the same information: at the entry and at the end
    without = run_filter_without(p, filter_pass, name)
    for k in (0, -1):
        all_used, lacking = smooth(filter_pass).covariance[k], smooth(without).covariance[k]
        loss = 0.5 * (np.linalg.slogdet(lacking)[1] - np.linalg.slogdet(all_used)[1])
        assert gain == pytest.approx(loss, rel=1e-4)


def test_measurements_up_to_the_end_of_the_pass_gain_beyond_all_others_too():
    fixes = ((Beacon, 10.0, 80.0), (LandingSite, 30.0, 30.0), (Beacon, 50.0, 40.0))
    _, _, checks = checks_of(*(fix(*f) for f in fixes))
    assert samples().time[-1] == 50.0
    for name in ("beacon", "landing"):
        remaining = [f for f in fixes if f[0].name != name]
        assert checks[name].left_out_information == pytest.approx(
            fall(posterior(remaining), posterior(fixes)), rel=1e-5
        )


def test_repeating_a_measurement_gains_little_beyond_the_first():
    first, second = fix(LandingSite, 20.0, 1.0), fix(Beacon, 20.0, 1.0)
    _, _, checks = checks_of(first, second)
    assert checks["landing"].information[0] == pytest.approx(3 * 0.5 * np.log(1.0 + 100.0**2 + 20.0**2), rel=1e-5)
    assert checks["beacon"].information[0] == pytest.approx(1.5 * np.log(2.0), rel=1e-3)
    assert checks["landing"].left_out_information == pytest.approx(1.5 * np.log(2.0), rel=1e-3)


def test_a_rejected_measurement_gains_nothing():
    _, _, checks = checks_of(fix(LandingSite, 20.0, 30.0), fix(Beacon, 30.0, 10.0, shift=1e4))
    assert not checks["beacon"].accepted[0]
    assert checks["beacon"].information[0] == 0.0 and checks["beacon"].left_out_information == 0.0


def test_the_entry_state_gains_what_the_estimate_loses_without_it():
    smoothed = smooth(run_filter(problem(*(fix(*f) for f in FIXES))))
    prior = problem().initial.covariance[:6, :6]
    alone = np.linalg.inv(np.linalg.inv(posterior(FIXES)) - np.linalg.inv(PRIOR))  # from the fixes only
    gain = information_of_prior(smoothed.covariance[0][:6, :6], prior)
    assert gain == pytest.approx(fall(alone, posterior(FIXES)), rel=1e-4)
    check = check_entry_state(smoothed, problem().initial.covariance, np.zeros(9))
    # nothing but the entry state determines the attitude: each axis counts with the bound
    assert check.left_out_information == pytest.approx(gain - 1.5 * np.log(LEAST_EXPLAINED), rel=1e-6)
    assert np.isnan(check.information).all()


def test_a_more_exact_measurement_gains_more():
    loose = checks_of(fix(LandingSite, 20.0, 30.0), fix(Beacon, 30.0, 40.0))[2]["beacon"]
    tight = checks_of(fix(LandingSite, 20.0, 30.0), fix(Beacon, 30.0, 4.0))[2]["beacon"]
    assert tight.left_out_information > loose.left_out_information + 1.0
