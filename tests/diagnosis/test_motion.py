"""The path's motion from epoch to epoch: against each neighbour propagated by itself, and the filter's own noise."""

import numpy as np
import pytest

from edl_filter.diagnosis.case import case_of
from edl_filter.diagnosis.motion import differencing_steps, follow
from edl_filter.diagnosis.point import first_point
from edl_filter.navigation import strapdown
from edl_filter.navigation.layout import State
from edl_filter.navigation.noise import process_noise
from edl_filter.navigation.ukf import propagate_states


@pytest.fixture(scope="module", params=["practice_06", "spirit"])
def followed(request):
    """Problem, bins and motion of a flight without and one with an attitude that was computed on board."""
    case = case_of(request.getfixturevalue(request.param))
    problem, point = case.arrange(case.effects).problem, first_point(case.reconstruction)
    return problem, case.bins, follow(problem, case.bins, point.start, point.errors)


def propagated(problem, state, part):
    nav = np.repeat(state.nav[:, None], strapdown.LANES, axis=1)
    errors = np.repeat(state.errors[:, None], strapdown.LANES, axis=1)
    propagate_states(problem.layout, problem.planet, part, nav, errors)
    return State(nav[:, 0], state.errors)


def stretches(motion):
    """Those between two epochs of one instrument: index of the first epoch, and of the second."""
    pairs = [(k - 1, k) for k in range(1, len(motion.time)) if motion.time[k] > motion.time[k - 1]]
    return [pairs[i] for i in (0, len(pairs) // 3, 2 * len(pairs) // 3, len(pairs) - 1)]


def test_each_neighbour_by_itself(followed):
    problem, _, motion = followed
    samples, steps = problem.samples, differencing_steps(problem.layout)
    for a, b in stretches(motion):
        part = samples.part(samples.index(motion.time[a]), samples.index(motion.time[b]))
        begin = motion.reference[a]
        np.testing.assert_allclose(motion.reference[b].nav, propagated(problem, begin, part).nav, rtol=1e-9, atol=1e-9)
        twin = np.empty_like(motion.move[b])
        for j, step in enumerate(steps):
            delta = np.zeros(len(steps))
            delta[j] = step
            up, down = (propagated(problem, begin.plus(d), part) for d in (delta, -delta))
            twin[:, j] = up.minus(down) / (2.0 * step)
        # what a step does, with the rounding of positions of millions of metres in it
        np.testing.assert_allclose(motion.move[b] * steps, twin * steps, rtol=1e-6, atol=1e-8)


def test_noise_is_the_filters_where_no_bin_is_compared(followed):
    """It is that from the attitude at the stretch's beginning; a spinning vehicle turns far in a second."""
    problem, bins, motion = followed
    samples = problem.samples
    late = [k for k in range(1, len(motion.time)) if motion.time[k - 1] > bins.edges[-1] + 1.0]
    assert late
    for k in late[:: max(len(late) // 5, 1)]:
        if motion.time[k] == motion.time[k - 1]:
            continue
        part = samples.part(samples.index(motion.time[k - 1]), samples.index(motion.time[k]))
        wanted = process_noise(problem.layout, part, motion.reference[k - 1].nav[6:10])
        np.testing.assert_allclose(motion.noise[k], wanted, rtol=1e-9, atol=1e-15 * wanted.max())
        assert motion.walk[k] == 0.0


def test_a_constraint_is_met_once(followed):
    problem, _, motion = followed
    met = [i for here in motion.constraints for i in here]
    assert sorted(met) == list(range(len(problem.constraints)))
    for time, here in zip(motion.time, motion.constraints, strict=True):
        assert all(abs(problem.constraints[i].time - time) < 1e-5 for i in here)
