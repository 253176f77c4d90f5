"""Unmodelled acceleration: against the joint Gaussian of a Gauss–Markov process, and estimated from a simulated one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal
from unmodelled_flights import DT, FORCE_SIGMA, STEP_SIGMA, flight, residuals_of, simulated_process

from edl_filter.diagnosis.noise.unmodelled_acceleration import (
    UnmodelledAcceleration,
    amplitude,
    augment,
    most_likely_process,
)
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.prediction.predicted_readings import bin_average, triangular_integral
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()


def log_likelihood(case, residuals, unmodelled):
    whiten = whitening_filter(augment(*case, unmodelled))
    return whiten.log_likelihood(whiten(residuals[:, None], np.zeros((0, 1)))[:, 0])


def simulated(case, rng, *parameters, **named):
    """Residuals of a Gauss–Markov force and moment that are sampled at the nodes, with the stated noise."""
    return residuals_of(case, rng, simulated_process(case, rng, *parameters, **named))


def test_no_acceleration_leaves_the_model_as_it_is():
    case = flight(20)
    none = UnmodelledAcceleration(memory=3.0, with_pressure=True)
    assert none.is_zero and augment(*case, none) is case[0]


@pytest.mark.parametrize("with_pressure", [False, True])
def test_the_process_is_a_gauss_markov_process(with_pressure):
    """The likelihood is the joint Gaussian's with covariance ``s_i s_j exp(-|t_i - t_j| / memory)`` plus noise."""
    count, unmodelled = 25, UnmodelledAcceleration(0.02, 0.004, 0.7, with_pressure)
    case = flight(count)
    _, index, bins, flow = case
    residuals = simulated(case, np.random.default_rng(3), 0.02, 0.004, 0.7)
    time = bins.edges[1:]
    correlation = np.exp(-np.abs(time[:, None] - time) / unmodelled.memory)
    pressure = flow.dynamic_pressure / flow.dynamic_pressure.max()
    scale = pressure if with_pressure else np.ones(NODES_PER_BIN * count + 1)
    np.testing.assert_allclose(amplitude(flow, unmodelled), scale, rtol=1e-15)
    expected = 0.0
    for axis in range(6):
        rows = index.bin_rows[:, axis]
        rows = rows[rows >= 0]
        is_force = axis < 3
        size = (
            unmodelled.force * bin_average(scale, bins)
            if is_force
            else (unmodelled.moment * triangular_integral(scale, bins))
        )
        n, sigma = len(rows), FORCE_SIGMA if is_force else STEP_SIGMA
        covariance = size[:, None] * correlation[:n, :n] * size + sigma**2 * np.eye(n)
        constant = 0.5 * n * np.log(2.0 * np.pi)
        expected += multivariate_normal.logpdf(residuals[rows], cov=covariance) + constant
    assert log_likelihood(case, residuals, unmodelled) == pytest.approx(expected, rel=1e-9)


@given(st.floats(0.1, 100.0), st.floats(1e-4, 1.0))
def test_the_process_is_stationary(memory, size):
    """One sigma at the beginning is one sigma at all times, whatever the correlation time and the steps."""
    model = augment(*flight(4), UnmodelledAcceleration(size, size, memory))
    for k in range(len(model.process_noise)):
        transition, noise = np.eye(6) + model.increment[k], model.process_noise[k]
        np.testing.assert_allclose(transition @ transition.T + noise, np.eye(6), atol=1e-12)


def test_the_model_that_is_augmented_is_not_changed():
    case = flight(10)
    augment(*case, UnmodelledAcceleration(0.1, 0.1))
    assert not case[0].design.any() and not case[0].process_noise.values.any()


