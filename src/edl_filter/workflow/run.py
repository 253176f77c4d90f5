"""The main job with the mission's own effects: refitted, reconstructed with, and compared with the model."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from edl_filter.mission import Mission
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.pipeline.trust import check_mission
from edl_filter.results.derived import RefitSummary
from edl_filter.results.result import Result


def run_mission(mission: Mission, refit: bool = True, progress: Callable[[str], None] = lambda _: None) -> Result:
    """Reconstruct an entry with its effects at their most probable values.

    A mission without effects is reconstructed and no more: to compare it with its model takes longer than that,
    and `edl-filter diagnose` does it.

    Parameters
    ----------
    mission : Mission
        The mission, checked.
    refit : bool
        Without it effects stay at their values, and nothing is compared.
    progress : callable
        Called with what is being done.

    Returns
    -------
    Result
        Its `refit` is empty where there are no effects, or no aerodynamic database with which to predict.

    Raises
    ------
    InputError
        As `reconstruct`; or the record violates the physics of an entry (`pipeline.plausibility`).
    """
    check_mission(mission)
    if not refit or not mission.effects or mission.aerodynamics is None or mission.vehicle.inertia is None:
        return Result(reconstruct(mission))
    from edl_filter.diagnosis.linear_model.credible_model import credible_model
    from edl_filter.diagnosis.linear_model.flight_case import flight_case, load_case
    from edl_filter.diagnosis.residual_analysis.residual_map import rms_by_regime
    from edl_filter.diagnosis.selection.outer_loop import can_fit_effects, fit_effects

    if can_fit_effects(mission):
        fitted = fit_effects(mission, progress)
        reconstruction, sigma = fitted.reconstruction, fitted.sigma
    else:
        reconstruction, sigma = reconstruct(mission), {}
    progress("comparing model and measurements")
    begin = time.perf_counter()
    if reconstruction.recovery is None:
        case = flight_case(reconstruction)
    else:  # as in a diagnosis, which does not add the noise of a recovery to the model
        case = load_case(mission, reconstruction.effects)
    normalised = rms_by_regime(credible_model(case)[0])
    timing = reconstruction.timing | {"residuals": time.perf_counter() - begin}
    return Result(replace(reconstruction, timing=timing), RefitSummary(sigma, normalised))
