"""Iterated smoothing against the textbook on a linear problem, and on a flight whose filter is far from linear."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import twins
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.mission import Mission
from edl_filter.navigation import iterated
from edl_filter.navigation.filter import Settings, build_problem, run_filter
from edl_filter.navigation.initial import EntryErrors
from edl_filter.navigation.iterated import _largest_distance, iterate, linearized_pass, may_be_nonlinear, run_without
from edl_filter.navigation.leave_one_out import check_constraints
from edl_filter.navigation.outlier_screening import Divergence
from edl_filter.navigation.recovery import contradiction, first_pass, run_with_recovery
from edl_filter.navigation.smoother import smooth
from edl_filter.pipeline.load import read_atmosphere, read_telemetry
from edl_filter.pipeline.reconstruct import assemble, lost_stretches
from edl_filter.simulation import Scenario, simulate
from edl_filter.telemetry.sample_repair import repaired


@pytest.fixture(scope="module")
def flight():
    """Mission, telemetry, planet, atmosphere of the shipped flight."""
    mission = Mission.load("builtin:practice_mer")
    telemetry = read_telemetry(mission)
    return mission, telemetry, mission.planet_model(telemetry.prime_meridian_at_epoch), read_atmosphere(mission)


@pytest.fixture(scope="module")
def complete(flight):
    """Smoothed states with all samples of both IMUs."""
    return smooth(run_filter(assemble(*flight)))


def with_gap(flight, begin, end):
    """The filter's problem with one IMU whose samples between two times were lost, and the telemetry."""
    mission, telemetry, planet, atmosphere = flight
    driving = telemetry.driving
    lost = (driving.time > begin) & (driving.time <= end)
    values = {key: np.where(lost[:, None], np.nan, getattr(driving, key)) for key in ("specific_force", "angular_rate")}
    telemetry = replace(telemetry, driving=replace(driving, **values), checking=())
    telemetry = repaired(telemetry, parachute=telemetry.events["parachute_deploy"])
    return assemble(mission, telemetry, planet, atmosphere), telemetry


def largest_deviation(smoothed, complete, time):
    """Largest deviation of position, velocity and attitude from the complete flight at a time, in sigmas."""
    k, j = (int(np.argmin(np.abs(s.time - time))) for s in (smoothed, complete))
    assert abs(smoothed.time[k] - complete.time[j]) < 0.01
    error = smoothed.states[k].minus(complete.states[j])[:9]
    return float(np.max(np.abs(error) / np.sqrt(np.diag(smoothed.covariance[k]))[:9]))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_linear_problem_has_the_textbooks_solution_about_any_path(seed):
    case = twins.linear(seed, Settings(longest_interval=1.5, gate_probability=1.0))
    first = run_filter(case.problem)
    assert iterate(case.problem, first) is first
    random = np.random.default_rng(seed)
    moves = np.zeros((len(first.nodes), case.problem.layout.size))
    moves[:, :6] = random.normal(size=(len(first.nodes), 6))
    references = [n.state.plus(move) for n, move in zip(first.nodes, moves, strict=True)]
    smoothed = smooth(linearized_pass(case.problem, first, references))
    means, covariances, _ = twins.kalman(case.mean, case.covariance, case.steps)
    expected = twins.rauch_tung_striebel(means, covariances, case.steps)
    for state, block, mean, covariance in zip(smoothed.states, smoothed.covariance, *expected, strict=True):
        sigma = np.sqrt(np.diag(covariance))
        assert np.max(np.abs(twins.linear_vector(state) - mean) / sigma) < 1e-6
        assert np.max(np.abs(twins.linear_block(block) - covariance) / np.outer(sigma, sigma)) < 1e-6


