"""The smoothed unmodelled force and moment against the simulated ones."""

from types import SimpleNamespace

import numpy as np
import pytest
from unmodelled_flights import flight, residuals_of, simulated_process

from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration, amplitude, augment
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.diagnosis.residual_analysis.latent_force import estimate_latent_force
from edl_filter.effects.types import Body

MASS = 800.0
INERTIA = np.array([[250.0, 5.0, -3.0], [5.0, 180.0, 4.0], [-3.0, 4.0, 200.0]])
BODY = Body(MASS, INERTIA)


def model_of(case, residuals):
    """What a linearised model must have."""
    state_space, index, bins, flow = case
    return SimpleNamespace(
        index=index,
        bins=bins,
        residuals=SimpleNamespace(flow=flow),
        inputs=SimpleNamespace(forward_model=SimpleNamespace(bodies=lambda time: [(slice(None), BODY)])),
        initial_mean=np.zeros(0),
        state_space_with_unmodelled=lambda u: augment(state_space, index, bins, flow, u),
        white_residuals=lambda whiten: whiten(residuals[:, None], np.zeros((0, 1)))[:, 0],
    )


def sample_model(model, rng):
    """States ``(K, n)`` and measurements ``(R,)`` that are drawn from a state-space model."""
    x = np.linalg.cholesky(model.initial_covariance) @ rng.normal(size=model.size)
    states, measurements = [], []
    for k in range(len(model.increment)):
        x = x + model.increment[k] @ x + np.sqrt(np.diag(model.process_noise[k])) * rng.normal(size=model.size)
        rows = slice(model.row_start[k], model.row_start[k + 1])
        sigma = np.sqrt(np.diag(model.row_noise[rows]))
        measurements.append(model.design[rows] @ x + sigma * rng.normal(size=rows.stop - rows.start))
        states.append(x)
    return np.array(states), np.concatenate(measurements)


@pytest.mark.parametrize("with_pressure", [False, True])
def test_errors_have_the_stated_sigmas(with_pressure):
    """Of force and moment, in N and N m in body axes, drawn from the model; the errors of bins are correlated."""
    unmodelled = UnmodelledAcceleration(0.1, 0.02, 2.0, with_pressure)
    case, rng, standardised = flight(300), np.random.default_rng(2), []
    scale = amplitude(case[3], unmodelled)[NODES_PER_BIN // 2 :: NODES_PER_BIN, None]
    state_space = augment(*case, unmodelled)
    for _ in range(5):
        states, residuals = sample_model(state_space, rng)
        latent = estimate_latent_force(model_of(case, residuals), unmodelled)
        force, moment = MASS * 0.1 * scale * states[:, :3], 0.02 * scale * states[:, 3:] @ INERTIA.T
        standardised.append(
            ((latent.force - force) / latent.force_sigma, (latent.moment - moment) / latent.moment_sigma)
        )
    for errors in np.swapaxes(standardised, 0, 1):
        assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(latent.time, case[2].middle)


def test_a_continuous_force_and_moment_are_recovered():
    """The process varies within the bins, which the model neglects."""
    case, rng = flight(300), np.random.default_rng(2)
    process = simulated_process(case, rng, 0.1, 0.02, 10.0)
    residuals = residuals_of(case, rng, process)
    latent = estimate_latent_force(model_of(case, residuals), UnmodelledAcceleration(0.1, 0.02, 10.0))
    middle = process[NODES_PER_BIN // 2 :: NODES_PER_BIN]
    for estimate, true in ((latent.force, MASS * middle[:, :3]), (latent.moment, middle[:, 3:] @ INERTIA.T)):
        assert np.sqrt(np.mean((estimate - true) ** 2)) < 0.15 * np.sqrt(np.mean(true**2))


def test_there_is_none_where_the_process_is_zero():
    case = flight(20)
    assert estimate_latent_force(model_of(case, np.zeros(case[1].count)), UnmodelledAcceleration()) is None
