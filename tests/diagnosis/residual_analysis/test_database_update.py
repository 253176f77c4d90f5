"""Increments of a database: equal to dense Gaussian process regression, and what is derived from them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from field_flights import ALPHA, CHANGE, PRIOR, Flight

from edl_filter import Mission
from edl_filter.aero.database import load_database
from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.increments import REGIMES, RegimeUpdate
from edl_filter.diagnosis.jacobians.coefficient_errors import database_units
from edl_filter.diagnosis.linear_model.flight_case import flight_case
from edl_filter.diagnosis.linear_model.linearization import linearize_at
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point
from edl_filter.diagnosis.residual_analysis.database_update import (
    _sigma_at_knots,
    estimate_database_update,
    posterior_at_knots,
)
from edl_filter.diagnosis.residual_analysis.field_posterior import FlownPath
from edl_filter.estimation.kalman import whitening_filter


def with_empty_steps(whiten, count):
    """The same filter after steps without rows or motion, as long as a flight is compared nowhere."""
    model = whiten.model
    increment, noise = (
        replace(m, values=np.concatenate((np.zeros((count, m.values.shape[1])), m.values)))
        for m in (model.increment, model.process_noise)
    )
    row_start = np.concatenate((np.zeros(count, int), model.row_start))
    return whitening_filter(replace(model, increment=increment, process_noise=noise, row_start=row_start))


@pytest.mark.parametrize("empty_steps", [0, 150])
def test_the_posterior_at_knots_is_that_of_dense_regression(empty_steps):
    flight = Flight()
    places = [
        np.linspace(flight.distance[0], flight.distance[2 * CHANGE[0] - 1], 4),
        flight.distance[-1] - np.arange(3.0),
    ]
    whiten, white = flight.white()
    mean, covariance, prior = posterior_at_knots(
        with_empty_steps(whiten, empty_steps),
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


#: Stands for increments of another flight that leave a quarter of the prior's variance everywhere.
LEARNED = SimpleNamespace(mean=(), remainder=lambda mach, knudsen, alpha, limit: np.full(np.shape(mach), 0.25))


@pytest.mark.parametrize("increments", [None, LEARNED], ids=["plain", "with increments of another flight"])
def test_the_sigma_at_the_knots_is_the_unit_of_the_amplitudes(increments):
    """A posterior amplitude is in the units that the path's field has at the same flow and angle."""
    count, prior = 5, DiscrepancyPrior(scale=0.6)
    database = replace(load_database(family="MER"), increments=increments)
    path = FlownPath(
        distance=np.arange(count, dtype=float), row_distance=np.zeros(0), mach=np.linspace(20.0, 3.0, count),
        knudsen=np.full(count, 1e-5), speed=np.linspace(5e3, 700.0, count), alpha_total=np.linspace(0.0, 0.1, count),
        rarefied=np.zeros(count, bool), compared=np.ones(count, bool),
    )  # fmt: skip
    model = SimpleNamespace(
        inputs=SimpleNamespace(forward_model=SimpleNamespace(database=database)),
        case=SimpleNamespace(uncertainty=SimpleNamespace(discrepancy=prior)),
    )
    flow = SimpleNamespace(
        time=path.distance, **{n: getattr(path, n) for n in ("mach", "knudsen", "speed", "alpha_total")}
    )
    units = database_units(model.inputs, SimpleNamespace(flow=flow), prior)
    sigma = _sigma_at_knots(model, path, path.distance, path.alpha_total)
    for c, name in enumerate(("ca", "cn", "cm")):
        np.testing.assert_allclose(np.diag(sigma[c]), getattr(units, name), rtol=1e-9)


def test_exact_tables_of_a_vehicle_with_an_asymmetry_have_no_increments(practice_06):
    """Its coefficients are nuisance parameters, one mode each; the tables have none."""
    changes = ["aerodynamics.coefficient_sigma=0", "aerodynamics.discrepancy.asymmetry_sigma=1"]
    mission = Mission.load("builtin:practice_mer", changes)
    case = flight_case(replace(practice_06, mission=mission))
    model = linearize_at(case, smoothed_point(case.reconstruction))
    assert {name: part.stop - part.start for name, part in model.nuisance.fields.items()} == {
        "ca": 0, "cn": 0, "cm": 0, "side_asymmetry": 1, "normal_asymmetry": 1, "pitch_asymmetry": 1, "yaw_asymmetry": 1
    }  # fmt: skip
    assert model.holds and estimate_database_update(model) is None
    start = np.diag(model.state_space.initial_covariance)[model.nuisance.fields["yaw_asymmetry"].start :][:2]
    np.testing.assert_allclose(start, [1.0, 3.0])
    # one sigma of the database's Cm above Mach 10, a third of 0.003, and of CN below the limit of the Knudsen number
    mach = model.residuals.flow.mach
    fast = (mach > 10.0) & (model.residuals.flow.knudsen < 1e-3)
    np.testing.assert_allclose(model.field.asymmetry.cm[fast], 0.001, rtol=1e-12)
    np.testing.assert_allclose(model.field.asymmetry.cn[fast], 0.01 / 3.0, rtol=1e-12)