def test_a_gap_at_the_peak_does_not_contradict_the_landing(flight, complete):
    """Linearised about its own prediction, the filter is 15 sigmas off and rejects landing and rest."""
    problem, telemetry = with_gap(flight, 110.0, 120.0)
    first = run_filter(problem)
    assert sum(not f.accepted for f in first.fused) > 0
    assert largest_deviation(smooth(first), complete, telemetry.parachute.time) > 5.0
    same, filter_pass, recovery = run_with_recovery(problem, lost_stretches(telemetry.driving))
    assert same is problem and recovery is None and filter_pass.converged
    assert all(f.accepted for f in filter_pass.fused if f.constraint.name != "altimeter")
    smoothed = smooth(filter_pass)
    for time in (problem.initial.time, telemetry.parachute.time, filter_pass.nodes[-1].time):
        assert largest_deviation(smoothed, complete, time) < 2.0


def test_a_constraint_is_left_out_of_the_iteration(flight):
    problem, telemetry = with_gap(flight, 110.0, 120.0)
    _, filter_pass, _ = run_with_recovery(problem, lost_stretches(telemetry.driving))
    without = run_without(problem, filter_pass, "rest_gravity")
    assert without.references is not None and "rest_gravity" not in {f.constraint.name for f in without.fused}
    reduced = replace(problem, constraints=tuple(c for c in problem.constraints if c.name != "rest_gravity"))
    alone, expected = smooth(without), smooth(iterate(reduced, run_filter(reduced)))
    sigma = np.sqrt(np.diagonal(expected.covariance, axis1=1, axis2=2))
    moves = [a.minus(b) for a, b in zip(alone.states, expected.states, strict=True)]
    assert np.max(np.abs(moves) / sigma) < 0.1


@pytest.mark.slow  # one iteration for each constraint
def test_what_is_left_out_of_the_iteration_agrees_with_the_remaining_constraints(flight):
    problem, telemetry = with_gap(flight, 110.0, 120.0)
    _, filter_pass, _ = run_with_recovery(problem, lost_stretches(telemetry.driving))
    checks = {c.name: c for c in check_constraints(problem, filter_pass)}
    assert checks["landing"].left_out_nis < 20.0 and checks["rest_velocity"].left_out_nis < 20.0


def test_where_the_first_pass_is_linear_it_is_kept(flight):
    mission, telemetry, planet, atmosphere = flight
    problem = assemble(mission, telemetry, planet, atmosphere)
    first = run_filter(problem)
    assert iterate(problem, first) is first


@pytest.fixture(scope="module")
def poor_entry():
    """True motion and the filter's problem of a flight whose entry attitude is known to 0.5 degrees per axis."""
    changes = ("position_sigma=1000", "velocity_sigma=1", "attitude_sigma_deg=0.5")
    scenario = Scenario.load("builtin:mer", [f"stated_state.{change}" for change in changes])
    flight = simulate(scenario, seed=1003)
    mission, telemetry = Mission.load(scenario.mission), flight.telemetry()
    planet = mission.planet_model(telemetry.prime_meridian_at_epoch)
    return flight.motion, assemble(mission, telemetry, planet, read_atmosphere(mission))


def navigation_nees(motion, smoothed, time):
    """NEES of position, velocity and attitude at a time, over nine degrees of freedom."""
    k = int(np.argmin(np.abs(smoothed.time - time)))
    true, state = motion.at(smoothed.time[k : k + 1])[0], smoothed.states[k].nav
    turn = Rotation.from_quat(state[6:10]).inv() * Rotation.from_quat(true[6:10])
    error = np.concatenate((true[:6] - state[:6], turn.as_rotvec()))
    return float(error @ np.linalg.solve(smoothed.covariance[k][:9, :9], error)) / 9.0


def test_a_poorly_known_entry_attitude_is_no_matter_after_the_iteration(poor_entry):
    """The filter's own pass is far off in its sigmas and rejects nothing; iterated, it is consistent at all times."""
    motion, problem = poor_entry
    once, filter_pass = run_filter(problem), first_pass(problem)
    times = (0.0, motion.deployed - 1.0, motion.deployed + 20.0, motion.stopped + 10.0)
    assert all(f.accepted for f in once.fused) and contradiction(once) is None
    assert max(navigation_nees(motion, smooth(once), time) for time in times) > 10.0
    assert filter_pass.converged and filter_pass.references is not None
    smoothed = smooth(filter_pass)
    for time in times:
        assert navigation_nees(motion, smoothed, time) < chi2.ppf(0.9999, 9) / 9.0
    dof = sum(len(f.innovation.residual) for f in filter_pass.fused)
    nis = sum(f.innovation.nis for f in filter_pass.fused)
    assert chi2.ppf(0.001, dof) < nis < chi2.ppf(0.999, dof)


