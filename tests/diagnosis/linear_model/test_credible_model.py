"""The alternative mode of a failing model."""

from types import SimpleNamespace

import pytest
from constructed_models import SETTINGS, constructed_model

from edl_filter.diagnosis.linear_model import credible_model as module
from edl_filter.diagnosis.linear_model.credible_model import relinearize_failing_model


def test_a_failing_model_is_relinearised_to_where_it_is_more_probable(monkeypatch):
    """It need not hold there: what a nuisance parameter absorbs in part is no evidence for an effect."""
    likelihoods = [0.0, 30.0, 20.0, 10.0]
    models = [constructed_model(k, 0.5 * 0.7**k, value) for k, value in enumerate(likelihoods)]
    monkeypatch.setattr(module, "iterate_point", lambda case, iterations, max_share, first: iter(models[:iterations]))
    assert relinearize_failing_model(SimpleNamespace(settings=SETTINGS), models[0]) is models[1]


@pytest.mark.parametrize(
    ("shares", "index"),
    [
        ([0.1, 0.05, 0.01, 0.0], 3),  # where no row has excess variance
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
