"""Unmodelled acceleration: against the joint Gaussian of its processes, and estimated from simulated ones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal
from unmodelled_flights import DT, FORCE_SIGMA, RATE_SIGMA, STEP_SIGMA, flight, residuals_of, simulated_process

from edl_filter.diagnosis.noise.unmodelled_acceleration import (
    UnmodelledAcceleration,
    accelerations,
    augment,
    in_words,
    largest_sigmas,
    most_likely_process,
)
from edl_filter.diagnosis.prediction.predicted_readings import bin_average, triangular_integral
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.results.verdicts import Form

SETTINGS = DecisionSettings()
#: Of the selection: fixed to the body with two correlation times, constant or not; four with a regressor; a drift.
PRICE = np.log(9.0)


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


def loads_by_axis(case, unmodelled):
    """Slow twin of `accelerations`: one process, one node after the other."""
    flow = case[-1]
    out = []
    for k in range(len(flow.speed)):
        scale = flow.dynamic_pressure[k] / max(flow.dynamic_pressure) if unmodelled.with_pressure else 1.0
        if unmodelled.form == "fixed to the body":
            sizes = [unmodelled.force] * 3 + [unmodelled.moment] * 3
            out.append([[scale * sizes[i] if i == j else 0.0 for j in range(6)] for i in range(6)])
            continue
        x_axis = np.array([1.0, 0.0, 0.0])
        vector = flow.rate[k] if unmodelled.form == "angular rate" else flow.velocity_body[k] / flow.speed[k]
        along = vector - (vector @ x_axis) * x_axis
        across = np.cross(x_axis, along)
        if not unmodelled.with_pressure:
            forces = moments = (along, across)
        elif unmodelled.form == "angular rate":
            forces = moments = (across,)
        else:  # side force and Magnus moment
            forces, moments = (across,), (along,)
        zero = np.zeros(3)
        columns = [np.append(unmodelled.force * scale * f, zero) for f in forces]
        columns += [np.append(zero, unmodelled.moment * scale * m) for m in moments]
        out.append(np.transpose(columns))
    return np.array(out)


KINDS = [(form, with_pressure) for form in (Form.BODY, Form.RATE, Form.ANGLE) for with_pressure in (False, True)]


@pytest.mark.parametrize(("form", "with_pressure"), KINDS)
def test_accelerations_of_one_sigma(form, with_pressure):
    case, unmodelled = flight(5), UnmodelledAcceleration(0.02, 0.004, 0.7, with_pressure, form)
    expected = loads_by_axis(case, unmodelled)
    np.testing.assert_allclose(accelerations(case[-1], unmodelled), expected, rtol=1e-12, atol=1e-18)
    sigma = np.sqrt(np.sum(expected**2, axis=2))
    assert largest_sigmas(case[-1], unmodelled) == pytest.approx((sigma[:, :3].max(), sigma[:, 3:].max(), 0.0))


def test_a_process_that_is_fixed_to_the_body_has_its_amplitudes_as_largest_sigmas():
    flow = flight(5)[-1]
    for with_pressure in (False, True):
        assert largest_sigmas(flow, UnmodelledAcceleration(0.02, 0.004, 0.7, with_pressure)) == (0.02, 0.004, 0.0)


@pytest.mark.parametrize(("form", "with_pressure"), KINDS)
def test_the_process_is_a_gauss_markov_process(form, with_pressure):
    """The likelihood is the joint Gaussian's: ``sum_c s_ic s_jc exp(-|t_i - t_j| / memory)`` plus noise."""
    count, unmodelled = 25, UnmodelledAcceleration(0.02, 0.004, 0.7, with_pressure, form)
    case = flight(count)
    _, index, bins, _ = case
    residuals = simulated(case, np.random.default_rng(3), 0.02, 0.004, 0.7)
    at_nodes = loads_by_axis(case, unmodelled)
    size = np.zeros((index.count, at_nodes.shape[2]))
    time, sigma = np.empty(index.count), np.empty(index.count)
    means = {0: bin_average(at_nodes[:, :3], bins), 3: triangular_integral(at_nodes[:, 3:], bins)}
    for first, mean in means.items():
        for k in range(len(mean)):
            rows = index.bin_rows[k, first : first + 3]
            if rows[0] >= 0:
                size[rows], time[rows], sigma[rows] = mean[k], bins.edges[k + 1], STEP_SIGMA if first else FORCE_SIGMA
    correlation = np.exp(-np.abs(time[:, None] - time) / unmodelled.memory)
    covariance = size @ size.T * correlation + np.diag(sigma**2)
    expected = multivariate_normal.logpdf(residuals, cov=covariance) + 0.5 * index.count * np.log(2.0 * np.pi)
    assert log_likelihood(case, residuals, unmodelled) == pytest.approx(expected, rel=1e-9)


