"""The run through the epochs: cutting, gating, changing the instrument, leaving out."""

from dataclasses import replace
from functools import partialmethod

import numpy as np
import pytest
import twins

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.mission.estimation import FilterConfig
from edl_filter.navigation.compiled_ukf import CompiledUKF
from edl_filter.navigation.constraints import Altimeter, LandingSite, OnboardAttitude, RestVelocity
from edl_filter.navigation.ekf import ErrorStateEKF
from edl_filter.navigation.filter import (
    EntryErrors,
    Fused,
    Settings,
    _check_position_sigma,
    build_problem,
    merge,
    new_filter,
    quantile,
    run_filter,
    run_filter_without,
    unit_change,
)
from edl_filter.navigation.initial import initial_estimate
from edl_filter.navigation.robust import measurement_weight
from edl_filter.navigation.smoother import smooth
from edl_filter.navigation.ukf import ErrorStateUKF
from edl_filter.telemetry.record import InitialState

FIRST = SensorErrors(accelerometer_bias=0.02, gyro_bias=1e-3)
SECOND = SensorErrors(accelerometer_bias=0.05, gyro_bias=3e-3)
POSITION, VELOCITY = np.array([3.4e6, 1e5, -2e5]), np.array([-300.0, 900.0, 100.0])
ATTITUDE = rotations.normalise([0.2, -0.1, 0.3, 0.9])


@pytest.fixture(params=["ukf", "ekf"], autouse=True)
def method(request, monkeypatch):
    """Every test runs with both filters."""
    monkeypatch.setattr(Settings, "__init__", partialmethod(Settings.__init__, method=request.param))


def drive(count=80, unit=None, start=0.0, seed=0):
    rng = np.random.default_rng(seed)
    return twins.samples(
        np.full(count, 0.125),
        np.array([-20.0, 1.0, -2.0]) + rng.standard_normal((count, 3)),
        [0.3, 0.1, -0.2] + 0.1 * rng.standard_normal((count, 3)),
        force_noise=0.1,
        rate_noise=2e-3,
        shared=2e-3,
        unit=unit,
        start=start,
    )


def initial(time=0.0):
    sigma = np.repeat([100.0, 2.0, 0.01], 3)
    return InitialState(time, POSITION, VELOCITY, ATTITUDE, np.diag(sigma**2))


def build(constraints=(), samples=None, entry=None, instruments=(FIRST,), settings=None, **more):
    return build_problem(
        drive() if samples is None else samples,
        more.pop("start", initial()),
        entry or EntryErrors(),
        instruments,
        list(constraints),
        twins.MARS,
        settings or Settings(longest_interval=2.0),
        **more,
    )


def height(time, value=0.0, sigma=30.0):
    return Altimeter(time, value, sigma, float(np.linalg.norm(POSITION)))


def velocity_at_rest(time, sigma=1e4):
    return RestVelocity(time, sigma, twins.MARS)


def same(a, b):
    """Assert that two nodes are equal to rounding."""
    np.testing.assert_allclose(a.state.nav, b.state.nav, rtol=1e-12)
    np.testing.assert_allclose(a.state.errors, b.state.errors, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-9, atol=1e-15)
    assert a.time == b.time
    assert a.unit == b.unit


# Putting together


def test_samples_are_cut_where_a_constraint_is():
    problem = build([height(3.2), height(7.77)], times=(5.05,))
    edges = np.append(0.0, problem.samples.time)
    for t in (3.2, 7.77, 5.05):
        assert np.min(np.abs(edges - t)) < 1e-12
        assert np.min(np.abs(problem.epochs - t)) < 1e-12
    assert np.sum(problem.samples.interval) == pytest.approx(10.0)


