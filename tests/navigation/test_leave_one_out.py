"""What all others say of one constraint, against reasoning that needs no filter."""

import numpy as np
import pytest

from edl_filter.navigation.constraints import Altimeter, LandingSite
from edl_filter.navigation.filter import Settings, forward, forward_without, pose
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.leave_one_out import statements, take_out
from edl_filter.navigation.smoother import smooth
from edl_filter.planet import Planet
from edl_filter.telemetry.record import InitialState, SensorErrors

# A planet without gravity or rotation and a vehicle that drifts: everything is linear
PLANET = Planet("none", 1e-20, 0.0, 1.0, 3.4e6, 0.0, 1e-30, 0.0)
POSITION, VELOCITY = np.array([3.4e6, 0.0, 0.0]), np.array([-10.0, 3.0, 0.0])


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
        net_turn=np.zeros(n, bool),
        unit=np.zeros(n, int),
    )


def problem(*constraints, sigma_position=100.0, sigma_velocity=1.0):
    covariance = np.diag([sigma_position**2] * 3 + [sigma_velocity**2] * 3 + [1e-8] * 3)
    initial = InitialState(0.0, POSITION, VELOCITY, np.array([0.0, 0.0, 0.0, 1.0]), covariance)
    return pose(samples(), initial, EntryErrors(), (SensorErrors(),), constraints, PLANET, Settings())


def site(time, shift, sigma):
    truth = POSITION + VELOCITY * time
    return LandingSite(time, truth + shift, sigma**2 * np.eye(3), PLANET)


def height(time, shift, sigma=5.0):
    return Altimeter(time, float((POSITION + VELOCITY * time)[0]) + shift, sigma, 0.0)


def test_a_left_out_fix_is_predicted_by_a_run_without_it():
    early, late = height(10.0, 30.0), site(40.0, np.array([0.0, 50.0, -20.0]), 30.0)
    both, one = problem(early, late), problem(late)
    found = {s.name: s for s in statements(both, forward(both))}
    way = forward(one)
    state = smooth(way)
    k = int(np.argmin(np.abs(state.time - 10.0)))
    predicted = state.states[k].nav[0]
    assert found["altimeter"].left_out[0] == pytest.approx(early.height - predicted, abs=0.01)  # |r| is not quite x
    sigma = np.sqrt(state.covariance[k][0, 0] + early.sigma**2)
    assert found["altimeter"].left_out_sigma[0] == pytest.approx(sigma, rel=1e-4)


def test_going_on_from_the_epoch_before_equals_starting_again():
    constraints = height(10.0, 30.0), height(20.0, 10.0), site(40.0, np.zeros(3), 30.0)
    all_of_them, others = problem(*constraints), problem(constraints[2])
    quick = forward_without(all_of_them, forward(all_of_them), "altimeter")
    slow = forward(others)
    np.testing.assert_allclose(quick.nodes[-1].state.nav, slow.nodes[-1].state.nav, rtol=0, atol=1e-6)
    np.testing.assert_allclose(quick.nodes[-1].covariance, slow.nodes[-1].covariance, rtol=1e-6, atol=1e-12)
    assert [f.constraint.name for f in quick.fused] == ["landing"]


def test_a_wrong_statement_stands_out_only_against_the_others():
    wrong = height(30.0, 400.0)
    p = problem(height(10.0, 0.0), wrong, site(40.0, np.zeros(3), 10.0), sigma_position=1000.0)
    # both heights share a name; give the wrong one its own
    object.__setattr__(wrong, "name", "wrong")
    found = {s.name: s for s in statements(p, forward(p))}
    assert found["wrong"].left_out_sigmas > 10.0


def test_many_epochs_are_summed_up_by_their_mean():
    p = problem(*(height(t, 20.0) for t in np.arange(5.0, 45.0, 5.0)))
    s = statements(p, forward(p))[0]
    assert len(s.time) == 8 and s.dof == 8
    assert s.left_out[0] == pytest.approx(20.0, abs=0.01)
    assert s.left_out_sigma[0] > 100.0  # the entry state is all that is left to predict them
    low, high = s.nis_interval()
    assert low < 8.0 < high


def test_take_out_undoes_a_kalman_update():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 4, 4))
    prior, noise = a @ a.T + np.eye(4), b @ b.T + np.eye(4)
    innovation = rng.normal(size=4)
    gain = prior @ np.linalg.inv(prior + noise)
    left, sigma, nis, dof = take_out(innovation - gain @ innovation, prior - gain @ prior, noise)
    np.testing.assert_allclose(left, innovation, rtol=1e-9)
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(prior + noise)), rtol=1e-9)
    assert nis == pytest.approx(innovation @ np.linalg.solve(prior + noise, innovation))
    assert dof == 4


def test_a_direction_of_which_nothing_else_is_known_does_not_count():
    noise = np.eye(2)
    covariance = np.diag([1.0, 0.5])  # along the first, the measurement is all there is
    left, sigma, _, dof = take_out(np.array([0.0, 0.3]), covariance, noise)
    assert dof == 1 and np.isinf(sigma[0]) and left[0] == 0.0
    assert left[1] == pytest.approx(0.6)
