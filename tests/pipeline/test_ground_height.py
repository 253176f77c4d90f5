"""Height of the ground at the landing: closed forms, a sequential twin, statistics, and a flight."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edl_filter.pipeline.ground_height import common_error, ground_height

SLOPE = np.tan(np.radians(5.0))


def sequential(error, sigma, distance):
    """Kalman filter of the common error plus the relief, from the farthest reading to the landing, with a flat prior.

    The relief is a random walk towards the landing, where it is zero, so that the state at the landing is the error.
    """
    order = np.argsort(-distance)
    estimate, variance = 0.0, 1e12
    places = [*distance[order], 0.0]
    for k, index in enumerate(order):
        gain = variance / (variance + sigma[index] ** 2)
        estimate += gain * (error[index] - estimate)
        variance = variance * sigma[index] ** 2 / (variance + sigma[index] ** 2)
        variance += SLOPE**2 * 100.0 * (places[k] - places[k + 1])
    return estimate, variance


@given(st.integers(1, 40), st.integers(0, 2**31))
def test_it_is_the_estimate_of_a_kalman_filter_towards_the_landing(count, seed):
    random = np.random.default_rng(seed)
    error, sigma = random.normal(3.0, 10.0, count), random.uniform(0.5, 8.0, count)
    distance = random.uniform(0.0, 300.0, count)
    estimate, variance = common_error(error, sigma, distance)
    expected = sequential(error, sigma, distance)
    assert estimate == pytest.approx(expected[0], rel=1e-6, abs=1e-6)
    assert variance == pytest.approx(expected[1], rel=1e-6)


def test_readings_at_the_landing_are_averaged_and_far_ones_have_the_relief_of_their_distance():
    error, sigma = np.array([4.0, 6.0, 8.0, 2.0]), np.full(4, 2.0)
    assert common_error(error, sigma, np.zeros(4)) == (pytest.approx(5.0), pytest.approx(1.0))
    # all at one place: the relief there is common to them, 8.7 m per 100 m
    assert common_error(error, sigma, np.full(4, 100.0)) == (
        pytest.approx(5.0),
        pytest.approx(1.0 + 8.749**2, rel=1e-3),
    )
    assert common_error(error, sigma, np.full(4, 100.0), 20.0) == (pytest.approx(5.0), pytest.approx(401.0))


def test_its_sigma_is_that_of_its_error_over_random_ground():
    random = np.random.default_rng(5)
    distance = np.linspace(200.0, 0.0, 100)
    steps = -np.diff(distance, append=0.0)
    normalized = []
    for _ in range(400):
        relief = np.cumsum((SLOPE * np.sqrt(100.0 * steps) * random.standard_normal(100))[::-1])[::-1]
        estimate, variance = common_error(7.0 + relief + random.normal(0.0, 5.0, 100), np.full(100, 5.0), distance)
        normalized.append((estimate - 7.0) / np.sqrt(variance))
    assert np.mean(np.square(normalized)) == pytest.approx(1.0, abs=3.0 * np.sqrt(2.0 / 400))
    assert abs(np.mean(normalized)) < 3.0 / np.sqrt(400)


def test_the_ground_of_a_simulated_flight_is_the_surface_of_its_altimeter(practice_06):
    ground = ground_height(practice_06)
    assert abs(ground.height) < 3.0 * ground.sigma and not ground.significant
    readings = ground_height(at_known_time(practice_06, 0.0)).sigma
    assert 3.0 < ground.sigma < 3.6 and ground.sigma == pytest.approx(
        ground_height(at_known_time(practice_06, 0.02)).sigma
    )
    assert ground_height(at_known_time(practice_06, 0.5)).sigma == pytest.approx(
        np.sqrt(readings**2 + (0.5 * 70.4) ** 2), rel=0.02
    )


def at_known_time(reconstruction, sigma):
    """The same with a sigma of the touchdown's time, s."""
    return replace(reconstruction, telemetry=replace(reconstruction.telemetry, event_sigmas={"landing": sigma}))


def test_a_rejected_reading_and_another_surface_do_not_change_it(practice_06):
    ground = ground_height(practice_06)
    fused = practice_06.filter_pass.fused
    altimeter = [k for k, use in enumerate(fused) if use.constraint.name == "altimeter"]
    last = fused[altimeter[-1]]
    spoilt = replace(last, accepted=False, constraint=replace(last.constraint, height=1e4))
    rejected = [*fused[: altimeter[-1]], spoilt, *fused[altimeter[-1] + 1 :]]
    without = ground_height(replace(practice_06, filter_pass=replace(practice_06.filter_pass, fused=rejected)))
    assert without.height == pytest.approx(ground.height, abs=ground.sigma)
    assert without.sigma > ground.sigma
    none = [use for use in fused if use.constraint.name != "altimeter"]
    assert ground_height(replace(practice_06, filter_pass=replace(practice_06.filter_pass, fused=none))) is None
