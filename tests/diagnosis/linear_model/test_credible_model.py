"""Scale and lengths of the database's error by marginal likelihood, and the alternative mode of a failing model."""

from types import SimpleNamespace

import numpy as np
import pytest
from constructed_models import SETTINGS, constructed_model

from edl_filter import Mission
from edl_filter.diagnosis.linear_model import credible_model as module
from edl_filter.diagnosis.linear_model.credible_model import (
    credible_model,
    relinearize_failing_model,
    with_estimated_discrepancy,
)
from edl_filter.diagnosis.linear_model.flight_case import EstimatedQuantity, load_case
from edl_filter.errors import InputError

NAMES = ("coefficient_sigma", "log_mach_length")


def case_of(builtin_flight, *changes):
    fixed = [f"telemetry.path={builtin_flight}", "aerodynamics.coefficient_sigma=0.5"]
    return load_case(Mission.load("builtin:practice_mer", [*fixed, *changes]))


def estimated(names):
    return f"aerodynamics.discrepancy.estimate=[{', '.join(names)}]"


def test_nothing_is_estimated_unless_asked(builtin_flight):
    case = case_of(builtin_flight)
    assert with_estimated_discrepancy(case) is case


def test_the_estimate_is_the_maximum_of_a_known_posterior(builtin_flight, monkeypatch):
    """A quadratic log-likelihood in the logarithms: the posterior's maximum in closed form, within the tolerance."""
    case = case_of(builtin_flight, estimated(NAMES))
    best, information = np.log([0.8, 0.35]), np.array([40.0, 9.0])

    def log_likelihood(case):
        prior = case.uncertainty.discrepancy
        at = np.log([prior.scale, prior.log_mach_length])
        return -0.5 * float(information @ (at - best) ** 2)

    monkeypatch.setattr(module, "_log_evidence", log_likelihood)
    stated, weight = np.log([0.5, 0.5]), case.settings.discrepancy_sigma**-2
    expected = np.exp((information * best + weight * stated) / (information + weight))
    out = with_estimated_discrepancy(case)
    quantities = {q.name: q for q in out.discrepancy_estimate.quantities}
    for name, value in zip(NAMES, expected, strict=True):
        assert quantities[name].estimate == pytest.approx(value, rel=0.05)
        assert quantities[name].stated == 0.5 and not quantities[name].at_bound
    assert out.uncertainty.discrepancy.scale == pytest.approx(expected[0], rel=0.05)
    assert out.mission.aerodynamics.discrepancy.estimate == ()
    assert with_estimated_discrepancy(out) is out
    assert out.discrepancy_estimate.gain > 0.0


def test_an_estimate_stays_within_its_bounds_and_says_so(builtin_flight, monkeypatch):
    case = case_of(builtin_flight, estimated(["coefficient_sigma"]), "diagnosis.discrepancy_range=2")
    monkeypatch.setattr(module, "_log_evidence", lambda case: 1e3 * case.uncertainty.discrepancy.scale)
    (quantity,) = with_estimated_discrepancy(case).discrepancy_estimate.quantities
    assert quantity.estimate == pytest.approx(1.0, rel=1e-3) and quantity.at_bound
    assert (quantity.low, quantity.high) == pytest.approx((0.25, 1.0))


@pytest.mark.slow
def test_an_exact_world_has_a_small_error_of_the_database(builtin_flight):
    """The flight was simulated with the database itself: the estimate is at the lower bound, in every later model."""
    case = case_of(builtin_flight, estimated(["coefficient_sigma"]))
    model, _ = credible_model(case)
    (quantity,) = model.case.discrepancy_estimate.quantities
    assert quantity.estimate < 0.25
    assert model.case.uncertainty.discrepancy.scale == quantity.estimate


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (estimated(["coefficient_sigma", "coefficient_sigma"]), "each name once"),
        (estimated(["angle_length"]), "angle_length_deg"),
        ("aerodynamics.coefficient_sigma=0", "none, since coefficient_sigma is 0"),
    ],
)
def test_bad_input_is_named(change, message, builtin_flight):
    with pytest.raises(InputError, match=message):
        case_of(builtin_flight, estimated(["coefficient_sigma"]), change)


@pytest.mark.parametrize(("estimate", "at_bound"), [(1.0, False), (3.99, True), (0.2501, True)])
def test_a_bound_is_recognised(estimate, at_bound):
    assert EstimatedQuantity("coefficient_sigma", 1.0, estimate, 0.25, 4.0).at_bound is at_bound


def test_a_failing_model_is_relinearised_to_where_it_is_more_probable(monkeypatch):
    """It need not hold there: what a nuisance parameter absorbs in part is no evidence for an effect."""
    likelihoods = [0.0, 30.0, 20.0, 10.0]
    models = [constructed_model(k, 0.5 * 0.7**k, value) for k, value in enumerate(likelihoods)]
    monkeypatch.setattr(module, "iterate_point", lambda case, iterations, max_share, first: iter(models[:iterations]))
    assert relinearize_failing_model(SimpleNamespace(settings=SETTINGS), models[0]) is models[1]


def test_the_price_of_the_noise_counts_against_the_likelihood_of_a_point(monkeypatch):
    """The second point is more likely by 30 nats, with variances whose price is 40 nats more."""
    models = [constructed_model(0, 0.5, 0.0), constructed_model(1, 0.35, 30.0, penalty=40.0)]
    monkeypatch.setattr(module, "iterate_point", lambda case, iterations, max_share, first: iter(models))
    assert relinearize_failing_model(SimpleNamespace(settings=SETTINGS), models[0]) is None


def test_of_the_points_at_which_the_model_holds_the_most_likely_is_taken(monkeypatch):
    """The first one need not have converged, and what it has not gained yet would be a gain of every effect."""
    shares, likelihoods = [0.1, 0.05, 0.0, 0.0, 0.0], [90.0, 80.0, 10.0, 60.0, 14.0]
    models = [constructed_model(k, s, v) for k, (s, v) in enumerate(zip(shares, likelihoods, strict=True))]
    monkeypatch.setattr(module, "iterate_point", lambda case, iterations, max_share, first: iter(models[:iterations]))
    assert relinearize_failing_model(SimpleNamespace(settings=SETTINGS), models[0]) is models[3]


@pytest.mark.parametrize(
    ("shares", "index"),
    [
        ([0.1, 0.05, 0.01, 0.0, 0.01], 3),  # where no row has excess variance
        ([0.1, 0.05, 0.01], 2),  # where it holds, if that is the last point
        ([0.1, 0.05, 0.01, 0.03, 0.0], 2),  # not where it fails again
        ([0.1, 0.05, 0.045, 0.0], None),  # the progress is too small
        ([0.1, 0.07, 0.05, 0.03, 0.0], None),  # not soon enough
        ([0.02, 0.0], None),  # it holds as it is
    ],
)
def test_a_failing_model_is_relinearised_to_where_it_holds(monkeypatch, shares, index):
    models = [constructed_model(k, share, 0.0) for k, share in enumerate(shares)]
    monkeypatch.setattr(module, "iterate_point", lambda case, iterations, max_share, first: iter(models[:iterations]))
    alternative = relinearize_failing_model(SimpleNamespace(settings=SETTINGS), models[0])
    assert alternative is (None if index is None else models[index])