@given(st.floats(0.1, 100.0), st.floats(1e-4, 1.0), st.sampled_from(KINDS))
def test_the_process_is_stationary(memory, size, kind):
    """One sigma at the beginning is one sigma at all times, whatever the correlation time and the steps."""
    form, with_pressure = kind
    model = augment(*flight(4), UnmodelledAcceleration(size, size, memory, with_pressure, form))
    one = np.eye(model.size)
    for k in range(len(model.process_noise)):
        transition, noise = one + model.increment[k], model.process_noise[k]
        np.testing.assert_allclose(transition @ transition.T + noise, one, atol=1e-12)


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
    assert likelihood == max(evaluated.values()) - PRICE and likelihood > evaluated[UnmodelledAcceleration()] + 100.0
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


@pytest.mark.parametrize(
    ("form", "with_pressure", "direction", "moment"),
    [
        (Form.RATE, False, 0, 2e-3),  # as a damping that is independent of the air
        (Form.RATE, False, 1, 2e-3),  # as a wheel that spins about the axis of symmetry
        (Form.RATE, True, 0, 5e-3),
        (Form.ANGLE, False, 0, 1.5e-2),
        (Form.ANGLE, True, 0, 2e-2),  # a Magnus moment
    ],
)
def test_a_moment_in_proportion_to_a_regressor_is_recognised(form, with_pressure, direction, moment):
    """In every bin it is below the noise, and a process that is fixed to the body does not show it.

    Its factor may change, so that one that is constant may be as likely as one in proportion to the pressure.
    """
    case, rng = flight(1600), np.random.default_rng(8)
    shape = accelerations(case[-1], UnmodelledAcceleration(0.0, moment, 1.0, with_pressure, form))
    missing = shape[:, :, shape.shape[2] // 2 + direction]
    residuals = residuals_of(case, rng, missing)
    steps = triangular_integral(missing[:, 3:], case[2])
    assert np.sqrt(np.mean(steps[:, 1:] ** 2)) < 0.3 * STEP_SIGMA

    def fixed_to_the_body(unmodelled):
        return -np.inf if unmodelled.form != Form.BODY else log_likelihood(case, residuals, unmodelled)

    none = log_likelihood(case, residuals, UnmodelledAcceleration())
    estimate, likelihood = most_likely_process(lambda u: log_likelihood(case, residuals, u), SETTINGS)
    assert estimate.form is form
    assert likelihood - none > 15.0
    assert most_likely_process(fixed_to_the_body, SETTINGS)[1] - none < 3.0


def test_a_side_force_in_proportion_to_the_angle_of_attack_is_recognised():
    case, rng = flight(1600), np.random.default_rng(9)
    missing = accelerations(case[-1], UnmodelledAcceleration(0.05, 0.0, 1.0, True, Form.ANGLE))[:, :, 0]
    residuals = residuals_of(case, rng, missing)
    none = log_likelihood(case, residuals, UnmodelledAcceleration())
    estimate, likelihood = most_likely_process(lambda u: log_likelihood(case, residuals, u), SETTINGS)
    assert estimate.form is Form.ANGLE and estimate.with_pressure and likelihood - none > 15.0
    assert in_words(replace(estimate, moment=0.0)) == (
        "a force in proportion to the angle of attack and to the dynamic pressure"
    )


def drifting(case, rng, force, rate, memory):
    """Residuals with noise and a Gauss–Markov drift of the axes of each checking IMU."""
    model, index, _, _ = case
    residuals = np.sqrt(model.row_noise[np.arange(index.count), index.column]) * rng.normal(size=index.count)
    decay = np.exp(-DT / memory)
    for column in range(6, index.bin_rows.shape[1]):
        drift = rng.normal()
        for row in index.bin_rows[:, column]:
            residuals[row] += (force if column % 6 < 3 else rate) * drift
            drift = decay * drift + np.sqrt(1.0 - decay**2) * rng.normal()
    return residuals


def test_a_drift_of_a_checking_imu_is_a_gauss_markov_process():
    """Against the joint Gaussian of each axis."""
    case = flight(20, checking=2)
    _, index, bins, _ = case
    unmodelled = UnmodelledAcceleration(4e-3, 2e-4, 3.0, form=Form.IMU)
    residuals = drifting(case, np.random.default_rng(1), 4e-3, 2e-4, 3.0)
    correlation = np.exp(-np.abs(bins.edges[1:, None] - bins.edges[1:]) / 3.0)
    expected = 0.5 * index.count * np.log(2.0 * np.pi)
    for column in range(18):
        rows = index.bin_rows[index.bin_rows[:, column] >= 0, column]
        is_force = column % 6 < 3
        size = 0.0 if column < 6 else 4e-3 if is_force else 2e-4
        sigma = FORCE_SIGMA if is_force else STEP_SIGMA if column < 6 else RATE_SIGMA
        covariance = size**2 * correlation[: len(rows), : len(rows)] + sigma**2 * np.eye(len(rows))
        expected += multivariate_normal.logpdf(residuals[rows], cov=covariance)
    assert log_likelihood(case, residuals, unmodelled) == pytest.approx(expected, rel=1e-9)
    assert largest_sigmas(case[-1], unmodelled) == (4e-3, 0.0, 2e-4)


@pytest.mark.parametrize(("force", "rate"), [(3e-3, 0.0), (0.0, 6e-5), (3e-3, 6e-5)])
def test_a_drift_of_one_imu_is_recognised(force, rate):
    """It is below the noise of a bin."""
    case = flight(1600, checking=1)
    residuals = drifting(case, np.random.default_rng(11), force, rate, 60.0)
    none = log_likelihood(case, residuals, UnmodelledAcceleration())
    estimate, likelihood = most_likely_process(lambda u: log_likelihood(case, residuals, u), SETTINGS)
    assert estimate.form is Form.IMU and likelihood - none > 15.0
    assert (estimate.force > 0.0) == (force > 0.0) and (estimate.moment > 0.0) == (rate > 0.0)


def test_two_imus_with_noise_alone_do_not_drift():
    case, gains = flight(200, checking=1), []
    for seed in range(10):
        residuals = drifting(case, np.random.default_rng(seed), 0.0, 0.0, 60.0)
        _, likelihood = most_likely_process(lambda u, r=residuals: log_likelihood(case, r, u), SETTINGS)
        gains.append(likelihood - log_likelihood(case, residuals, UnmodelledAcceleration()))
    assert min(gains) >= 0.0 and max(gains) < 6.0


@pytest.mark.parametrize(
    ("unmodelled", "text"),
    [
        (UnmodelledAcceleration(0.1, 0.1), "a force and a moment fixed to the body"),
        (
            UnmodelledAcceleration(0.0, 0.1, with_pressure=True),
            "a moment fixed to the body in proportion to the dynamic pressure",
        ),
        (UnmodelledAcceleration(0.1, 0.0, form=Form.RATE), "a force in proportion to the angular rate"),
        (UnmodelledAcceleration(0.1, 0.1, form=Form.IMU), "a drift of the accelerometers and gyros of one IMU"),
        (UnmodelledAcceleration(0.0, 0.1, form=Form.IMU), "a drift of the gyros of one IMU"),
    ],
)
def test_a_process_in_words(unmodelled, text):
    assert in_words(unmodelled) == text


def test_noise_alone_has_no_significant_acceleration():
    case = flight(200)
    gains = []
    for seed in range(10):
        residuals = simulated(case, np.random.default_rng(seed))
        estimate, likelihood = most_likely_process(lambda u, r=residuals: log_likelihood(case, r, u), SETTINGS)
        gains.append(likelihood - log_likelihood(case, residuals, UnmodelledAcceleration()))
        force, moment, _ = largest_sigmas(case[-1], estimate)
        assert force < FORCE_SIGMA and moment * DT < 5.0 * STEP_SIGMA
    assert min(gains) >= 0.0 and max(gains) < 6.0


def paraboloid(u, maximum):
    """Of the logarithms of the amplitudes, and lower for another kind or correlation time."""
    pairs = (u.moment, maximum.moment), (u.force, maximum.force)
    distance = [np.log(max(a, 1e-6) / b) for a, b in pairs]
    kind = (u.memory != maximum.memory, u.with_pressure != maximum.with_pressure, u.form != maximum.form)
    nothing = 100.0 * (u == UnmodelledAcceleration())
    return -np.square(distance).sum() - sum(kind) - nothing


@given(
    st.sampled_from(SETTINGS.unmodelled_factors[1:]),
    st.sampled_from(SETTINGS.unmodelled_factors[1:]),
    st.sampled_from(SETTINGS.unmodelled_factor_memories_s),
    st.sampled_from(KINDS[2:]),
)
def test_the_search_of_factors_ends_at_a_maximum_of_its_grid(moment, force, memory, kind):
    form, with_pressure = kind
    maximum = UnmodelledAcceleration(force, moment, memory, with_pressure, form)
    estimate, likelihood = most_likely_process(lambda u: paraboloid(u, maximum), SETTINGS)
    assert estimate == maximum
    assert likelihood == pytest.approx(-PRICE, abs=1e-12)


@given(
    st.sampled_from(SETTINGS.unmodelled_moments[1:]),
    st.sampled_from(SETTINGS.unmodelled_forces[1:]),
    st.sampled_from(SETTINGS.unmodelled_memories_s),
    st.booleans(),
)
def test_the_search_ends_at_a_maximum_of_its_grid(moment, force, memory, with_pressure):
    """A paraboloid in the logarithms of the amplitudes with its maximum on the grid."""
    maximum = UnmodelledAcceleration(force, moment, memory, with_pressure)
    estimate, likelihood = most_likely_process(lambda u: paraboloid(u, maximum), SETTINGS)
    assert estimate == maximum
    assert likelihood == pytest.approx(-PRICE, abs=1e-12)


@pytest.mark.parametrize("maximum", [0.03, 0.1 / 3.0])
def test_the_search_refines_by_a_factor_of_three(maximum):
    """Upwards from 0.01, downwards from 0.1."""
    estimate, _ = most_likely_process(lambda u: -(np.log(max(u.moment, 1e-6) / maximum) ** 2) - 1e6 * u.force, SETTINGS)
    assert estimate.moment == pytest.approx(maximum) and estimate.force == 0.0


def test_the_grid_is_a_setting():
    settings = DecisionSettings(unmodelled_memories_s=(2.0,), unmodelled_moments=(1.0,), unmodelled_forces=(0.5,))
    estimate, _ = most_likely_process(lambda u: 9.0 * (u.moment + u.force) * (u.form is Form.BODY), settings)
    assert estimate == UnmodelledAcceleration(0.5 * 3.0, 1.0 * 3.0, 2.0, False)
    settings = DecisionSettings(unmodelled_factor_memories_s=(7.0,), unmodelled_factors=(0.2,))
    estimate, _ = most_likely_process(lambda u: 9.0 * (u.moment + u.force) * (u.form is Form.ANGLE), settings)
    assert estimate == UnmodelledAcceleration(0.2 * 3.0, 0.2 * 3.0, 7.0, False, Form.ANGLE)
