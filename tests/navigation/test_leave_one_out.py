"""Residuals against all other constraints, compared with closed forms and with runs without the constraint."""

from functools import partialmethod

import numpy as np
import pytest
from left_out import left_out_sigmas
from scipy import stats

from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.navigation import leave_one_out as module
from edl_filter.navigation.constraints import Altimeter, LandingSite
from edl_filter.navigation.filter import Settings, build_problem, run_filter, run_filter_without
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.leave_one_out import (
    LEAST_EXPLAINED,
    check_constraints,
    check_entry_state,
    information_of_prior,
    remove_measurement,
)
from edl_filter.navigation.smoother import smooth
from edl_filter.planet import Planet
from edl_filter.telemetry.record import InitialState

# A planet without gravity or rotation and a vehicle that drifts: everything is linear
PLANET = Planet("none", 1e-20, 0.0, 1.0, 3.4e6, 0.0, 1e-30, 0.0)
POSITION, VELOCITY = np.array([3.4e6, 0.0, 0.0]), np.array([-10.0, 3.0, 0.0])


@pytest.fixture(params=["ukf", "ekf"], autouse=True)
def method(request, monkeypatch):
    """Every test runs with both filters."""
    monkeypatch.setattr(Settings, "__init__", partialmethod(Settings.__init__, method=request.param))


def samples(n=400, dt=0.125, noise=0.01):
    zero = np.zeros((n, 3))
    return Samples(
        time=dt * np.arange(1, n + 1),
        interval=np.full(n, dt),
        force=zero,
        rate=zero,
        mean_force=zero,
        mean_rate=zero,
        force_noise=np.full(n, noise),
        rate_noise=np.full(n, 1e-6),
        shared_rate_noise=np.full(n, 1e-6),
        coning_corrected=np.zeros(n, bool),
        unit=np.zeros(n, int),
    )


def problem(*constraints, sigma_position=100.0, sigma_velocity=1.0):
    covariance = np.diag([sigma_position**2] * 3 + [sigma_velocity**2] * 3 + [1e-8] * 3)
    initial = InitialState(0.0, POSITION, VELOCITY, np.array([0.0, 0.0, 0.0, 1.0]), covariance)
    return build_problem(samples(), initial, EntryErrors(), (SensorErrors(),), constraints, PLANET, Settings())


def site(time, shift, sigma):
    truth = POSITION + VELOCITY * time
    return LandingSite(time, truth + shift, sigma**2 * np.eye(3), PLANET)


def height(time, shift, sigma=5.0):
    return Altimeter(time, float((POSITION + VELOCITY * time)[0]) + shift, sigma, 0.0)


def test_a_left_out_fix_is_predicted_by_a_run_without_it():
    early, late = height(10.0, 30.0), site(40.0, np.array([0.0, 50.0, -20.0]), 30.0)
    both, without = problem(early, late), problem(late)
    checks = {s.name: s for s in check_constraints(both, run_filter(both))}
    filter_pass = run_filter(without)
    state = smooth(filter_pass)
    k = int(np.argmin(np.abs(state.time - 10.0)))
    predicted = state.states[k].nav[0]
    assert checks["altimeter"].left_out[0] == pytest.approx(early.height - predicted, abs=0.01)  # |r| is not quite x
    sigma = np.sqrt(state.covariance[k][0, 0] + early.sigma**2)
    assert checks["altimeter"].left_out_sigma[0] == pytest.approx(sigma, rel=1e-4)


def test_a_constraint_without_which_the_covariance_is_singular_has_no_residual(monkeypatch):
    """The run with all constraints stays, and the checks of the others."""
    both = problem(height(10.0, 30.0), site(40.0, np.zeros(3), 30.0))
    filter_pass, complete = run_filter(both), module.run_filter_without
    expected = {c.name: c for c in check_constraints(both, filter_pass)}

    def run(given, given_pass, name):
        if name == "landing":
            raise np.linalg.LinAlgError
        return complete(given, given_pass, name)

    monkeypatch.setattr(module, "run_filter_without", run)
    checks = {c.name: c for c in check_constraints(both, filter_pass)}
    landing = checks["landing"]
    assert np.isnan(landing.left_out).all() and len(landing.left_out) == 3 and np.isinf(landing.left_out_sigma).all()
    assert np.isnan([landing.left_out_nis, landing.left_out_information]).all()
    np.testing.assert_array_equal(landing.nis, expected["landing"].nis)
    assert checks["altimeter"].left_out_nis == expected["altimeter"].left_out_nis


