"""Iteration of the linearisation point: of models that hold, and of failing ones to where they hold."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis.linear_model import linear_model as module
from edl_filter.diagnosis.linear_model.linearization import linearize, relinearize_failing_model
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()


def constructed_model(number, share, likelihood):
    """What the iteration needs of a model: its point, share of rows with excess variance, and likelihood."""
    holds = share <= SETTINGS.holds_share
    return SimpleNamespace(
        number=number,
        point=SimpleNamespace(start=None, perturbation=None),
        holds=holds,
        excess_variance=SimpleNamespace(share=share),
        failing_excess=None if holds else f"noise {number}",
        fitted_noise_filter=SimpleNamespace(posterior_initial_covariance=np.eye),
        nuisance=SimpleNamespace(layout=SimpleNamespace(size=2)),
        white_residuals=lambda whiten: np.zeros(3),
        log_likelihood=likelihood,
    )


def patched_iteration(monkeypatch, shares, likelihoods=None, change=1.0):
    """Models of given shares in turn; each point differs by `change`. Lists of models and of initial excesses."""
    models, starts = [], []

    def linearize_at(case, point, initial_excess=None):
        number = len(models)
        likelihood = float(number) if likelihoods is None else likelihoods[number]
        models.append(constructed_model(number + 1, shares[min(number, len(shares) - 1)], likelihood))
        starts.append(initial_excess)
        return models[-1]

    displaced = SimpleNamespace(start=SimpleNamespace(minus=lambda _: np.full(2, change)), perturbation=None)
    monkeypatch.setattr(module, "linearize_at", linearize_at)
    monkeypatch.setattr(module, "map_point", lambda *_: displaced)
    monkeypatch.setattr(module, "smoothed_point", lambda _: SimpleNamespace(start=None, perturbation=None))
    return models, starts


CASE = SimpleNamespace(
    reconstruction=None, settings=SETTINGS, uncertainty=SimpleNamespace(sigma={}), exact_database=True
)


@pytest.mark.parametrize(("share", "max_share", "count"), [(0.0, 0.02, 3), (0.5, 0.02, 1), (0.5, 1.0, 3)])
def test_the_point_moves_only_while_the_model_holds_well_enough(monkeypatch, share, max_share, count):
    """Not where more than `max_excess_share` of the rows have excess variance; which starts at the last estimate."""
    models, starts = patched_iteration(monkeypatch, [share])
    linearize(CASE, iterations=3, max_excess_share=max_share)
    assert len(models) == count
    expected = [None, "noise 1", "noise 2"] if share > SETTINGS.holds_share else [None] * 3
    assert starts == expected[:count]


@pytest.mark.parametrize(("change", "count"), [(0.05, 1), (0.2, 3)])
def test_the_iteration_ends_where_the_point_has_converged(monkeypatch, change, count):
    models, _ = patched_iteration(monkeypatch, [0.0], change=change)
    linearize(CASE, iterations=3)
    assert len(models) == count


@pytest.mark.parametrize(
    ("shares", "likelihoods", "best"),
    [
        ([0.0, 0.0, 0.0], [1.0, 3.0, 2.0], 2),
        ([0.5, 0.0, 0.0], [9.0, 1.0, 2.0], 3),  # one that holds, although another is more likely
        ([0.5, 0.4, 0.3], [1.0, 3.0, 2.0], 2),
    ],
)
def test_the_most_likely_model_is_returned(monkeypatch, shares, likelihoods, best):
    patched_iteration(monkeypatch, shares, likelihoods)
    assert linearize(CASE, iterations=3).number == best


@pytest.mark.parametrize(
    ("shares", "exact", "index"),
    [
        ([0.1, 0.05, 0.01, 0.0], True, 2),  # where it holds first
        ([0.1, 0.05, 0.045, 0.0], True, None),  # the progress is too small
        ([0.1, 0.07, 0.05, 0.03, 0.0], True, None),  # not soon enough
        ([0.1, 0.05, 0.01], False, None),  # a database with errors of its own would move the point from the truth
        ([0.02, 0.0], True, None),  # it holds as it is
    ],
)
def test_a_failing_model_is_relinearised_to_where_it_holds(monkeypatch, shares, exact, index):
    models = [constructed_model(k, share, 0.0) for k, share in enumerate(shares)]
    monkeypatch.setattr(module, "_iterate_point", lambda case, iterations, max_share, first: iter(models[:iterations]))
    alternative = relinearize_failing_model(SimpleNamespace(exact_database=exact, settings=SETTINGS), models[0])
    assert alternative is (None if index is None else models[index])
