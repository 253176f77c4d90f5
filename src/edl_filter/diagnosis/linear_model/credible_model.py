"""The model that every normalised RMS and every diagnosis is about, and its alternative mode.

Input: a `FlightCase`. Method: scale and lengths of the database's error are estimated where the mission asks for it;
the linearisation point is iterated (`linearization`); where the model fails about the smoothed reconstruction, its
other mode is searched. Output: `LinearizedModel` about one or two points.
"""

from __future__ import annotations

from itertools import islice

from edl_filter.diagnosis.linear_model.discrepancy_estimate import with_estimated_discrepancy
from edl_filter.diagnosis.linear_model.flight_case import FlightCase
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import iterate_point, linearize


def relinearize_failing_model(case: FlightCase, model: LinearizedModel) -> LinearizedModel | None:
    """The alternative mode of a failing model: the point at which it holds, or at which it is more probable.

    The model fails about the smoothed reconstruction. After some iterations a nuisance parameter may have absorbed what
    is missing, by as many sigmas as that takes (`LinearizedModel.largest_nuisance_sigmas`), wholly or in part. A point
    at which the model holds with excess variance in a few rows has not converged, and is iterated further.

    Parameters
    ----------
    case : FlightCase
        The flight with what its mission states as uncertain.
    model : LinearizedModel
        About the point where it fails.

    Returns
    -------
    LinearizedModel or None
        None where the model holds already, or is nowhere more probable.
    """
    settings, best, share = case.settings, model, model.excess_variance.share
    if model.holds:
        return None
    for candidate in islice(iterate_point(case, settings.alternative_iterations, 1.0, model), 1, None):
        if candidate.excess_variance.is_zero:
            return candidate
        if best.holds and not candidate.holds:
            break
        if (candidate.holds, candidate.log_likelihood) > (best.holds, best.log_likelihood):
            best = candidate
        if not candidate.holds and candidate.excess_variance.share > settings.alternative_progress * share:
            break
        share = candidate.excess_variance.share
    return None if best is model else best


def credible_model(case: FlightCase) -> tuple[LinearizedModel, LinearizedModel | None]:
    """The model of a case about its credible linearisation point: that of every normalised RMS and every diagnosis.

    Its case has the scale and lengths of the database's error that the mission asks to estimate.

    Returns
    -------
    model : LinearizedModel
        Where the model fails about the smoothed reconstruction only, its alternative mode.
    alternative_mode : LinearizedModel or None
        Where the model is more probable about another point, but fails there as well or holds only with nuisance
        parameters farther off than `credible_nuisance_sigmas`: about that point.
    """
    case = with_estimated_discrepancy(case)
    settings = case.settings
    model = linearize(case, settings.linearization_iterations, settings.iterated_excess_share)
    alternative_mode = relinearize_failing_model(case, model)
    if alternative_mode is None or not alternative_mode.holds:
        return model, alternative_mode
    credible = alternative_mode.largest_nuisance_sigmas <= settings.credible_nuisance_sigmas
    return (alternative_mode, None) if credible else (model, alternative_mode)