def test_running_on_from_the_epoch_before_equals_starting_again():
    constraints = height(10.0, 30.0), height(20.0, 10.0), site(40.0, np.zeros(3), 30.0)
    complete, remaining = problem(*constraints), problem(constraints[2])
    quick = run_filter_without(complete, run_filter(complete), "altimeter")
    slow = run_filter(remaining)
    np.testing.assert_allclose(quick.nodes[-1].state.nav, slow.nodes[-1].state.nav, rtol=0, atol=1e-6)
    np.testing.assert_allclose(quick.nodes[-1].covariance, slow.nodes[-1].covariance, rtol=1e-6, atol=1e-12)
    assert [f.constraint.name for f in quick.fused] == ["landing"]


def test_a_wrong_measurement_has_a_large_residual_against_the_others():
    wrong = height(30.0, 400.0)
    p = problem(height(10.0, 0.0), wrong, site(40.0, np.zeros(3), 10.0), sigma_position=1000.0)
    # both heights share a name; the wrong one gets its own
    object.__setattr__(wrong, "name", "wrong")
    checks = {s.name: s for s in check_constraints(p, run_filter(p))}
    assert left_out_sigmas(checks["wrong"]) > 10.0


def test_many_epochs_are_summarised_by_their_mean():
    p = problem(*(height(t, 20.0) for t in np.arange(5.0, 45.0, 5.0)))
    s = check_constraints(p, run_filter(p))[0]
    assert len(s.time) == 8 and s.dof == 8
    assert s.left_out[0] == pytest.approx(20.0, abs=0.01)
    assert s.left_out_sigma[0] > 100.0  # only the entry state remains to predict them
    low, high = s.nis_interval()
    assert low < 8.0 < high


def test_the_variance_of_a_mean_is_that_of_the_prediction_and_a_share_of_the_noise():
    """Predictions of one constant are fully correlated; the noise of eight readings is not."""
    p = problem(*(height(t, 20.0, sigma=90.0) for t in np.arange(5.0, 45.0, 5.0)), site(44.0, np.zeros(3), 20.0))
    filter_pass = run_filter(p)
    s = next(c for c in check_constraints(p, filter_pass) if c.name == "altimeter")
    others = smooth(run_filter_without(p, filter_pass, "altimeter"))
    sigma = [np.sqrt(c[0, 0]) for t, c in zip(others.time, others.covariance, strict=True) if t in s.time]
    assert len(sigma) == 8
    assert s.left_out_sigma[0] ** 2 == pytest.approx(np.mean(sigma) ** 2 + 90.0**2 / 8, rel=1e-4)
    assert s.left_out_nis == pytest.approx(s.left_out[0] ** 2 / s.left_out_sigma[0] ** 2)


def test_intervals_have_equal_tails():
    p = problem(*(height(t, 20.0) for t in np.arange(5.0, 45.0, 5.0)))
    s = check_constraints(p, run_filter(p))[0]
    for probability in (0.5, 0.99):
        tails = [0.5 * (1.0 - probability), 0.5 * (1.0 + probability)]
        assert s.nis_interval(probability) == pytest.approx(stats.chi2.ppf(tails, 8), rel=1e-9)
        assert s.left_out_nis_interval(probability) == pytest.approx(stats.chi2.ppf(tails, 1), rel=1e-9)


def test_removing_a_measurement_undoes_a_kalman_update():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 4, 4))
    prior, noise = a @ a.T + np.eye(4), b @ b.T + np.eye(4)
    innovation = rng.normal(size=4)
    gain = prior @ np.linalg.inv(prior + noise)
    residual, sigma, nis, dof = remove_measurement(innovation - gain @ innovation, prior - gain @ prior, noise)
    np.testing.assert_allclose(residual, innovation, rtol=1e-9)
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(prior + noise)), rtol=1e-9)
    assert nis == pytest.approx(innovation @ np.linalg.solve(prior + noise, innovation))
    assert dof == 4