@pytest.mark.parametrize(("memory", "size"), [(0.5, 0.01), (10.0, 0.02), (10.0, 0.2)])
def test_a_missing_moment_is_estimated(memory, size):
    """A Gauss–Markov moment is far more likely than none, and its amplitude is that of the simulation."""
    case = flight(400)
    residuals = simulated(case, np.random.default_rng(5), moment=size, memory=memory)
    evaluated = {}

    def evaluate(unmodelled):
        evaluated[unmodelled] = log_likelihood(case, residuals, unmodelled)
        return evaluated[unmodelled]

    estimate, likelihood = most_likely_process(evaluate, SETTINGS)
    assert likelihood == max(evaluated.values()) and likelihood > evaluated[UnmodelledAcceleration()] + 100.0
    assert size / 3.0 < estimate.moment < size * 3.0
    assert estimate.force < FORCE_SIGMA  # no force of the noise's size
    assert estimate.memory == memory and not estimate.with_pressure


def test_between_the_values_of_the_grid_the_diffusion_is_estimated():
    """A flight determines amplitude² over correlation time well; another pair may have the same."""
    case = flight(400)
    residuals = simulated(case, np.random.default_rng(5), moment=0.02, memory=0.5)
    estimate, _ = most_likely_process(lambda u: log_likelihood(case, residuals, u), SETTINGS)
    relative_diffusion = estimate.moment**2 / estimate.memory / (0.02**2 / 0.5)
    assert 0.1 < relative_diffusion < 10.0


def test_proportionality_to_the_dynamic_pressure_is_recognised():
    case = flight(400)
    scale = case[-1].dynamic_pressure / case[-1].dynamic_pressure.max()
    residuals = simulated(case, np.random.default_rng(6), 0.1, 0.01, 0.5, scale)

    def constant_only(unmodelled):
        return -np.inf if unmodelled.with_pressure else log_likelihood(case, residuals, unmodelled)

    estimate, likelihood = most_likely_process(lambda u: log_likelihood(case, residuals, u), SETTINGS)
    assert estimate.with_pressure
    assert likelihood > most_likely_process(constant_only, SETTINGS)[1] + 100.0


def test_noise_alone_has_no_significant_acceleration():
    case = flight(200)
    gains = []
    for seed in range(10):
        residuals = simulated(case, np.random.default_rng(seed))
        estimate, likelihood = most_likely_process(lambda u, r=residuals: log_likelihood(case, r, u), SETTINGS)
        gains.append(likelihood - log_likelihood(case, residuals, UnmodelledAcceleration()))
        assert estimate.force < FORCE_SIGMA and estimate.moment * DT < 5.0 * STEP_SIGMA
    assert min(gains) >= 0.0 and max(gains) < 6.0


@given(
    st.sampled_from(SETTINGS.unmodelled_moments[1:]),
    st.sampled_from(SETTINGS.unmodelled_forces[1:]),
    st.sampled_from(SETTINGS.unmodelled_memories_s),
    st.booleans(),
)
def test_the_search_ends_at_a_maximum_of_its_grid(moment, force, memory, with_pressure):
    """A paraboloid in the logarithms of the amplitudes with its maximum on the grid."""

    def value(u):
        distance = [np.log(max(a, 1e-6) / b) for a, b in ((u.moment, moment), (u.force, force))]
        return -np.square(distance).sum() - (u.memory != memory) - (u.with_pressure != with_pressure)

    estimate, likelihood = most_likely_process(value, SETTINGS)
    assert estimate == UnmodelledAcceleration(force, moment, memory, with_pressure)
    assert likelihood == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("maximum", [0.03, 0.1 / 3.0])
def test_the_search_refines_by_a_factor_of_three(maximum):
    """Upwards from 0.01, downwards from 0.1."""
    estimate, _ = most_likely_process(lambda u: -(np.log(max(u.moment, 1e-6) / maximum) ** 2) - 1e6 * u.force, SETTINGS)
    assert estimate.moment == pytest.approx(maximum) and estimate.force == 0.0


def test_the_grid_is_a_setting():
    settings = DecisionSettings(unmodelled_memories_s=(2.0,), unmodelled_moments=(1.0,), unmodelled_forces=(0.5,))
    estimate, _ = most_likely_process(lambda u: u.moment + u.force, settings)
    assert estimate == UnmodelledAcceleration(0.5 * 3.0, 1.0 * 3.0, 2.0, False)