def test_the_state_at_a_constraint_is_that_of_its_own_time():
    """Between samples too: the altimeter is compared with the height at its time, not at the next sample's end."""
    problem = build([height(3.2, sigma=1e9)])
    filter_pass = run_filter(problem)
    fused = filter_pass.fused[0]
    nav = np.concatenate((POSITION, VELOCITY, ATTITUDE))
    s = drive()
    maps = np.concatenate((np.eye(3).ravel(), np.zeros(3))), np.array([1.0, 1, 1, 0, 0, 0])
    p = twins.MARS
    step = np.append(np.full(25, 0.125), 0.075)
    nav = twins.propagate(nav, *maps, step, s.force[:26], s.rate[:26], p.mu, p.j2, p.gravity_radius)
    expected = np.linalg.norm(nav[:3]) - np.linalg.norm(POSITION)
    assert -fused.innovation.residual[0] == pytest.approx(expected, abs=0.1)  # a sample is 40 m
    assert filter_pass.nodes[fused.node].time == pytest.approx(3.2)


def test_epochs_begin_and_end_with_the_flight_and_are_close_together():
    problem = build([height(3.2)], settings=Settings(longest_interval=1.0))
    assert problem.epochs[0] == 0.0
    assert problem.epochs[-1] == problem.samples.time[-1]
    assert np.all(np.diff(problem.epochs) > 0.0)
    assert np.max(np.diff(problem.epochs)) < 1.5


def test_the_regular_epochs_are_ends_of_samples_that_are_far_from_stated_times():
    """At most every 0.8 s, and none within a quarter of that of a stated time."""
    epochs = build([height(3.375), height(5.65)], settings=Settings(longest_interval=0.8)).epochs
    regular = np.floor(np.arange(0.0, 10.0, 0.8) / 0.125) * 0.125
    stated = np.array([0.0, 3.375, 5.65, 10.0])
    far = [t for t in regular if np.min(np.abs(t - stated)) > 0.2]
    assert 3.125 in far and 5.5 not in far and 5.5 in regular  # 0.25 s and 0.15 s from a constraint
    np.testing.assert_allclose(epochs, np.sort([*stated, *far]), atol=1e-12)


def test_samples_of_unequal_length_begin_with_the_first():
    samples = twins.samples(np.array([0.3, *[0.125] * 40]), np.zeros((41, 3)), np.zeros((41, 3)), 0.1, 2e-3)
    problem = build(samples=samples)
    assert problem.epochs[0] == 0.0
    assert problem.samples.edges[0] == pytest.approx(0.0, abs=1e-12)


def test_a_constraint_may_be_at_the_end():
    filter_pass = run_filter(build([height(10.0)]))
    assert filter_pass.nodes[filter_pass.fused[0].node].time == pytest.approx(10.0)


def test_the_settings_are_those_of_a_mission_without_a_statement():
    stated = FilterConfig()
    names = ("alpha", "beta", "kappa", "gate_probability", "robust", "engine")
    settings = Settings()
    assert [getattr(settings, n) for n in names] == [getattr(stated, n) for n in names]
    assert settings.longest_interval == stated.longest_interval_s


def test_the_filter_is_that_of_the_settings():
    classes = {"ekf": ErrorStateEKF, "compiled": CompiledUKF, "filterpy": ErrorStateUKF}
    for settings, expected in (
        (Settings(method="ekf"), "ekf"),
        (Settings(method="ukf"), "compiled"),
        (Settings(method="ukf", engine="compiled"), "compiled"),
        (Settings(method="ukf", engine="filterpy"), "filterpy"),
    ):
        problem = build(settings=settings)
        state, covariance = initial_estimate(problem.layout, problem.initial, problem.entry, FIRST, problem.planet)
        assert type(new_filter(problem, state, covariance)) is classes[expected]


def test_the_first_node_has_no_transition():
    filter_pass = run_filter(build())
    assert filter_pass.nodes[0].transition is None
    assert all(node.transition is not None for node in filter_pass.nodes[1:])
    assert filter_pass.converged  # nothing was iterated


def test_constraints_are_used_in_the_order_of_time():
    filter_pass = run_filter(build([height(7.0), velocity_at_rest(2.0), height(4.0)]))
    assert [f.constraint.time for f in filter_pass.fused] == [2.0, 4.0, 7.0]
    assert [filter_pass.nodes[f.node].time for f in filter_pass.fused] == [2.0, 4.0, 7.0]


