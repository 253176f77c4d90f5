"""Transitions of the path: against each displaced state propagated by itself, and the filter's process noise."""

import numpy as np
import pytest

from edl_filter.diagnosis.jacobians.transitions import _same_epoch, propagate_path
from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point
from edl_filter.navigation import strapdown
from edl_filter.navigation.ekf import difference_steps
from edl_filter.navigation.filter import SAME_EPOCH
from edl_filter.navigation.layout import State
from edl_filter.navigation.noise import process_noise
from edl_filter.navigation.propagation import propagate_states


@pytest.fixture(scope="module", params=["practice_06", "spirit"])
def path_case(request):
    """Problem, bins and transitions of a flight without and of one with an attitude that was computed on board."""
    case = flight_case(request.getfixturevalue(request.param))
    problem, point = case.model_inputs(case.effects).problem, smoothed_point(case.reconstruction)
    return problem, case.bins, propagate_path(problem, case.bins, point.start, point.errors)


def propagated(problem, state, samples):
    """A state after samples, by the filter's kernel."""
    nav = np.repeat(state.nav[:, None], strapdown.LANES, axis=1)
    errors = np.repeat(state.errors[:, None], strapdown.LANES, axis=1)
    propagate_states(problem.layout, problem.planet, samples, nav, errors)
    return State(nav[:, 0], state.errors)


def some_intervals(transitions):
    """Four of the intervals between two epochs of one instrument: index of the first epoch, and of the second."""
    times = transitions.time
    pairs = [(k - 1, k) for k in range(1, len(times)) if times[k] > times[k - 1]]
    return [pairs[i] for i in (0, len(pairs) // 3, 2 * len(pairs) // 3, len(pairs) - 1)]


def test_each_column_is_the_difference_of_two_propagated_states(path_case):
    problem, _, transitions = path_case
    samples, steps = problem.samples, difference_steps(problem.layout)
    for a, b in some_intervals(transitions):
        part = samples.part(samples.index(transitions.time[a]), samples.index(transitions.time[b]))
        begin, end = transitions.states[a], transitions.states[b]
        np.testing.assert_allclose(end.nav, propagated(problem, begin, part).nav, rtol=1e-9, atol=1e-9)
        expected = np.empty_like(transitions.transition[b])
        for j, step in enumerate(steps):
            displacement = np.zeros(len(steps))
            displacement[j] = step
            plus, minus = (propagated(problem, begin.plus(d), part) for d in (displacement, -displacement))
            expected[:, j] = plus.minus(minus) / (2.0 * step)
        # the effect of a whole step, with the rounding error of positions of millions of metres
        np.testing.assert_allclose(transitions.transition[b] * steps, expected * steps, rtol=1e-6, atol=1e-8)


def test_process_noise_is_the_filters_where_no_bin_is_compared(path_case):
    """From the attitude at the interval's beginning; a spinning vehicle rotates far in a second."""
    problem, bins, transitions = path_case
    samples, times = problem.samples, transitions.time
    later = [k for k in range(1, len(times)) if times[k - 1] > bins.edges[-1] + 1.0]
    assert later
    for k in later[:: max(len(later) // 5, 1)]:
        if times[k] == times[k - 1]:
            continue
        part = samples.part(samples.index(times[k - 1]), samples.index(times[k]))
        expected = process_noise(problem.layout, part, transitions.states[k - 1].nav[6:10])
        np.testing.assert_allclose(transitions.process_noise[k], expected, rtol=1e-9, atol=1e-15 * expected.max())
        assert transitions.gyro_noise_time[k] == 0.0


def test_every_constraint_belongs_to_one_epoch(path_case):
    problem, _, transitions = path_case
    assert sorted(i for which in transitions.constraints for i in which) == list(range(len(problem.constraints)))
    for time, which in zip(transitions.time, transitions.constraints, strict=True):
        assert all(abs(problem.constraints[i].time - time) < 1e-5 for i in which)


@pytest.mark.parametrize("start", [0.0, 3.1e-6, 4.999e-6, 7e-6])
def test_an_epoch_next_to_an_edge_is_that_edge(start):
    """A time within `SAME_EPOCH` of it, also where both are rounded to different digits."""
    edges = start + 0.1 * np.arange(5)
    times = np.sort(np.concatenate((edges[[0, 2]], edges[[1, 3]] - 1e-9, [start + 0.25])))
    np.testing.assert_array_equal(_same_epoch(times, edges), [0, 1, 2, -1, 3])
    np.testing.assert_array_equal(_same_epoch(edges + 1.5 * SAME_EPOCH, edges), np.full(5, -1))
