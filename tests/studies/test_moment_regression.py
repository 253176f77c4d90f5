"""Regression of residual moments on candidates: what explains all, a part, or nothing of constructed residuals."""

import numpy as np
import pytest
from moment_regression import candidates, explained_share, lateral_residuals

from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.linear_model.linearization import linearize_at
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point

TIME = 100.0 + 0.1 * np.arange(1000)
PRESSURE = np.exp(-0.5 * ((TIME - 150.0) / 20.0) ** 2)
ZERO = np.zeros_like(TIME)
BODY_FIXED = (PRESSURE, ZERO), (ZERO, PRESSURE)


def test_a_moment_whose_coefficients_are_linear_between_the_knots_is_explained():
    coefficient = np.interp(TIME, 100.0 + 20.0 * np.arange(6), [1.0, -2.0, 0.5, 3.0, 0.0, 1.0])
    residuals = np.stack((coefficient * PRESSURE, -2.0 * coefficient * PRESSURE), axis=1)
    assert explained_share(TIME, residuals, BODY_FIXED, 20.0) == pytest.approx(1.0, abs=1e-12)
    assert explained_share(TIME, residuals, BODY_FIXED, 5.0) == pytest.approx(1.0, abs=1e-12)


def test_noise_is_explained_as_far_as_there_are_coefficients():
    """Of 2000 values by 2 x 22 coefficients: 2.2 %."""
    rng = np.random.default_rng(4)
    ones = (np.ones_like(TIME), ZERO), (ZERO, np.ones_like(TIME))
    shares = [explained_share(TIME, rng.normal(size=(1000, 2)), ones, 5.0) for _ in range(100)]
    assert np.mean(shares) == pytest.approx(42.0 / 2000.0, rel=0.1)


def test_a_sum_is_explained_in_part():
    rng = np.random.default_rng(5)
    noise = rng.normal(size=(1000, 2))
    signal = np.stack((PRESSURE, PRESSURE), axis=1)
    noise *= np.sqrt(np.mean(signal**2) / np.mean(noise**2))
    assert explained_share(TIME, signal + noise, BODY_FIXED, 20.0) == pytest.approx(0.5, abs=0.03)


@pytest.fixture(scope="module")
def model(practice_06):
    case = flight_case(practice_06)
    return linearize_at(case, smoothed_point(case.reconstruction))


def test_residuals_and_candidates_of_a_flight(model):
    """The moment of the database itself is along the plane of the angle, and no candidate is zero."""
    time, residuals, bins = lateral_residuals(model)
    assert len(time) == len(residuals) == len(bins) > 1000 and np.isfinite(residuals).all()
    assert np.all(np.diff(time) > 0.0) and time[-1] < model.bins.edges[-1] - 1.0
    pairs = candidates(model, time, bins)
    assert all(
        np.any(component) for name, pair in pairs.items() if "fixed" not in name for m in pair for component in m
    )
    flow, forward = model.residuals.flow, model.inputs.forward_model
    moment = forward.loads(flow, model.residuals.tables)[1]
    predicted = np.stack([np.interp(time, flow.time, moment[:, i]) for i in (1, 2)], axis=1)
    along = pairs["moment along and across the plane of the angle"]
    assert explained_share(time, predicted, along, 5.0) > 0.95
    assert explained_share(time, predicted, pairs["moment fixed to the body"], 20.0) < 0.5