def test_a_start_inside_the_telemetry_drops_the_samples_before_it():
    problem = build(start=initial(4.06))
    assert problem.samples.time[0] - problem.samples.interval[0] == pytest.approx(4.06)
    assert run_filter(problem).nodes[0].time == 4.06


@pytest.mark.parametrize("time", [-0.5, 10.5])
def test_a_constraint_outside_the_telemetry_is_named(time):
    with pytest.raises(InputError) as error:
        build([height(time)])
    assert str(error.value) == (
        f"constraints.altimeter: its time {time:g} s is outside the reconstruction, 0 to 10 s; remove the constraint, "
        "or read telemetry that contains its time."
    )


@pytest.mark.parametrize("time", [-0.5, 10.0, 12.0])
def test_a_start_outside_the_telemetry_is_named(time):
    with pytest.raises(InputError) as error:
        build(start=initial(time))
    assert str(error.value) == f"initial_state: its time {time:g} s is outside the telemetry, 0 to 10 s."


def test_a_position_that_is_lost_is_refused():
    samples = drive()
    samples = replace(samples, force_fill_sigma=np.full((len(samples.time), 3), 1e7))
    with pytest.raises(InputError, match=r"^At \d+\.\d{3} s the position has a sigma of .* m, more than the planet"):
        run_filter(build(samples=samples))


def test_a_position_is_lost_from_the_planets_radius_on():
    """One sigma of its length, whatever its direction."""
    problem = build()
    variance = np.array([0.5, 0.2, 0.3]) * twins.MARS.equatorial_radius**2
    for factor, axes in ((0.999, range(3)), (1.001, range(3)), (0.999, (2, 0, 1)), (1.001, (2, 0, 1))):
        covariance = np.diag(np.concatenate((factor * variance[list(axes)], np.full(6, 1e30))))
        if factor < 1.0:
            _check_position_sigma(problem, 2.0, covariance)
            continue
        with pytest.raises(InputError, match=r"^At 2\.000 s the position has a sigma of 3\.4e\+06 m, more than"):
            _check_position_sigma(problem, 2.0, covariance)
    with pytest.raises(InputError, match="sigma of nan m"):
        _check_position_sigma(problem, 2.0, np.full((9, 9), np.nan))


def test_further_times_outside_are_ignored():
    assert build(times=(-3.0, 44.0)).epochs[-1] == 10.0


