"""Propagation of full states, column by column, against the scalar twin and sums over the samples."""

from dataclasses import replace

import numpy as np
import twins
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.navigation import strapdown
from edl_filter.navigation.layout import Layout
from edl_filter.navigation.propagation import OnboardRotations, propagate_states

MARS, LANES = twins.MARS, strapdown.LANES
#: Every sensor error, and all errors of an attitude that is computed on board.
LAYOUT = Layout.of((twins.ALL,), {"onboard_rate": 3, "onboard_mounting": 3, "onboard_attitude": 3})


def random_samples(rng, count):
    """Samples of which every fifth is a net turn; none turns by much more than half a radian."""
    samples = twins.samples(
        rng.uniform(0.02, 0.125, count), 40.0 * rng.standard_normal((count, 3)), rng.standard_normal((count, 3))
    )
    return replace(samples, coning_corrected=np.arange(count) % 5 == 0)


def onboard_attitude(samples, errors, attitude):
    """The attitude computed on board after `samples`: turns as read, then the correction, both summed up."""
    end = attitude
    middles = []
    for dt, rate in zip(samples.interval, samples.rate, strict=True):
        middles.append(rotations.multiply(end, rotations.from_rotation_vector(0.5 * dt * rate)))
        end = rotations.multiply(end, rotations.from_rotation_vector(dt * rate))
    correction = np.zeros(3)
    for dt, rate, net, middle in zip(samples.interval, samples.rate, samples.coning_corrected, middles, strict=True):
        if not net:
            used = np.cross(rate, errors[LAYOUT["onboard_mounting"]]) - errors[LAYOUT["onboard_rate"]]
            correction += dt * rotations.rotate(rotations.multiply(rotations.conjugate(end), middle), used)
    return rotations.multiply(end, rotations.from_rotation_vector(correction))


@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_every_state_equals_the_scalar_twin(seed, count):
    rng = np.random.default_rng(seed)
    nav, errors = twins.points(LANES, seed)[0], 0.03 * rng.standard_normal((LAYOUT.size, LANES))
    samples = random_samples(rng, count)
    start = nav.copy()
    propagate_states(LAYOUT, MARS, samples, nav, errors)
    for s in range(LANES):
        maps = twins.undo_errors(LAYOUT, errors[:, s])
        expected = twins.propagate(
            start[:10, s], *maps, samples.interval, samples.force, samples.rate, MARS.mu, MARS.j2, MARS.gravity_radius
        )
        onboard = onboard_attitude(samples, errors[:, s], start[10:, s])
        assert twins.attitude_error(nav[10:, s], onboard) < 1e-9
        for part in (slice(0, 3), slice(3, 6), slice(6, 10)):
            scale = np.linalg.norm(expected[part])
            np.testing.assert_allclose(nav[part, s], expected[part], rtol=0, atol=1e-12 * scale)