def test_the_unscented_and_the_extended_filter_have_the_same_iterated_path(poor_entry):
    _, problem = poor_entry
    paths = []
    for method in ("ukf", "ekf"):
        settings = replace(problem.settings, method=method)
        paths.append(smooth(first_pass(replace(problem, settings=settings))))
    sigma = np.sqrt(np.diagonal(paths[0].covariance, axis1=1, axis2=2))
    moves = [a.minus(b) for a, b in zip(paths[0].states, paths[1].states, strict=True)]
    assert np.max(np.abs(moves) / sigma) < 0.02


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (2.0, -1.0, 2.0)])
@pytest.mark.parametrize(
    ("attitude", "position", "nonlinear"),
    [(0.9e-3, 2.9e3, False), (1.1e-3, 0.0, True), (0.0, 3.1e3, True)],
)
def test_a_poorly_known_entry_state_is_recognised_along_any_axis(axis, attitude, position, nonlinear):
    """That of the first node alone counts: a later one may be uncertain for other reasons."""
    along = np.outer(axis, axis) / (np.array(axis) @ axis)
    covariance = np.diag([1e-12] * 3 + [1e10] * 3 + [1e-12] * 3 + [1e10] * 3)
    covariance[:3, :3] += position**2 * along
    covariance[6:9, 6:9] += attitude**2 * along
    nodes = [SimpleNamespace(covariance=c) for c in (covariance, 1e8 * (not nonlinear) * np.eye(12))]
    assert may_be_nonlinear(SimpleNamespace(nodes=nodes)) is nonlinear


@pytest.mark.parametrize("sigma", [0.01, 100.0])
def test_the_iteration_ends_where_no_state_moves_by_a_hundredth_of_its_sigma(monkeypatch, sigma):
    """The path moves by 0.5, 0.012 and 0.008 sigmas: the third pass is the last one."""
    problem = twins.linear().problem
    state = run_filter(problem).nodes[0].state
    size = len(state.errors)
    covariance = sigma**2 * np.eye(size)[None]
    paths = []
    for place in (0.0, 0.5, 0.512, 0.52, 2.0):
        delta = np.zeros(size)
        delta[1] = place * sigma
        paths.append(SimpleNamespace(states=[state.plus(delta)], covariance=covariance))
    monkeypatch.setattr(iterated, "smooth", lambda filter_pass: paths[filter_pass.number])
    monkeypatch.setattr(
        iterated, "linearized_pass", lambda problem, before, references: SimpleNamespace(number=before.number + 1)
    )
    assert iterate(problem, SimpleNamespace(number=0, references=[state])).number == 3


@pytest.mark.parametrize(
    ("distance", "accepted", "kept"), [(0.19, True, True), (0.21, True, False), (0.19, False, False)]
)
def test_a_first_pass_is_kept_where_the_path_hardly_moves_and_the_gate_decides_alike(
    monkeypatch, distance, accepted, kept
):
    problem = twins.linear().problem
    state = run_filter(problem).nodes[0].state
    smoothed = SimpleNamespace(states=[state], covariance=np.eye(len(state.errors))[None])
    first, second = (
        SimpleNamespace(references=None, fused=[SimpleNamespace(accepted=a) for a in (True, last, False)])
        for last in (True, accepted)
    )
    monkeypatch.setattr(iterated, "smooth", lambda filter_pass: smoothed)
    monkeypatch.setattr(iterated, "linearized_pass", lambda problem, before, references: second)
    monkeypatch.setattr(iterated, "_largest_distance", lambda moves, covariance: distance)
    assert iterate(problem, first) is (first if kept else second)