def test_merging_takes_near_times_as_equal():
    np.testing.assert_array_equal(merge(np.array([3.0, 1.0, 1.0 + 1e-6, 3.0, 2.0])), [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(merge(np.array([1.0, 1.0 + 3e-6])), [1.0, 1.0 + 3e-6])


def test_two_constraints_within_a_microsecond_share_an_epoch():
    filter_pass = run_filter(build([height(3.0), height(3.0 + 5e-7)]))
    assert [f.node for f in filter_pass.fused] == [filter_pass.fused[0].node] * 2


# Gate


def test_times_at_the_end_of_one_sample_are_one_epoch():
    """Either may be a microsecond from it, so that they are two apart; a transition has samples of its own."""
    problem = build(times=(2.0 - 0.9e-6, 2.0 + 0.9e-6))
    index = problem.samples.indices(problem.epochs)
    assert np.all(np.diff(index) > 0) and np.sum(np.abs(problem.epochs - 2.0) < 2e-6) == 1


def test_an_outlier_is_not_accepted_and_changes_nothing():
    good, late = height(4.0, -1000.0, 300.0), height(8.0, -2000.0, 300.0)
    bad = LandingSite(6.0, np.array([0.0, 0.0, 3.4e6]), 100.0**2 * np.eye(3), twins.MARS)
    filter_pass, without = run_filter(build([good, bad, late])), run_filter(build([good, late], times=(6.0,)))
    assert [f.accepted for f in filter_pass.fused] == [True, False, True]
    assert filter_pass.fused[1].innovation.nis > 1e4
    assert len(filter_pass.nodes) == len(without.nodes)
    for a, b in zip(filter_pass.nodes, without.nodes, strict=True):
        same(a, b)


def test_the_gate_is_a_quantile_of_chi_square():
    assert quantile(0.99999, 1) == pytest.approx(19.511, abs=1e-3)  # 4.417 sigmas
    assert quantile(0.95, 3) == pytest.approx(7.8147, abs=1e-4)
    first = run_filter(build([height(4.0, sigma=1.0)])).fused[0].innovation
    sigma = np.sqrt(first.predicted_covariance[0, 0] + 1.0)
    predicted = -first.residual[0]
    for sigmas, accepted in ((4.41, True), (4.43, False), (-4.41, True), (-4.43, False)):
        fused = run_filter(build([height(4.0, predicted + sigmas * sigma, 1.0)])).fused[0]
        assert fused.accepted is accepted
        assert fused.innovation.nis == pytest.approx(sigmas**2, rel=1e-6)


def test_a_robust_update_has_the_weight_of_its_innovation():
    """Of an accepted reading with more noise than its prediction; one beyond the gate has none."""
    settings = Settings(longest_interval=2.0, robust="huber")
    first = run_filter(build([height(4.0, sigma=300.0)], settings=settings)).fused[0].innovation
    sigma = np.sqrt(first.predicted_covariance[0, 0] + 300.0**2)
    near, far, outlier = (
        run_filter(build([height(4.0, k * sigma - first.residual[0], 300.0)], settings=settings)).fused[0]
        for k in (0.01, 4.0, 30.0)
    )
    assert (near.accepted, far.accepted, outlier.accepted) == (True, True, False)
    assert near.weight == outlier.weight == 1.0
    assert far.weight == measurement_weight(far.innovation, "huber") < 0.5
    np.testing.assert_allclose(far.noise_covariance, [[300.0**2 / far.weight]], rtol=1e-12)


def test_a_reading_has_its_stated_noise_unless_it_has_a_weight():
    fused = run_filter(build([height(4.0, sigma=7.0)])).fused[0]
    without = Fused(fused.constraint, fused.node, fused.innovation, fused.accepted)
    np.testing.assert_allclose(without.noise_covariance, [[49.0]])


# Change of the instrument


def changing(onboard=False, constraints=()):
    unit = (np.arange(80) >= 40).astype(int)
    entry = EntryErrors(onboard_attitude=ATTITUDE, onboard_sigma=1e-4) if onboard else EntryErrors()
    return build(
        constraints, drive(unit=unit), entry, instruments=(FIRST, SECOND), unit_change_sigma=4e-3 if onboard else 0.0
    )


def test_another_instrument_has_its_own_errors():
    constraints = [height(3.0, -900.0, 1.0), velocity_at_rest(4.0, 900.0)]
    filter_pass = run_filter(changing(constraints=constraints))
    k = next(i for i, n in enumerate(filter_pass.nodes) if n.unit == 1)
    before, after = filter_pass.nodes[k - 1], filter_pass.nodes[k]
    assert (before.time, after.time) == (5.0, 5.0)
    sensor = filter_pass.layout.sensor
    assert np.all(before.state.errors[sensor] != 0.0)  # the first instrument's errors were estimated
    assert not after.state.errors[sensor].any()
    expected = np.diag(np.repeat([0.05**2, 3e-3**2], 3))
    np.testing.assert_allclose(after.covariance[sensor, sensor], expected)
    np.testing.assert_allclose(after.covariance[:9, sensor], 0.0, atol=1e-15)
    np.testing.assert_array_equal(after.state.nav, before.state.nav)
    np.testing.assert_allclose(after.covariance[:9, :9], before.covariance[:9, :9])
    assert {n.unit for n in filter_pass.nodes[k:]} == {1}


def test_the_instrument_of_the_first_sample_drives_first():
    problem = build(samples=drive(unit=(np.arange(80) == 0).astype(int)), instruments=(FIRST, SECOND))
    nodes = run_filter(problem).nodes
    assert [n.unit for n in nodes[:2]] == [1, 1]
    assert {n.unit for n in nodes[2:]} == {0}
    sensor = problem.layout.sensor
    np.testing.assert_allclose(np.diag(nodes[0].covariance)[sensor], np.repeat([0.05**2, 3e-3**2], 3))


def test_all_errors_of_an_instrument_start_anew_with_another_one():
    """Its own, and the rates and the mounting that the on-board computation used; the attitude itself is stepped."""
    entry = EntryErrors(onboard_attitude=ATTITUDE, onboard_rate_sigma=2e-4, onboard_mounting_sigma=5e-3)
    problem = build(entry=entry, instruments=(FIRST, SECOND), unit_change_sigma=4e-3)
    layout = problem.layout
    before = np.arange(1.0, layout.size + 1.0)
    matrix, noise, errors = unit_change(problem, 1, before)
    sigma, kept = np.zeros(layout.size), np.ones(layout.size)
    sigma[layout.sensor] = np.repeat([0.05, 3e-3], 3)
    kept[layout.sensor] = 0.0
    for name, value in (("onboard_rate", 2e-4), ("onboard_mounting", 5e-3)):
        sigma[layout[name]], kept[layout[name]] = value, 0.0
    sigma[layout["onboard_attitude"]] = 4e-3
    np.testing.assert_array_equal(matrix, np.diag(kept))
    np.testing.assert_allclose(noise, np.diag(sigma**2), rtol=1e-12)
    np.testing.assert_array_equal(errors, kept * before)
    np.testing.assert_array_equal(before, np.arange(1.0, layout.size + 1.0))


def test_onboard_attitudes_of_two_instruments_are_the_same_without_a_statement():
    unit = (np.arange(80) >= 40).astype(int)
    entry = EntryErrors(onboard_attitude=ATTITUDE, onboard_sigma=1e-4)
    nodes = run_filter(build((), drive(unit=unit), entry, (FIRST, SECOND))).nodes
    k = next(i for i, n in enumerate(nodes) if n.unit == 1)
    np.testing.assert_allclose(nodes[k].covariance[-3:, -3:], nodes[k - 1].covariance[-3:, -3:], rtol=1e-12)


def test_the_smoother_passes_a_change_of_the_instrument():
    """Navigation states have one smoothed value at the change; the sensor errors have one for each instrument."""
    dead = run_filter(changing(constraints=[height(3.0, sigma=1e6), height(9.0, sigma=1e6)]))
    heights = [f.innovation.residual[0] for f in dead.fused]  # zero minus the prediction
    filter_pass = run_filter(
        changing(constraints=[height(3.0, 100.0 - heights[0], 1.0), height(9.0, 85.0 - heights[1], 1.0)])
    )
    assert all(f.accepted for f in filter_pass.fused)
    smoothed = smooth(filter_pass)
    k = int(np.argmax(smoothed.unit == 1))
    assert smoothed.time[k - 1] == smoothed.time[k]
    sigma = np.sqrt(np.diag(smoothed.covariance[k]))[:9]
    jump = smoothed.states[k].minus(smoothed.states[k - 1])[:9]
    assert np.max(np.abs(jump / sigma)) < 1e-6
    scale = np.outer(sigma, sigma)
    change = smoothed.covariance[k, :9, :9] - smoothed.covariance[k - 1, :9, :9]
    assert np.max(np.abs(change / scale)) < 1e-6
    sensor = filter_pass.layout.sensor
    first, second = (smoothed.states[i].errors[sensor] for i in (k - 1, k))
    assert np.all(first != 0.0)
    assert np.all(second != 0.0)
    assert np.linalg.norm(second - first) > 1e-3


def test_the_other_instruments_onboard_attitude_differs_by_a_step():
    filter_pass = run_filter(changing(onboard=True))
    k = next(i for i, n in enumerate(filter_pass.nodes) if n.unit == 1)
    block = filter_pass.layout["onboard_attitude"]
    change = filter_pass.nodes[k].covariance[block, block] - filter_pass.nodes[k - 1].covariance[block, block]
    np.testing.assert_allclose(change, 4e-3**2 * np.eye(3), atol=1e-12)


def test_the_onboard_attitude_bridges_a_gap():
    """A second without rates: a quaternion after it gives the rotation, to the accuracy of the two quaternions."""
    s = drive()
    gap = np.zeros(80, bool)
    gap[32:40] = True
    s = replace(s, rate_noise=np.where(gap, 0.3, 2e-3), shared_rate_noise=np.where(gap, 0.0, 2e-3))
    entry = EntryErrors(onboard_attitude=ATTITUDE, onboard_sigma=1e-4)
    without = run_filter(build(samples=s, entry=entry, times=(5.0,)))
    k = next(i for i, n in enumerate(without.nodes) if n.time == 5.0)
    propagated = without.nodes[k].state.nav[10:]
    turned = rotations.multiply(propagated, rotations.from_rotation_vector([0.1, -0.05, 0.12]))
    filter_pass = run_filter(build([OnboardAttitude(5.0, turned, 1e-4)], samples=s, entry=entry))
    k = next(i for i, n in enumerate(filter_pass.nodes) if n.time == 5.0)
    moved = filter_pass.nodes[k].state.minus(without.nodes[k].state)
    np.testing.assert_allclose(moved[6:9], [0.1, -0.05, 0.12], atol=5e-3)
    np.testing.assert_allclose(moved[-3:], [0.1, -0.05, 0.12], atol=2e-3)
    before, after = (np.sqrt(np.diag(w.nodes[k].covariance)[6:9]) for w in (without, filter_pass))
    assert np.all(before > 0.1)
    assert np.all(after < 0.02)


def test_without_a_gap_the_onboard_attitude_contains_no_information_on_the_true_one():
    """It is the sum of the same readings: whatever its sigma, the attitude's sigma does not change."""
    entry = EntryErrors(onboard_attitude=ATTITUDE, onboard_sigma=1e-3)
    constraints = [OnboardAttitude(t, ATTITUDE, 1.0) for t in (4.0, 8.0)]
    alone, filter_pass = run_filter(build(entry=entry, times=(4.0, 8.0))), run_filter(build(constraints, entry=entry))
    np.testing.assert_allclose(
        filter_pass.nodes[-1].covariance[:9, :9], alone.nodes[-1].covariance[:9, :9], rtol=1e-6, atol=1e-9
    )
    assert filter_pass.nodes[-1].covariance[-1, -1] <= alone.nodes[-1].covariance[-1, -1]


# Leaving out


@pytest.mark.parametrize("name", ["altimeter", "rest_velocity", "landing"])
def test_running_again_without_a_constraint_equals_running_without_it(name):
    """From a stored node on, or from the start: the same as a problem without the constraint."""
    site = LandingSite(0.0, twins.MARS.rotation.to_fixed(0.0, POSITION + 50.0), 200.0**2 * np.eye(3), twins.MARS)
    unit = (np.arange(80) >= 40).astype(int)
    problem = build(
        [
            site,
            height(2.0, -500.0, 50.0),
            velocity_at_rest(5.0, 800.0),
            height(5.0, -1400.0, 50.0),
            height(8.03, -2000.0),
        ],
        drive(unit=unit),
        instruments=(FIRST, SECOND),
    )
    again = run_filter_without(problem, run_filter(problem), name)
    fresh = run_filter(replace(problem, constraints=tuple(c for c in problem.constraints if c.name != name)))
    assert [f.constraint for f in again.fused] == [f.constraint for f in fresh.fused]
    assert [f.node for f in again.fused] == [f.node for f in fresh.fused]
    assert len(again.nodes) == len(fresh.nodes)
    for a, b in zip(again.nodes, fresh.nodes, strict=True):
        same(a, b)
