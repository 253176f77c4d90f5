"""The model that every normalised RMS and every diagnosis is about, and its alternative mode.

Input: a `FlightCase`. Output: `LinearizedModel` about one or two points. Method:

1. Scale and correlation lengths of the database's error are estimated where the mission asks for it
   (``aerodynamics.discrepancy.estimate``): type-II maximum likelihood, the maximum of the residuals' marginal
   likelihood about the smoothed reconstruction, with the penalty of the excess noise and a lognormal prior about the
   stated values (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 5.4; Kennedy and
   O'Hagan, J. R. Statist. Soc. B 63 (2001) 425, section 4.3). It is searched over the logarithms by the simplex method
   (Nelder and Mead, Computer J. 7 (1965) 308), since the rows that have excess noise change from one evaluation to the
   next. All that follows has the estimated values. What is missing in the model, too, makes the database's error larger
   or less correlated here; so by default nothing is estimated.
2. The linearisation point is iterated (`linearization`).
3. Where the model fails about the smoothed reconstruction, its other mode is searched.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np

from edl_filter.diagnosis.linear_model.flight_case import (
    DiscrepancyEstimate,
    EstimatedQuantity,
    FlightCase,
    flight_case,
)
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import iterate_point, linearize, linearize_at, preference
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point
from edl_filter.mission import Mission
from edl_filter.types import Array

#: First steps of the logarithms; changes of them and of the log posterior (nats) at which the maximum is reached.
_FIRST_STEP, _TOLERANCE, _CONVERGENCE = 0.5, 0.05, 0.1
#: Largest number of evaluations for each quantity; an evaluation is a linearisation.
_EVALUATIONS = 20


def with_estimated_discrepancy(case: FlightCase) -> FlightCase:
    """The case with the scale and correlation lengths that its mission asks to estimate.

    Parameters
    ----------
    case : FlightCase
        The flight with what its mission states as uncertain.

    Returns
    -------
    FlightCase
        The same object where nothing is to be estimated.
    """
    names = () if case.mission.aerodynamics is None else case.mission.aerodynamics.discrepancy.estimate
    if not names:
        return case
    from scipy.optimize import minimize  # imported on use: few missions ask for it

    settings = case.settings
    stated = np.array([_value(case.mission, name) for name in names])
    limit = float(np.log(settings.discrepancy_range))
    values: dict[tuple[float, ...], float] = {}

    def cost(logarithm: Array) -> float:
        key = tuple(float(v) for v in logarithm)
        if key not in values:
            prior = 0.5 * float(np.sum((logarithm / settings.discrepancy_sigma) ** 2))
            values[key] = prior - _log_evidence(_with_values(case, names, stated * np.exp(logarithm)))
        return values[key]

    start = np.zeros(len(names))
    steps = min(_FIRST_STEP, 0.5 * limit) * np.eye(len(names))
    minimize(
        cost,
        start,
        method="Nelder-Mead",
        bounds=[(-limit, limit)] * len(names),
        options={
            "initial_simplex": np.vstack((start, steps)),
            "xatol": _TOLERANCE,
            "fatol": _CONVERGENCE,
            "maxfev": _EVALUATIONS * len(names),
        },
    )
    best = np.array(min(values, key=lambda key: values[key]))
    quantities = tuple(
        EstimatedQuantity(name, float(s), float(s * np.exp(v)), float(s * np.exp(-limit)), float(s * np.exp(limit)))
        for name, s, v in zip(names, stated, best, strict=True)
    )
    estimate = DiscrepancyEstimate(quantities, cost(start) - values[tuple(float(v) for v in best)])
    return replace(_with_values(case, names, stated * np.exp(best)), discrepancy_estimate=estimate)


def _value(mission: Mission, name: str) -> float:
    assert mission.aerodynamics is not None
    holder = mission.aerodynamics if name == "coefficient_sigma" else mission.aerodynamics.discrepancy
    return float(getattr(holder, name))


def _with_values(case: FlightCase, names: tuple[str, ...], values: Array) -> FlightCase:
    """The case with a mission that states these values."""
    mission = case.mission
    assert mission.aerodynamics is not None
    stated = mission.aerodynamics.with_discrepancy(dict(zip(names, values.tolist(), strict=True)))
    other = replace(case.reconstruction, mission=mission.model_copy(update={"aerodynamics": stated}))
    return replace(flight_case(other), excluded_constraints=case.excluded_constraints)


def _log_evidence(case: FlightCase) -> float:
    """Log marginal likelihood about the smoothed reconstruction, with the penalty of the excess noise, nats."""
    model = linearize_at(case, smoothed_point(case.reconstruction))
    return model.white_excess_log_evidence


def relinearize_failing_model(case: FlightCase, model: LinearizedModel) -> LinearizedModel | None:
    """The alternative mode of a failing model: the point at which it holds, or at which it is more probable.

    The model fails about the smoothed reconstruction. After some iterations a nuisance parameter may have absorbed what
    is missing, by as many sigmas as that takes (`LinearizedModel.largest_nuisance_sigmas`), wholly or in part. The
    point is iterated until it converges, as in `linearize`.

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
        if best.holds and not candidate.holds:
            break
        best = max(best, candidate, key=lambda m: preference(m, m.log_evidence))
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
