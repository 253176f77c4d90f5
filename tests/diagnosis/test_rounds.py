"""Rounds: for models that hold, and for failing ones to where they hold."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.diagnosis import rounds as rounds_module
from edl_filter.diagnosis.linear import HOLDS
from edl_filter.diagnosis.rounds import followed, linearise


@pytest.mark.parametrize(("share", "until", "calls"), [(0.0, 0.02, 3), (0.5, 0.02, 1), (0.5, 1.0, 3)])
def test_further_rounds_are_for_models_that_hold(monkeypatch, share, until, calls):
    """The point moves round by round, but not where the model fails by more than `until`; noise begins at the last."""
    made, begun = [], []

    def about(case, point, begin=None):
        made.append(point)
        begun.append(begin)
        soft = SimpleNamespace(start_covariance=lambda size: np.eye(2), log_likelihood=lambda _: float(len(made)))
        unknowns, ground = SimpleNamespace(layout=SimpleNamespace(size=2)), SimpleNamespace(point=point)
        white = SimpleNamespace(
            share=share, holds=share <= HOLDS, soft=soft, white=lambda _: np.zeros(3), start=np.zeros(2)
        )
        white.unknowns, white.sigma, white.ground, white.log_likelihood = unknowns, {}, ground, float(len(made))
        white.failures = f"noise {len(made)}" if share > HOLDS else None
        return white

    def told(linear, point, *_):
        far = SimpleNamespace(minus=lambda _: np.ones(2))
        return SimpleNamespace(start=far, deviation=None)

    monkeypatch.setattr(rounds_module, "about", about)
    monkeypatch.setattr(rounds_module, "told", told)
    monkeypatch.setattr(rounds_module, "first_point", lambda _: SimpleNamespace(start=None, deviation=None))
    linearise(SimpleNamespace(reconstruction=None), rounds=3, until=until)
    assert len(made) == calls
    assert begun == ([None, "noise 1", "noise 2"] if share > HOLDS else [None] * 3)[:calls]


@pytest.mark.parametrize(
    ("shares", "exact", "found"),
    [
        ([0.1, 0.05, 0.01, 0.0], True, 2),  # where it holds first
        ([0.1, 0.05, 0.045, 0.0], True, None),  # hardly any better: no hope
        ([0.1, 0.07, 0.05, 0.03, 0.0], True, None),  # not soon enough
        ([0.1, 0.05, 0.01], False, None),  # a database with errors of its own would drag it along
        ([0.02, 0.0], True, None),  # it holds as it is
    ],
)
def test_a_failing_model_is_followed_to_where_it_holds(monkeypatch, shares, exact, found):
    rounds = [SimpleNamespace(share=s, holds=s <= HOLDS) for s in shares]
    monkeypatch.setattr(rounds_module, "_rounds", lambda case, count, until, first: iter(rounds[:count]))
    there = followed(SimpleNamespace(exact=exact), rounds[0])
    assert there is (None if found is None else rounds[found])
