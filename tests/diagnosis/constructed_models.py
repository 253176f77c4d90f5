"""Models that have only what the iterations of the linearisation point need."""

from types import SimpleNamespace

import numpy as np

from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()


def constructed_model(number, share, likelihood, penalty=0.0):
    """What the iteration needs of a model: point, share of rows with excess variance, likelihood, penalty of noise."""
    holds = share <= SETTINGS.holds_share
    return SimpleNamespace(
        number=number,
        effects=(),
        point=SimpleNamespace(start=None, perturbation=None),
        holds=holds,
        excess_variance=SimpleNamespace(share=share, is_zero=share == 0.0, penalty=penalty),
        failing_excess=None if holds else f"noise {number}",
        white_excess_filter=SimpleNamespace(posterior_initial_covariance=np.eye),
        nuisance=SimpleNamespace(layout=SimpleNamespace(size=2)),
        case=SimpleNamespace(uncertainty=SimpleNamespace(sigma={})),
        settings=SETTINGS,
        release=lambda: None,
        white_residuals=lambda whiten: np.zeros(3),
        white_excess_log_likelihood=likelihood,
        white_excess_log_evidence=likelihood - penalty,
        log_evidence=likelihood - penalty,
    )
