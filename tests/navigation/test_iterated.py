"""Iterated smoothing against the textbook on a linear problem, and on a flight whose filter is far from linear."""

from dataclasses import replace

import numpy as np
import pytest
import twins

from edl_filter.mission import Mission
from edl_filter.navigation.filter import Settings, run_filter
from edl_filter.navigation.iterated import iterate, linearized_pass, run_without
from edl_filter.navigation.leave_one_out import check_constraints
from edl_filter.navigation.recovery import run_with_recovery
from edl_filter.navigation.smoother import smooth
from edl_filter.pipeline.load import read_atmosphere, read_telemetry
from edl_filter.pipeline.reconstruct import assemble, lost_stretches
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
    checks = {c.name: c for c in check_constraints(problem, filter_pass)}
    assert checks["landing"].left_out_nis < 20.0 and checks["rest_velocity"].left_out_nis < 20.0


def test_where_the_first_pass_is_linear_it_is_kept(flight):
    mission, telemetry, planet, atmosphere = flight
    problem = assemble(mission, telemetry, planet, atmosphere)
    first = run_filter(problem)
    assert iterate(problem, first) is first
