"""Increments of a database: equal to dense Gaussian process regression, and what is derived from them."""

import numpy as np
import pytest
from field_flights import ALPHA, CHANGE, PRIOR, Flight

from edl_filter.aero.increments import REGIMES, RegimeUpdate
from edl_filter.diagnosis.residual_analysis.database_update import posterior_at_knots


def test_the_posterior_at_knots_is_that_of_dense_regression():
    flight = Flight()
    places = [
        np.linspace(flight.distance[0], flight.distance[2 * CHANGE[0] - 1], 4),
        flight.distance[-1] - np.arange(3.0),
    ]
    whiten, white = flight.white()
    mean, covariance, prior = posterior_at_knots(
        whiten,
        white,
        flight.fields,
        flight.distance,
        PRIOR,
        flight.modes,
        dict(zip(REGIMES, places, strict=True)),
        dict.fromkeys(REGIMES, ALPHA),
    )
    dense_mean, dense_covariance = flight.dense(places)
    assert np.allclose(mean, dense_mean, rtol=0.0, atol=1e-8)
    assert np.allclose(covariance, dense_covariance, rtol=0.0, atol=1e-8)
    removed = 1.0 - np.diag(covariance)[np.diag(prior) > 0.0] / np.diag(prior)[np.diag(prior) > 0.0]
    assert removed.max() > 0.9 and np.all(removed > -1e-9)


def test_the_share_is_the_part_of_the_variance_that_the_data_removed():
    shape = (3, 1, 2)
    prior_sigma = np.array([[[0.1, 0.1]], [[0.0, 0.2]], [[0.0, 0.4]]])
    sigma, increment = np.full(shape, 0.1) * (prior_sigma > 0.0), np.full(shape, 0.05) * (prior_sigma > 0.0)
    update = RegimeUpdate("mach", np.ones(1), ALPHA[:2], increment, sigma, prior_sigma, np.zeros((1, 2), int))
    assert update.share[0, 0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert update.share[:, 0, 1] == pytest.approx([0.0, 0.75, 0.9375])
    assert update.share[1, 0, 0] == 0.0
    assert update.in_prior_sigmas[:, 0, 1] == pytest.approx([0.5, 0.25, 0.125])
