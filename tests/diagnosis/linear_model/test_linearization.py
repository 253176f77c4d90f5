"""Iteration of the linearisation point."""

from types import SimpleNamespace

import numpy as np
import pytest
from constructed_models import SETTINGS, constructed_model

from edl_filter.diagnosis.linear_model import linearization as module
from edl_filter.diagnosis.linear_model.linearization import linearize


def patched_iteration(monkeypatch, shares, likelihoods=None, change=1.0, penalties=None):
    """Models of given shares in turn; each point differs by `change`. Lists of models and of initial excesses.

    Each model is more likely than the one before by ten nats, unless the likelihoods are given; the penalties of their
    noise are zero, unless they are given.
    """
    models, starts = [], []

    def linearize_at(case, point, initial_excess=None):
        number = len(models)
        likelihood = 10.0 * number if likelihoods is None else likelihoods[number]
        penalty = 0.0 if penalties is None else penalties[number]
        models.append(constructed_model(number + 1, shares[min(number, len(shares) - 1)], likelihood, penalty))
        starts.append(initial_excess)
        return models[-1]

    displaced = SimpleNamespace(start=SimpleNamespace(minus=lambda _: np.full(2, change)), perturbation=None)
    monkeypatch.setattr(module, "linearize_at", linearize_at)
    monkeypatch.setattr(module, "at_map_point", lambda model, *_: model)
    monkeypatch.setattr(module, "map_point", lambda *_: displaced)
    monkeypatch.setattr(module, "smoothed_point", lambda _: SimpleNamespace(start=None, perturbation=None))
    return models, starts


CASE = SimpleNamespace(reconstruction=None, settings=SETTINGS, uncertainty=SimpleNamespace(sigma={}))


FALLING = [0.5, 0.3, 0.2]


@pytest.mark.parametrize(
    ("shares", "max_share", "count"), [([0.0], 0.02, 3), (FALLING, 0.02, 1), (FALLING, 0.4, 1), (FALLING, 1.0, 3)]
)
def test_the_point_moves_only_while_the_model_holds_well_enough(monkeypatch, shares, max_share, count):
    """Not where more than `max_excess_share` of the rows have excess variance; which starts at the last estimate."""
    models, starts = patched_iteration(monkeypatch, shares)
    linearize(CASE, iterations=3, max_excess_share=max_share)
    assert len(models) == count
    expected = [None, "noise 1", "noise 2"] if shares is FALLING else [None] * 3
    assert starts == expected[:count]


@pytest.mark.parametrize(("progress", "count"), [(0.95, 3), (1.05, 2)])
def test_a_failing_model_goes_on_only_while_its_excess_falls(monkeypatch, progress, count):
    """In parts of the share of the setting that an iteration may leave; whatever the likelihood is."""
    excess_ratio = progress * SETTINGS.alternative_progress
    models, _ = patched_iteration(monkeypatch, [0.9, 0.9 * excess_ratio, 0.9 * excess_ratio**2], [30.0, 20.0, 10.0])
    linearize(CASE, iterations=3)
    assert len(models) == count


@pytest.mark.parametrize(("change", "count"), [(0.05, 1), (0.2, 3)])
def test_the_iteration_ends_where_the_point_has_converged(monkeypatch, change, count):
    models, _ = patched_iteration(monkeypatch, [0.0], change=change)
    linearize(CASE, iterations=3)
    assert len(models) == count


@pytest.mark.parametrize(("least", "count"), [(1, 1), (2, 2), (3, 3)])
def test_a_failing_model_has_a_least_number_of_points(monkeypatch, least, count):
    models, _ = patched_iteration(monkeypatch, FALLING)
    linearize(CASE, iterations=3, max_excess_share=0.02, least_iterations=least)
    assert len(models) == count


@pytest.mark.parametrize(("gain", "count"), [(-3.0, 2), (0.9, 2), (1.1, 4)])
def test_the_iteration_ends_where_the_likelihood_gains_little(monkeypatch, gain, count):
    """In parts of the setting; the more likely of the last two points is returned."""
    likelihoods = [k * gain * SETTINGS.linearization_convergence_nats for k in range(4)]
    models, _ = patched_iteration(monkeypatch, [0.0], likelihoods)
    best = linearize(CASE, iterations=4)
    assert len(models) == count and best is models[-1 if gain > 0.0 else 0]


@pytest.mark.parametrize(
    ("shares", "likelihoods", "best"),
    [
        ([0.0, 0.0, 0.0], [1.0, 9.0, 2.0], 2),  # the iteration is no descent
        ([0.5, 0.0, 0.0], [9.0, 1.0, 22.0], 2),  # one that holds, although another is more likely
        ([0.5, 0.0, 0.4], [1.0, 9.0, 22.0], 2),
        ([0.5, 0.0, 0.01], [1.0, 9.0, 22.0], 2),  # one without excess variance
        ([0.5, 0.01, 0.01], [1.0, 9.0, 2.0], 2),
        ([0.5, 0.4, 0.3], [1.0, 9.0, 2.0], 2),
    ],
)
def test_the_most_likely_of_the_models_that_hold_is_returned_or_of_all(monkeypatch, shares, likelihoods, best):
    patched_iteration(monkeypatch, shares, likelihoods)
    assert linearize(CASE, iterations=3).number == best


@pytest.mark.parametrize(("penalty", "best"), [(0.0, 1), (4.0, 1), (6.0, 2)])
def test_of_two_failing_models_the_price_of_the_noise_counts(monkeypatch, penalty, best):
    """A point about which more variances are added is more likely by them; here by 5 nats."""
    patched_iteration(monkeypatch, [0.5, 0.3, 0.2], [20.0, 15.0, 0.0], penalties=[penalty, 0.0, 0.0])
    assert linearize(CASE, iterations=3).number == best
