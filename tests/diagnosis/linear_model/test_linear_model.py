"""A linearised model: what the estimation of its noise starts with, and what it keeps."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis.linear_model import linear_model as module
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.noise.excess_colour import ExcessColour
from edl_filter.diagnosis.noise.variance_components import ExcessVariance
from edl_filter.estimation.block_sparse import from_blocks
from edl_filter.estimation.kalman import whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace, append_constant_states, with_gauss_markov_states
from edl_filter.mission.decision_settings import DecisionSettings

ROWS = 100


def excess_of(share, colour=None):
    significant = np.arange(ROWS) < share * ROWS
    return ExcessVariance(significant.astype(float), significant, 2.0 * bool(share), colour)


class UnitFilter:
    """A whitening filter of unit rows."""

    log_determinant = 3.0

    def __call__(self, columns, initial_mean):
        return 2.0 * columns

    def log_likelihood(self, white):
        return -0.5 * float(white @ white)


@pytest.fixture
def noise(monkeypatch):
    """Noise of a constructed model: share of the excess variance, its colour, and with what the estimation began.

    `white` says whether white excess variance is more likely than the most likely colour.
    """
    noise = SimpleNamespace(
        share=0.4, colour=((4, 1), (2, 0)), white=False, initial=[], initial_colour=[], stated=UnitFilter()
    )

    def estimate(stated, index, residuals, mean, settings, initial):
        noise.initial.append(initial)
        return excess_of(noise.share), UnitFilter()

    def colour(at_white, state_space, index, excess, residuals, mean, settings, initial):
        noise.initial_colour.append(initial)
        return None if excess.is_zero else ExcessColour(noise.colour, not noise.white)

    monkeypatch.setattr(module, "estimate_variance_components", estimate)
    monkeypatch.setattr(module, "most_likely_colour", colour)
    monkeypatch.setattr(module, "filter_at_excess", lambda *_: UnitFilter())
    monkeypatch.setattr(module, "add_variance", lambda state_space, index, excess: "with excess variance")
    monkeypatch.setattr(module, "whitening_filter", lambda space: UnitFilter() if space else noise.stated)
    return noise


def model_with(initial_excess=None, residuals=None):
    values = {f.name: None for f in fields(LinearizedModel)} | {
        "case": SimpleNamespace(settings=DecisionSettings()),
        "initial_excess": initial_excess, "computed_jacobians": {},
    }  # fmt: skip
    model = LinearizedModel(**values)
    model.__dict__["residual_vector"] = np.ones(ROWS) if residuals is None else residuals
    model.__dict__["initial_mean"] = np.zeros(3)
    return model


def test_a_failing_model_passes_on_its_excess_variance_with_the_most_likely_colour(noise):
    model = model_with()
    assert model.failing_excess.colour is None  # not searched for yet
    _ = model.fitted_noise_filter
    passed = model.failing_excess
    assert passed.colour == ((4, 1), (2, 0)) and passed.share == 0.4
    similar = model_with(passed)
    assert similar.failing_excess.colour == ((4, 1), (2, 0))  # until its own is known, it is that of the model before
    noise.colour = ((5, 2), (2, 0))
    _ = similar.fitted_noise_filter
    assert similar.failing_excess.colour == ((5, 2), (2, 0))
    assert noise.initial == [None, passed] and noise.initial_colour == [None, ((4, 1), (2, 0))]


def test_a_model_that_holds_passes_on_nothing(noise):
    noise.share = 0.5 * DecisionSettings().holds_share
    model = model_with()
    assert model.holds and model.failing_excess is None


def test_released_filters_are_computed_again_and_what_was_estimated_is_kept(noise):
    model = model_with()
    first, white = model.fitted_noise_filter, model.white_excess_filter
    assert model.fitted_noise_filter is first and model.white_excess_filter is white
    model.release_filters()
    assert model.fitted_noise_filter is not first
    assert noise.initial_colour == [None] and len(noise.initial) == 1
    assert model.log_likelihood == -0.5 * 4.0 * ROWS


@pytest.mark.parametrize(
    ("share", "white", "penalty"),
    [
        (0.4, True, 2.0),  # that of the variances
        (0.4, False, 2.0 + 2.0 * np.log(15.0)),  # of three correlation times and five factors, for each kind
        (0.0, True, 0.0),
    ],
)
@pytest.mark.parametrize("released", [False, True])
def test_the_penalty_of_the_noise_is_that_of_its_variances_and_of_a_colour_that_was_chosen(
    noise, share, white, penalty, released
):
    """However often the filters are computed; the evidence is the likelihood at that noise less the penalty."""
    noise.share, noise.white = share, white
    model = model_with()
    model.case.settings = DecisionSettings(
        excess_memories_s=(0.1, 1.0, 10.0), excess_colour_factors=(0.5, 1.0, 2.0, 4.0, 8.0)
    )
    if released:
        _ = model.fitted_noise_filter
        model.release_filters()
    assert model.noise_penalty == pytest.approx(penalty)
    assert model.log_evidence == pytest.approx(-0.5 * 4.0 * ROWS - penalty)
    assert model.white_excess_log_evidence == pytest.approx(-0.5 * 4.0 * ROWS - 2.0 * bool(share))  # before its colour


@pytest.mark.parametrize("memory", [0.5, 5.0, 500.0])
def test_what_a_model_lacks_stays_in_its_normalised_innovations(memory):
    """Five sigmas in every row, of a model without free states; its noise follows them, and its innovations fall.

    With white noise, or at the stated noise, innovations are what the measurements differ by from the prediction.
    """
    rows, lacking = 400, 5.0
    exact = LinearStateSpace(
        increment=from_blocks(1, [(slice(0, 1), slice(0, 1), np.zeros((rows, 1, 1)))]),
        process_noise=from_blocks(1, [(slice(0, 1), slice(0, 1), np.zeros((rows, 1, 1)))]),
        row_start=np.arange(rows + 1),
        design=np.ones((rows, 1)),
        row_noise=np.ones((rows, 1)),
        initial_covariance=np.zeros((1, 1)),
    )
    model = model_with(residuals=np.full(rows, lacking))
    model.__dict__.update(state_space=exact, initial_mean=np.zeros(1))
    constant = append_constant_states(exact, np.full((rows, 1), lacking), np.ones(1))
    coloured = whitening_filter(with_gauss_markov_states(constant, np.full(rows, 0.1), np.array([memory]), np.ones(1)))
    white = model.white_residuals(coloured)
    assert np.sqrt(np.mean(coloured.innovations(white)[20:] ** 2)) < 2.0
    for whiten in (coloured, whitening_filter(exact)):
        normalised = model.normalised_innovations(whiten, model.white_residuals(whiten))
        np.testing.assert_allclose(normalised, lacking, rtol=1e-9)


@pytest.mark.parametrize(("size", "mean_square"), [(0.2, 0.16), (3.0, 1.0)])
def test_a_model_that_holds_is_expected_to_have_the_mean_square_of_its_rows_without_excess(noise, size, mean_square):
    """At most one: the stated noise is an upper bound where numerical errors are smaller than allowed for."""
    residuals = np.where(np.arange(ROWS) < 40, 100.0, size)  # large where the excess variance is significant
    model = model_with(residuals=residuals)
    expected = -0.5 * mean_square * ROWS - 0.5 * noise.stated.log_determinant
    assert model.holding_log_likelihood == pytest.approx(expected)