def test_a_move_is_measured_along_the_principal_axes():
    """Two states with a correlation of 0.999 that move apart by a tenth of their sigmas have moved by 3.2 sigmas."""
    covariance = np.eye(12)
    covariance[0, 1] = covariance[1, 0] = 0.999
    covariance *= np.outer(np.arange(1.0, 13.0), np.arange(1.0, 13.0))
    along, across, other = np.zeros(12), np.zeros(12), np.zeros(12)
    along[:2], across[:2], other[11] = (0.1, 0.2), (0.1, -0.2), 1e3
    squares = [9.0 * _largest_distance([move], covariance[None]) ** 2 for move in (along, across, other)]
    assert squares == pytest.approx([0.02 / 1.999, 0.02 / 0.001, 0.0], rel=1e-6)
    pair = np.stack((covariance, covariance))
    assert 9.0 * _largest_distance([across, along], pair) ** 2 == pytest.approx(squares[1])


# --- decisions in a pass: on a linear problem, linearised about the filter's estimates, it repeats the filter ---------


def linear_pass(offset=0.0, gate=0.999, **settings):
    """A linear problem whose last landing site is `offset` (m) off, its first pass, and the place of this site in it.

    All other constraints are what the filter predicts for them; the velocity at rest has a sigma of 30 m/s.
    """
    problem = twins.linear(1, Settings(longest_interval=1.5, gate_probability=gate, **settings)).problem
    constraints = list(problem.constraints)
    for k in range(len(constraints)):
        use = next(f for f in run_filter(problem).fused if f.constraint is constraints[k])
        predicted = constraints[k].measured - use.innovation.residual
        if constraints[k].name == "landing":
            constraints[k] = replace(constraints[k], position=predicted)
        elif constraints[k].name == "pre_entry_zero_force":
            constraints[k] = replace(constraints[k], mean_force=predicted)
        else:
            constraints[k] = replace(constraints[k], sigma=30.0)
        problem = replace(problem, constraints=tuple(constraints))
    last = max(i for i, c in enumerate(constraints) if c.name == "landing")
    moved = constraints[last].position + np.array([offset, 0.0, 0.0])
    constraints[last] = replace(constraints[last], position=moved)
    problem = replace(problem, constraints=tuple(constraints))
    first = run_filter(problem)
    return problem, first, next(i for i, f in enumerate(first.fused) if f.constraint is constraints[last])


def with_decision(first, place, accepted, nis, screened=False):
    """The pass with another decision on a constraint, at some normalised innovation squared."""
    use = first.fused[place]
    innovation = replace(use.innovation, nis=nis)
    changed = replace(use, accepted=accepted, weight=1.0, innovation=innovation, screened=screened)
    return replace(first, fused=[*first.fused[:place], changed, *first.fused[place + 1 :]])


def repeated(problem, first):
    return linearized_pass(problem, first, [n.state for n in first.nodes])


def assert_same_states(actual, expected):
    """Position, velocity and bias; the attitude is known to 1e-11 rad, which is its rounding."""
    for a, b in zip(actual.nodes, expected.nodes, strict=True):
        sigma = np.sqrt(np.diag(twins.linear_block(b.covariance)))
        moves = twins.linear_vector(a.state) - twins.linear_vector(b.state)
        assert np.max(np.abs(moves) / sigma) < 1e-6
        change = twins.linear_block(a.covariance - b.covariance)
        assert np.max(np.abs(change) / np.outer(sigma, sigma)) < 1e-6


@pytest.mark.parametrize("robust", ["none", "huber", "student_t"])
def test_a_pass_repeats_the_filters_decisions_weights_and_states(robust):
    problem, first, _ = linear_pass(60.0, gate=1.0 - 1e-12, robust=robust)
    assert all(f.accepted for f in first.fused)
    again = repeated(problem, first)
    assert [f.accepted for f in again.fused] == [f.accepted for f in first.fused]
    np.testing.assert_allclose([f.weight for f in again.fused], [f.weight for f in first.fused], rtol=1e-6)
    nis, expected = ([f.innovation.nis for f in p.fused] for p in (again, first))
    np.testing.assert_allclose(nis, expected, rtol=1e-6, atol=1e-9)
    assert again.converged and again.references is not None
    assert_same_states(again, first)
    # the prediction is much less certain than the site: the residual that remains is within Huber's limit
    assert (min(f.weight for f in first.fused) < 0.9) == (robust == "student_t")