def test_the_kernel_stays_within_its_arrays(monkeypatch):
    """Interpreted, it checks the bounds of the arrays that it is given; compiled, it does not."""
    rng = np.random.default_rng(7)
    errors, samples = 0.03 * rng.standard_normal((LAYOUT.size, LANES)), random_samples(rng, 10)
    compiled = twins.points(LANES, 7)[0]
    interpreted = compiled.copy()
    propagate_states(LAYOUT, MARS, samples, compiled, errors)
    monkeypatch.setattr(strapdown, "propagate", strapdown.propagate.py_func)
    propagate_states(LAYOUT, MARS, samples, interpreted, errors)
    np.testing.assert_allclose(interpreted, compiled, rtol=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_an_attitude_computed_on_board_turns_as_the_sum_over_the_samples(seed, count):
    rng = np.random.default_rng(seed)
    errors = 0.03 * rng.standard_normal((LAYOUT.size, 3))
    samples = random_samples(rng, count)
    attitude = rotations.normalise(rng.standard_normal(4))
    onboard = OnboardRotations.over_all(LAYOUT, samples)
    corrections = onboard.corrections(LAYOUT, errors)
    for s in range(3):
        end = rotations.multiply(rotations.multiply(attitude, onboard.net[0]), corrections[0, s])
        np.testing.assert_allclose(end, onboard_attitude(samples, errors[:, s], attitude), atol=1e-13)


def test_an_attitude_computed_with_other_rates_and_mounting_turns_as_predicted():
    """Against the same samples integrated with ``ω + ω × m - b``; net turns gain nothing."""
    rng = np.random.default_rng(11)
    n, dt = 80, 0.125
    time = dt * np.arange(1, n + 1)
    rate = np.stack((0.2 + 0.02 * np.sin(time), 0.1 * np.cos(0.7 * time), 0.1 * np.sin(0.7 * time)), axis=1)
    samples = twins.samples(np.full(n, dt), np.zeros((n, 3)), rate)
    b, m = 1e-6 * rng.standard_normal(3), 5e-5 * rng.standard_normal(3)
    other = replace(samples, onboard_rate=rate + np.cross(rate, m) - b)
    nominal, changed = (OnboardRotations.over_all(LAYOUT, s) for s in (samples, other))
    miss = rotations.multiply(rotations.conjugate(nominal.net[0]), changed.net[0])
    turn = rotations.to_rotation_vector(miss)
    predicted = nominal.jacobians["onboard_rate"][0] @ b + nominal.jacobians["onboard_mounting"][0] @ m
    np.testing.assert_allclose(predicted, turn, atol=3e-4 * np.linalg.norm(turn))
    corrected = OnboardRotations.over_all(LAYOUT, replace(samples, coning_corrected=np.ones(n, bool)))
    assert not any(jacobian.any() for jacobian in corrected.jacobians.values())


def test_net_turn_of_samples_at_rest_is_none():
    s = twins.samples(np.ones(3), np.zeros((3, 3)), np.zeros((3, 3)))
    np.testing.assert_array_equal(OnboardRotations.over_all(LAYOUT, s).net, [[0, 0, 0, 1]])


def test_onboard_turns_of_each_interval_are_those_of_its_samples():
    """Intervals of different length, one of them without samples; on-board rates that differ from the samples'."""
    rng = np.random.default_rng(5)
    samples = random_samples(rng, 60)
    samples = replace(samples, onboard_rate=samples.rate + 0.05 * rng.standard_normal((60, 3)))
    begins, ends = np.array([0, 4, 4, 5, 31]), np.array([4, 4, 5, 31, 60])
    turns = OnboardRotations.over(LAYOUT, samples, begins, ends)
    for k, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        alone = OnboardRotations.over_all(LAYOUT, samples.part(begin, end))
        np.testing.assert_array_equal(turns.net[k], alone.net[0])
        for name, jacobian in turns.jacobians.items():
            np.testing.assert_array_equal(jacobian[k], alone.jacobians[name][0])


def test_a_layout_without_onboard_states_has_no_corrections():
    layout = Layout.of((twins.ALL,), {})
    turns = OnboardRotations.over_all(layout, random_samples(np.random.default_rng(3), 10))
    assert not turns.jacobians
    np.testing.assert_array_equal(turns.corrections(layout, np.ones((layout.size, 2))), [[[0.0, 0.0, 0.0, 1.0]] * 2])


def test_the_net_rotation_is_the_product_of_the_samples_rotations():
    """Of the rates that were used on board, which differ from the samples'."""
    rng = np.random.default_rng(4)
    samples = random_samples(rng, 10)
    samples = replace(samples, onboard_rate=samples.rate + 0.05 * rng.standard_normal((10, 3)))
    expected = np.array([0.0, 0.0, 0.0, 1.0])
    for interval, rate in zip(samples.interval, samples.onboard_rate, strict=True):
        expected = rotations.multiply(expected, rotations.from_rotation_vector(interval * rate))
    np.testing.assert_allclose(OnboardRotations.over_all(LAYOUT, samples).net[0], expected, atol=1e-13)