def test_a_direction_that_nothing_else_determines_does_not_count():
    noise = np.eye(2)
    covariance = np.diag([1.0, 0.5])  # along the first axis only the measurement contributes
    residual, sigma, _, dof = remove_measurement(np.array([0.0, 0.3]), covariance, noise)
    assert dof == 1 and np.isinf(sigma[0]) and residual[0] == 0.0
    assert residual[1] == pytest.approx(0.6)


@pytest.mark.parametrize(("share", "infinite"), [(0.4, False), (0.6, True)])
def test_a_component_mostly_in_undetermined_directions_has_an_infinite_sigma(share, infinite):
    """A direction that only the measurement determines has a share of the component's variance."""
    direction = np.array([np.sqrt(share), np.sqrt(1.0 - share)])
    scale = np.array([3.0, 0.2])
    noise = np.diag(scale**2)
    whitened = np.eye(2) - 0.5 * (np.eye(2) - np.outer(direction, direction))  # the other direction: by half
    _, sigma, _, dof = remove_measurement(np.zeros(2), whitened * np.outer(scale, scale), noise)
    assert dof == 1
    assert np.isinf(sigma).tolist() == [infinite, not infinite]


def test_the_information_of_a_prior_is_that_of_the_determinants():
    """``½ ln det(P + R) / det R`` with the covariance P from the measurements and S from both."""
    rng = np.random.default_rng(7)
    a, b = rng.normal(size=(2, 4, 4))
    measured, prior = a @ a.T + np.eye(4), b @ b.T + np.eye(4)
    both = np.linalg.inv(np.linalg.inv(measured) + np.linalg.inv(prior))
    expected = 0.5 * np.log(np.linalg.det(measured + prior) / np.linalg.det(prior))
    assert information_of_prior(both, prior) == pytest.approx(expected, rel=1e-9)
    assert information_of_prior(prior, prior) == pytest.approx(-2.0 * np.log(LEAST_EXPLAINED))


def test_the_entry_state_is_a_constraint_against_everything_else():
    """Sites before, at and after determine position and velocity, and nothing but the entry state the attitude."""
    sites = [site(t, np.zeros(3), 20.0) for t in (1.0, 20.0, 40.0)]
    p = problem(*sites)
    smoothed = smooth(run_filter(p))
    prior = p.initial.covariance
    stated = np.concatenate((POSITION, VELOCITY)) - smoothed.states[0].nav[:6]
    check = check_entry_state(smoothed, prior, np.concatenate((stated, np.zeros(3))))
    vague = smooth(run_filter(problem(*sites, sigma_position=1e5, sigma_velocity=1e3)))
    expected = np.concatenate((POSITION, VELOCITY)) - vague.states[0].nav[:6]
    sigma = np.sqrt(np.diag(vague.covariance[0])[:6] + np.diag(prior)[:6])
    np.testing.assert_allclose(check.left_out[:6], expected, atol=1e-3 * sigma.min())
    np.testing.assert_allclose(check.left_out_sigma[:6], sigma, rtol=1e-3)
    assert np.isinf(check.left_out_sigma[6:]).all() and check.left_out_dof == check.dof == 6
    assert check.components[0] == "position x (m)" and check.components[-1] == "attitude z (rad)"
    np.testing.assert_array_equal(check.innovation_sigma[0], np.sqrt(np.diag(prior)))
    assert check.time.tolist() == [0.0] and check.accepted.tolist() == [True]


def test_a_rejected_reading_is_no_part_of_the_mean():
    """One altimeter reading that is 3 km off, which the filter rejects."""
    times = np.arange(5.0, 45.0, 5.0)
    good = [height(t, 20.0) for t in times]
    bad = [height(t, 3000.0 if t == 25.0 else 20.0) for t in times]
    p = problem(*bad)
    check = check_constraints(p, run_filter(p))[0]
    assert list(check.accepted) == [t != 25.0 for t in times]
    q = problem(*(h for h in good if h.time != 25.0))
    expected = check_constraints(q, run_filter(q))[0]
    np.testing.assert_allclose(check.left_out, expected.left_out, atol=1e-6)
    np.testing.assert_allclose(check.left_out_sigma, expected.left_out_sigma, rtol=1e-6)