def test_a_pass_changes_the_imu_where_the_filter_does():
    """Each IMU has a prior of its own: the bias of the second one is known four times worse."""
    linear = twins.linear(1, Settings(longest_interval=1.5, gate_probability=1.0 - 1e-12)).problem
    samples = replace(linear.samples, unit=(linear.samples.time > 6.0).astype(int))
    errors = (SensorErrors(accelerometer_bias=0.5), SensorErrors(accelerometer_bias=2.0))
    problem = build_problem(
        samples, linear.initial, EntryErrors(), errors, linear.constraints, twins.VOID, linear.settings
    )
    first = run_filter(problem)
    again = repeated(problem, first)
    assert_same_states(again, first)
    changed = next(k for k, node in enumerate(again.nodes) if node.unit == 1)
    assert 0 < changed < len(again.nodes) - 1
    for k, sigma in ((0, 0.5), (changed, 2.0)):
        assert np.sqrt(np.diag(again.nodes[k].covariance)[9:12]) == pytest.approx(sigma)


def test_the_gate_is_applied_again_to_what_it_rejected():
    """Rejected at a large innovation, because the path was far off then, and accepted about a path that is not."""
    problem, first, place = linear_pass()
    again = repeated(problem, with_decision(first, place, accepted=False, nis=1e4))
    assert again.fused[place].accepted
    assert_same_states(again, first)


@pytest.mark.parametrize("nis", [0.1, 25.0, 1e4])
def test_a_reading_that_was_screened_stays_rejected(nis):
    """It contradicted the other readings of its instrument, whether or not it had passed the gate."""
    problem, first, place = linear_pass()
    assert first.fused[place].innovation.nis < 16.0  # the gate for three components
    again = repeated(problem, with_decision(first, place, accepted=False, nis=nis, screened=True))
    again = repeated(problem, again)
    use = again.fused[place]
    assert use.screened and not use.accepted and use.weight == 1.0
    reduced = replace(problem, constraints=tuple(c for c in problem.constraints if c is not use.constraint))
    last = run_filter(reduced).nodes[-1]
    sigma = np.sqrt(np.diag(last.covariance))
    assert np.max(np.abs(again.nodes[-1].state.minus(last.state)) / sigma) < 1e-4


def test_a_reading_beyond_the_gate_is_rejected_and_changes_nothing():
    problem, first, place = linear_pass(offset=200.0)
    assert not first.fused[place].accepted
    again = repeated(problem, with_decision(first, place, accepted=True, nis=0.0))
    assert not again.fused[place].accepted and again.fused[place].weight == 1.0
    assert_same_states(again, first)


def test_a_divergence_ends_where_the_readings_of_its_instruments_agree_again():
    """Of these alone: others may contradict the path."""
    for offset, names, remains in ((0.0, ("landing",), False), (200.0, ("landing",), True),
                                   (200.0, ("rest_velocity",), False)):  # fmt: skip
        problem, first, _ = linear_pass(offset=offset)
        divergence = Divergence(time=4.0, names=names, readings=3, nis=1e4, free_nis=1.0, directions=6)
        again = repeated(problem, replace(first, divergence=divergence))
        assert again.divergence is (divergence if remains else None)


def test_a_path_that_still_moves_after_the_last_pass_has_not_converged(flight, monkeypatch):
    problem, _ = with_gap(flight, 110.0, 120.0)
    first = run_filter(problem)
    monkeypatch.setattr(iterated, "PASSES", 1)
    last = iterate(problem, first)
    assert last is not first and not last.converged
    assert len(last.references) == len(last.nodes)
    monkeypatch.undo()
    assert iterate(problem, last).converged
