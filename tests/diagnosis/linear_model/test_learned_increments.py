"""Increments of another flight as an effect whose parameters are the amplitudes of the modes of their covariance."""

from dataclasses import replace

import numpy as np
import pytest
from standins import N, flow, totals

from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.increment_tables import IncrementTables
from edl_filter.aero.increments import DatabaseUpdate, RegimeUpdate
from edl_filter.diagnosis.linear_model.learned_increments import LearnedIncrements

MACH, ALPHA = np.array([5.0, 10.0, 20.0]), np.array([0.0, 0.05, 0.1])
LIMIT = 1e-3
#: One sample at each of some knots: index of the Mach number and of the angle.
KNOTS = np.array([[0, 1], [1, 1], [2, 1], [0, 2], [1, 2], [2, 2], [1, 0]])


def covariance():
    """A covariance of rank 4 of all increments, in which CN and Cm are certain at zero angle."""
    roots = np.random.default_rng(4).normal(size=(4, 3, len(MACH), len(ALPHA)))
    roots[:, 1:, :, 0] = 0.0
    roots = roots.reshape(4, -1)
    return roots.T @ roots


@pytest.fixture(scope="module")
def effect():
    shape = (3, len(MACH), len(ALPHA))
    sigma = np.sqrt(np.diag(covariance())).reshape(shape)
    regime = RegimeUpdate("mach", MACH, ALPHA, np.zeros(shape), sigma, sigma, np.ones(shape[1:], int))
    return LearnedIncrements(IncrementTables(DatabaseUpdate("MER", DiscrepancyPrior(), (regime,), covariance())), LIMIT)


def at_knots(**changes):
    values = {"mach": MACH[KNOTS[:, 0]], "alpha_total": ALPHA[KNOTS[:, 1]], "knudsen": np.full(N, 1e-5)}
    return flow(**(values | changes))


def change(effect, amplitudes, flight):
    """Changes of CA, CN and Cm ``(3, N)``."""
    before = totals()
    after = effect.coefficients(amplitudes, flight, before)
    return np.stack([getattr(after, c) - getattr(before, c) for c in ("ca", "cn", "cm_nose")])


def test_there_is_one_amplitude_of_unit_variance_for_each_mode(effect):
    assert [q.name for q in effect.parameters] == ["q0", "q1", "q2", "q3"]
    assert effect.sigma == dict.fromkeys(("q0", "q1", "q2", "q3"), 1.0)


def test_files_of_another_rank_have_parameters_of_their_own(effect):
    update = effect._tables.update
    one_mode = np.outer(*[np.sqrt(np.diag(update.covariance))] * 2)
    smaller = LearnedIncrements(IncrementTables(replace(update, covariance=one_mode)), LIMIT)
    assert (len(smaller.parameters), len(effect.parameters)) == (1, 4)


def test_amplitudes_of_unit_variance_have_the_covariance_of_the_file(effect):
    """The covariance of the coefficients at the knots, summed over the modes."""
    changes = np.stack([change(effect, {q.name: 1.0}, at_knots()).ravel() for q in effect.parameters])
    places = (
        np.arange(3 * len(MACH) * len(ALPHA)).reshape(3, len(MACH), len(ALPHA))[:, KNOTS[:, 0], KNOTS[:, 1]].ravel()
    )
    np.testing.assert_allclose(changes.T @ changes, covariance()[np.ix_(places, places)], atol=1e-10)


def test_the_change_is_linear_in_the_amplitudes_and_nothing_else_changes(effect):
    single = change(effect, {"q0": 1.0}, at_knots()), change(effect, {"q2": 1.0}, at_knots())
    both = effect.coefficients({"q0": -2.0, "q2": 0.5}, at_knots(), totals())
    np.testing.assert_allclose(both.ca - totals().ca, -2.0 * single[0][0] + 0.5 * single[1][0], atol=1e-12)
    np.testing.assert_array_equal(both.cl, totals().cl)
    np.testing.assert_array_equal(both.cmq, totals().cmq)


def test_without_amplitudes_the_coefficients_are_those_given(effect):
    before = totals()
    assert effect.coefficients({}, at_knots(), before) is before


def test_a_regime_that_the_file_does_not_have_is_not_changed(effect):
    assert not change(effect, {"q0": 1.0}, at_knots(knudsen=np.full(N, 2.0 * LIMIT))).any()
    assert change(effect, {"q0": 1.0}, at_knots(knudsen=np.full(N, 0.5 * LIMIT))).any()
