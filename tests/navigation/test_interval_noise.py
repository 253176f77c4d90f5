"""Process noise and on-board attitude over many intervals, against the functions of one interval."""

from dataclasses import replace

import numpy as np
import pytest
import twins

from edl_filter import rotations
from edl_filter.navigation.interval_noise import OnboardRotations, process_noise_of_intervals
from edl_filter.navigation.layout import Layout
from edl_filter.navigation.noise import process_noise
from edl_filter.navigation.propagation import onboard_steps

COUNT = 60
BARE = Layout.of((twins.ALL,), {})
ONBOARD = Layout.of((twins.ALL,), {"onboard_rate": 3, "onboard_mounting": 3, "onboard_attitude": 3})
#: Intervals of different length, one of them without samples.
BEGINS, ENDS = np.array([0, 4, 4, 5, 31]), np.array([4, 4, 5, 31, COUNT])


@pytest.fixture(scope="module")
def samples():
    """With samples that were filled in, net turns, and noise that an on-board attitude does not share."""
    rng = np.random.default_rng(3)
    rate_noise = rng.uniform(2e-4, 1e-3, (COUNT, 3))
    s = twins.samples(
        rng.uniform(0.02, 0.2, COUNT), 20.0 * rng.standard_normal((COUNT, 3)), rng.standard_normal((COUNT, 3)),
        rng.uniform(0.05, 0.2, (COUNT, 3)), rate_noise, rng.uniform(0.0, 1.0, (COUNT, 3)) * rate_noise,
    )  # fmt: skip
    filled = (np.arange(COUNT) % 11 == 0)[:, None] * rng.uniform(0.1, 1.0, (COUNT, 3))
    return replace(
        s, coning_corrected=np.arange(COUNT) % 5 == 0, force_fill_sigma=filled, rate_fill_sigma=0.01 * filled
    )


@pytest.mark.parametrize("layout", [BARE, ONBOARD])
def test_noise_of_each_interval_is_that_of_its_samples(samples, layout):
    attitudes = rotations.normalise(np.random.default_rng(4).standard_normal((len(BEGINS), 4)))
    noise = process_noise_of_intervals(layout, samples, attitudes, BEGINS, ENDS)
    assert not noise[1].any()
    for k, (begin, end) in enumerate(zip(BEGINS, ENDS, strict=True)):
        expected = process_noise(layout, samples.part(begin, end), attitudes[k])
        scale = np.sqrt(np.diag(expected))
        assert np.all(np.abs(noise[k] - expected) <= 1e-12 * scale[:, None] * scale)


def test_onboard_turns_of_each_interval_are_those_of_its_samples(samples):
    errors = 0.03 * np.random.default_rng(5).standard_normal((ONBOARD.size, 3))
    turns = OnboardRotations.over(ONBOARD, samples, BEGINS, ENDS)
    corrections = turns.corrections(ONBOARD, errors)
    for k, (begin, end) in enumerate(zip(BEGINS, ENDS, strict=True)):
        net, correction = onboard_steps(ONBOARD, samples.part(begin, end), errors)
        np.testing.assert_allclose(turns.net[k], net, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(corrections[k], correction, rtol=0.0, atol=1e-14)


def test_a_layout_without_onboard_states_has_no_corrections(samples):
    turns = OnboardRotations.over(BARE, samples, BEGINS, ENDS)
    assert not turns.jacobians
    np.testing.assert_array_equal(turns.corrections(BARE, np.ones((BARE.size, 2)))[:, 0], [[0.0, 0.0, 0.0, 1.0]] * 5)
