"""Propagation of full states, column by column, against the scalar twin and sums over the samples."""

from dataclasses import replace

import numpy as np
import twins
from hypothesis import given
from hypothesis import strategies as st

from edl_filter import rotations
from edl_filter.navigation import strapdown
from edl_filter.navigation.layout import Layout
from edl_filter.navigation.propagation import onboard_steps, propagate_states

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
    net, correction = onboard_steps(LAYOUT, samples, errors)
    for s in range(3):
        end = rotations.multiply(rotations.multiply(attitude, net), correction[s])
        np.testing.assert_allclose(end, onboard_attitude(samples, errors[:, s], attitude), atol=1e-13)
