"""Outer loop of a fit: reconstruction and fit are repeated with the estimates until they converge.

An effect in a mission file has starting values. A run fits its parameters about a reconstruction, reconstructs with the
estimates, and repeats this until no parameter changes. A hypothesis that may be named is fitted in the same way.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from edl_filter.diagnosis.linear_model.flight_case import FlightCase, load_case
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import linearize, linearize_at, map_point
from edl_filter.diagnosis.linear_model.linearization_point import LinearizationPoint
from edl_filter.diagnosis.selection.map_fit import MapFit, fit_map
from edl_filter.diagnosis.selection.time_scan import scan_times
from edl_filter.effects.base import EffectInstance, EffectKey, label_of
from edl_filter.effects.sensor_chain import canonical_key
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.pipeline.reconstruct import Reconstruction, reconstruct
from edl_filter.telemetry.record import ImuRecord


@dataclass(frozen=True)
class FittedEffects:
    """A reconstruction with effects at their estimates.

    Attributes
    ----------
    reconstruction : Reconstruction
    sigma : dict
        Label of the effect → parameter → one sigma, for the parameters that were fitted.
    gain_over_zero : dict
        Key of each effect that was fitted → log Bayes factor over the same model without it, all others fitted, nats
        (`MapFit.gain_over_zero`).
    """

    reconstruction: Reconstruction
    sigma: dict[str, dict[str, float]]
    gain_over_zero: dict[EffectKey, float]


def can_fit_effects(mission: Mission) -> bool:
    """Whether a mission has free effects, and the model with which to predict."""
    return (
        any(not entry.fixed for entry in mission.effects)
        and mission.aerodynamics is not None
        and mission.vehicle.inertia is not None
    )


def fit_effects(
    mission: Mission,
    progress: Callable[[str], None] = lambda _: None,
    effects: Sequence[EffectInstance] | None = None,
) -> FittedEffects:
    """Fit a mission's effects.

    Parameters
    ----------
    mission : Mission
        The mission, checked.
    progress : callable
        Called with what is being done.
    effects : sequence of EffectInstance, optional
        Instead of the mission's.

    Raises
    ------
    InputError
        An effect stands twice, or the mission cannot be reconstructed.
    """
    begin = time.perf_counter()
    progress("reconstructing with the effects as they are stated")
    case = load_case(mission, effects)
    check_single_instances(case.mission, case.effects, case.reconstruction.telemetry.driving)
    _, _, fit = iterate_to_convergence(case, progress=progress)
    final = reconstruct(mission, fit.effects, leave_one_out=True, inputs=case.reconstruction.inputs)
    timing = final.timing | {"refit": time.perf_counter() - begin}
    gains = {a.key: fit.gain_over_zero(a.key) for a in fit.effects if a.effect.sizes and a.fitted}
    return FittedEffects(replace(final, timing=timing), _sigma_by_effect(fit), gains)


def iterate_to_convergence(
    case: FlightCase,
    iterations: int | None = None,
    progress: Callable[[str], None] = lambda _: None,
    first: LinearizedModel | None = None,
) -> tuple[FlightCase, LinearizedModel, MapFit]:
    """Fit a case's effects about its reconstruction, and about one with the estimates, until they converge.

    The linearisation point moves with the effects.

    Parameters
    ----------
    case : FlightCase
        The flight with what its mission states as uncertain.
    iterations : int, optional
        Largest number of reconstructions; counted anew from the next one on, a few times, where a scan moves a time of
        an effect by more than an interval of excess variance: the point so far belongs to the wrong time.
    progress : callable
        Called with a text for each stage.
    first : LinearizedModel, optional
        The model about the smoothed reconstruction, if it is at hand.
    """
    settings = case.settings

    def fit_to(model: LinearizedModel) -> tuple[MapFit, bool]:
        """The fit about the model's point, and whether a scan has moved a time by more than an interval."""
        whiten, effects = model.fitted_noise_filter, case.effects
        if not model.excess_variance.is_zero:
            effects = scan_times(model, effects, whiten)
        return fit_map(model, effects, whiten, moving=True), _is_time_moved(case.effects, effects, settings)

    progress("refitting the effects, iteration 1")
    model = linearize(
        case,
        iterations=settings.linearization_iterations,
        max_excess_share=settings.iterated_excess_share,
        least_iterations=2,
        first=first,
    )
    first = None  # large
    limit = settings.outer_iterations if iterations is None else iterations
    iteration, last = 1, limit
    while True:
        fit, moved = fit_to(model)
        if moved:  # the most probable point changes with the time: as many iterations with it as from the beginning
            last = min(iteration + limit, limit + settings.outer_iterations)
        if iteration == last or _largest_change(case.effects, fit) <= settings.outer_tolerance_sigmas:
            return case, model, fit
        iteration += 1
        progress(f"refitting the effects, iteration {iteration}")
        point = most_probable_point(model, fit)
        model.release()
        case = case.reconstruct_with(fit.effects)
        model = linearize_at(case, point, model.failing_excess)


def most_probable_point(model: LinearizedModel, fit: MapFit) -> LinearizationPoint:
    """Most probable nuisance parameters with effects at their estimates: about which to linearise next.

    A fit may end at the point at which it began, although the nuisance parameters that its estimates imply lie many
    sigmas from it: along a ridge between an effect and a nuisance parameter the Jacobians of the one end do not hold
    at the other.

    Parameters
    ----------
    model : LinearizedModel
        About which the effects were fitted at the fitted noise.
    fit : MapFit
        The fit.
    """
    stays = fit.point is model.point
    model_at_fit = model.with_effects(fit.effects) if stays else model.at_point(fit.point, fit.effects)
    return map_point(model_at_fit, model.fitted_noise_filter, fit.white) or fit.point


def check_single_instances(mission: Mission, effects: Sequence[EffectInstance], driving: ImuRecord) -> None:
    """Raise `InputError` where two effects of a model are the same in the same IMU, of which `driving` drives."""
    counts = Counter(canonical_key(a, driving) for a in effects)
    repeated = [label_of(key) for key, n in counts.items() if n > 1]
    if repeated:
        raise InputError(
            f"{mission.source or mission.name}: effects: found {repeated[0]} twice; a refit takes each effect once in "
            "an IMU. Run with --no-refit to hold all effects at their values."
        )


def _is_time_moved(
    before: Sequence[EffectInstance], after: Sequence[EffectInstance], settings: DecisionSettings
) -> bool:
    """Whether a time has changed by more than an interval of excess variance."""
    pairs = [(a, b, q.name) for a, b in zip(before, after, strict=True) for q in a.fitted if q.kind == "time"]
    return any(abs(b.values[name] - a.values[name]) > settings.noise_piece_s for a, b, name in pairs)


def _sigma_by_effect(fit: MapFit) -> dict[str, dict[str, float]]:
    by_effect: dict[str, dict[str, float]] = {}
    for (key, parameter), sigma in zip(fit.names, fit.parameter_sigma, strict=True):
        by_effect.setdefault(label_of(key), {})[parameter] = float(sigma)
    return by_effect


def _largest_change(before: tuple[EffectInstance, ...], fit: MapFit) -> float:
    """Largest change of a parameter, in its sigmas."""
    old = {a.key: a.values for a in before}
    new = {a.key: a for a in fit.effects}
    changes = [new[e].change_from(old[e], q) / s for (e, q), s in zip(fit.names, fit.parameter_sigma, strict=True)]
    return max(changes, default=0.0)
