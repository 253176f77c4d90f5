"""A hypothesis: one effect fitted through all steps of the prediction, with its evidence and held-out score.

Its places are refined and all its parameters fitted (`map_fit`), at the noise of the model without it and, where a
moment estimate says that it explains the excess variance, at the noise that it leaves; a leading hypothesis once more
about a reconstruction that has the effect.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian
from edl_filter.diagnosis.linear_model.flight_case import FlightCase
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import linearize_at
from edl_filter.diagnosis.linear_model.linearization_point import smoothed_point
from edl_filter.diagnosis.noise.variance_components import estimate_variance_components, moment_estimate
from edl_filter.diagnosis.selection.map_fit import MapFit, NullModelFit, fit_linear, fit_map, fit_null_model
from edl_filter.diagnosis.selection.outer_loop import iterate_to_convergence
from edl_filter.diagnosis.selection.screening import ScreeningResult, correlation, refine_places
from edl_filter.effects.base import EffectInstance, EffectKey, effect_with_key, label_of
from edl_filter.estimation.kalman import Whitening, WhiteningFilter
from edl_filter.estimation.regression import held_out_gain, regress
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array

#: Relative difference up to which two places are the same starting point: about a second, or some hundred metres.
_SAME_PLACE = 0.005
#: Share of a gain that is the effect's own, below which the null model is also fitted about the effect's point. The
#: more probable null model is the reference in any case.
_OWN_SHARE = 0.5


@dataclass(frozen=True)
class Hypothesis:
    """An effect fitted.

    Attributes
    ----------
    key : (str, str or None)
        Name of the effect, and its IMU.
    fit : MapFit
    normalised : (R,) array
        `LinearizedModel.normalised_innovations` with it, at the noise at which it was fitted.
    gain : float
        Log Bayes factor over the model without it, nats.
    score_gain : float
        Held-out log predictive density over the model without it, nats.
    at_floor : bool
        Hardly any excess variance is left with it.
    explained : (R,) array
        White residuals that its sizes explain, at the noise of the model without it.
    case, model : FlightCase, LinearizedModel
        About which it was fitted last.
    null : NullModelFit
        The model without it, over which gains are computed.
    stated_noise_fit : MapFit or None
        The same at the stated noise, where that differs.
    explained_share : float
        Share of the log-likelihood between the null model and one that holds that the effect gains about its own
        reconstruction; zero where it was not relinearised.
    complemented : bool or None
        Whether a second effect explains the rest; None where that was not asked.
    own_noise_evidence : float
        Largest log marginal likelihood at the noise that it leaves, less the penalty of that noise, nats.
    """

    key: EffectKey
    fit: MapFit
    normalised: Array
    gain: float
    score_gain: float
    at_floor: bool
    explained: Array
    case: FlightCase
    model: LinearizedModel
    null: NullModelFit
    stated_noise_fit: MapFit | None = None
    explained_share: float = 0.0
    complemented: bool | None = None
    own_noise_evidence: float = -np.inf

    @property
    def instance(self) -> EffectInstance:
        """The effect with its estimate."""
        return effect_with_key(self.fit.effects, self.key)

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.key[0]

    @property
    def label(self) -> str:
        """The key as text."""
        return label_of(self.key)

    @property
    def conservative_gain(self) -> float:
        """The smaller one of gain and held-out gain, nats: the evidence on which a name is given."""
        return min(self.gain, self.score_gain)

    def with_reference(self, null: NullModelFit) -> Hypothesis:
        """The same with its gains over the null model about another point."""
        gain = self.gain + self.null.evidence - null.evidence
        score_gain = self.score_gain + self.null.log_likelihood - null.log_likelihood
        return replace(self, gain=gain, score_gain=score_gain, null=null)


def fit_hypothesis(
    case: FlightCase,
    model: LinearizedModel,
    starts: list[tuple[ScreeningResult, Whitening]],
    null: NullModelFit,
) -> Hypothesis:
    """Fit an effect from each result of the screening, and take the most probable outcome.

    Parameters
    ----------
    case, model : FlightCase, LinearizedModel
        Without the effect.
    starts : list of (ScreeningResult, callable)
        Results of the screening, and the whitening filter of each.
    null : NullModelFit
        The model without it about the same point, over which gains are computed.
    """
    settings, key = case.settings, starts[0][0].instance.key
    if model.holds:
        result, whiten = starts[0]
        instances = [refine_places(model, a, whiten) for a in (result.instance, *result.alternatives)]
        return _fit_where_model_holds(case, model, instances, whiten, null)
    at_fitted_noise: list[MapFit] = []
    at_stated_noise: list[MapFit] = []
    starting_points: list[EffectInstance] = []
    for result, whiten in starts:
        unlikely = result.gain <= settings.minimum_screening_gain
        if at_fitted_noise and (unlikely or not result.instance.effect.places):
            continue
        fits: list[MapFit] = []
        for start in (result.instance, *result.alternatives):
            instance = refine_places(model, start, whiten)
            if any(_same_places(instance, a) for a in starting_points):
                continue
            starting_points.append(instance)
            fits.append(_fit_from(model, (*case.effects, instance), null))
            if _remaining_excess(model, fits[-1], model.excess_variance.share) < settings.solved_share:
                return _best(key, fits[-1:], [], null, case, model)
        if fits and not model.excess_variance.is_zero:
            best = max(fits, key=lambda f: f.evidence)
            moving = best.point is not model.point
            at_stated_noise.append(fit_map(model, best.effects, model.stated_noise_filter, moving=moving))
        at_fitted_noise += fits
    return _best(key, at_fitted_noise, at_stated_noise, null, case, model)


def _fit_from(model: LinearizedModel, effects: tuple[EffectInstance, ...], null: NullModelFit) -> MapFit:
    """Fit about the model's point, and about a point that moves with the effects where that is more probable.

    About the smoothed reconstruction no nuisance parameter has absorbed an effect. About another point of a failing
    model one may have, by tens of its sigmas: with the nuisance parameters held there, the effect at its true size is
    less probable than none, by more than none is less probable than a model that holds. Then the point has to move.
    """
    whiten, steps = model.fitted_noise_filter, model.settings.comparison_fit_iterations
    fit = fit_map(model, effects, whiten, steps=steps)
    if model.point.bin_states is None or fit.evidence - model.noise_penalty >= null.evidence - null.misfit:
        return fit
    return max(fit, fit_map(model, effects, whiten, steps=steps, moving=True), key=lambda f: f.evidence)


def _fit_where_model_holds(
    case: FlightCase,
    model: LinearizedModel,
    instances: list[EffectInstance],
    whiten: Whitening,
    null: NullModelFit,
) -> Hypothesis:
    """The effect in the linear problem about the point at which the model without it holds, from the best instance.

    The columns of a scale error have no noise of the readings (`jacobians.denoised_readings`), so the noise is that of
    the measured readings and the map of the readings has no determinant here, as opposed to `fit_map`.
    """
    key = instances[0].key
    fit = max((fit_linear(model, a, whiten, null.evidence) for a in instances), key=lambda f: f.evidence)
    instance = effect_with_key(fit.effects, key)
    count = len({name for _, name in fit.names} & {q.name for q in instance.effect.sizes})
    x = fit.columns[:, :count]
    size = np.array([instance.values[name] for _, name in fit.names[:count]])
    settings = case.settings
    predictive = held_out_gain(
        fit.white + x @ size, x, fit.sigma[:count], model.index.time, settings.held_out_block_s, settings.held_out_folds
    )
    return Hypothesis(
        key=key,
        fit=fit,
        normalised=model.normalised_innovations(model.fitted_noise_filter, fit.white),
        gain=fit.evidence - null.evidence,
        score_gain=predictive,
        at_floor=_is_floor(model.excess_variance.share, null, settings),
        explained=x @ size,
        case=case,
        model=model,
        null=null,
    )


def _is_floor(share: float, null: NullModelFit, settings: DecisionSettings) -> bool:
    """Whether hardly any excess variance is left: in no row, or in few of those in which the null model has it."""
    return share == 0.0 or share < settings.solved_share * null.excess_share


def _remaining_excess(model: LinearizedModel, fit: MapFit, before: float) -> float:
    """Share of rows with excess variance after a fit, by moments, relative to the share without the effect."""
    if before == 0.0:
        return 1.0
    excess = moment_estimate(
        model.stated_noise_filter, model.index, fit.residual_vector, fit.initial_mean, model.settings
    )
    return excess.share / before


def _same_places(a: EffectInstance, b: EffectInstance) -> bool:
    """Whether two starting points have the same places, to `_SAME_PLACE`."""
    return all(np.isclose(a.values[q.name], b.values[q.name], rtol=_SAME_PLACE) for q in a.effect.places)


def _best(
    key: EffectKey,
    at_fitted_noise: list[MapFit],
    at_stated_noise: list[MapFit],
    null: NullModelFit,
    case: FlightCase,
    model: LinearizedModel,
    thorough: bool = False,
) -> Hypothesis:
    """The most probable of some fits, at the noise of the model without the effect or at the noise that it leaves.

    Gains are compared at the noise of the model without the effect. Only a hypothesis that leaves hardly any excess
    variance is evaluated at the noise that it leaves; that is tried where the moment estimate is promising, or if
    `thorough`.
    """
    settings = case.settings
    best_fit = max(at_fitted_noise, key=lambda f: f.evidence)
    at_floor = _is_floor(model.excess_variance.share, null, settings)
    penalty = model.noise_penalty
    first = _hypothesis(key, best_fit, model.fitted_noise_filter, penalty, at_floor, null, case, model)
    if first.at_floor and model.excess_variance.is_zero:
        return first
    stated = max(at_stated_noise, key=lambda f: f.evidence) if at_stated_noise else None
    outcomes, own_noise_evidence = [first], best_fit.evidence - penalty
    for start in (best_fit, *([stated] if stated is not None else [])):
        if not thorough and _remaining_excess(model, start, null.excess_share) > settings.promising_share:
            continue
        excess, whiten = estimate_variance_components(
            model.stated_noise_filter,
            model.index,
            start.residual_vector,
            start.initial_mean,
            settings,
            model.failing_excess,
        )
        moving = start.point is not model.point  # a fit whose point has moved continues from there
        steps = settings.polish_fit_iterations
        polished = fit_map(model, start.effects, whiten, steps=steps, moving=moving)
        own_noise_evidence = max(own_noise_evidence, polished.evidence - excess.penalty)
        at_floor = _is_floor(excess.share, null, settings)
        outcomes.append(_hypothesis(key, polished, whiten, excess.penalty, at_floor, null, case, model))
        if thorough and at_floor and not excess.is_zero:
            # the little excess may be that of a fit that has not converged: then the stated noise is more likely
            stated_noise = model.stated_noise_filter
            converged = fit_map(model, polished.effects, stated_noise, moving=True)
            outcomes.append(_hypothesis(key, converged, stated_noise, 0.0, True, null, case, model))
    best = replace(max(outcomes, key=lambda h: (h.gain, h.at_floor)), own_noise_evidence=own_noise_evidence)
    if best.at_floor:
        return best
    return replace(best, gain=first.gain, score_gain=first.score_gain, stated_noise_fit=stated)


def _hypothesis(
    key: EffectKey,
    fit: MapFit,
    whiten: WhiteningFilter,
    noise_penalty: float,
    at_floor: bool,
    null: NullModelFit,
    case: FlightCase,
    model: LinearizedModel,
) -> Hypothesis:
    """The hypothesis with gains over the null model; each model pays the penalty of the noise at which it is fitted."""
    instance = effect_with_key(fit.effects, key)
    sizes = {q.name for q in instance.effect.sizes}
    own = [i for i, (effect, q) in enumerate(fit.names) if effect == key and q in sizes]
    size = np.array([instance.values[fit.names[i][1]] for i in own])
    x = fit.columns[:, own]
    # before and after in one linear problem: the residuals without the effect are those with it, plus x size
    before = fit.white + x @ size
    settings = case.settings
    predictive = held_out_gain(
        before, x, fit.sigma[own], model.index.time, settings.held_out_block_s, settings.held_out_folds
    )
    predictive += whiten.log_likelihood(before) + case.log_abs_det_jacobian(fit.effects)
    return Hypothesis(
        key=key,
        fit=fit,
        normalised=model.normalised_innovations(whiten, fit.white),
        gain=fit.evidence - noise_penalty - null.evidence,
        score_gain=predictive - noise_penalty - null.log_likelihood,
        at_floor=at_floor,
        explained=x @ size,
        case=case,
        model=model,
        null=null,
    )


def with_gain_where_model_holds(
    h: Hypothesis, case: FlightCase, model: LinearizedModel, whiten: Whitening, null: NullModelFit
) -> Hypothesis:
    """The same estimates, with the gain in the linear problem about a point where the model without it holds.

    Two marginal likelihoods about different points differ by up to tens of nats more than about one point, since
    tables have changes of slope. The larger gain counts: away from its own places the linear problem does not have the
    whole evidence of an effect.

    Parameters
    ----------
    h : Hypothesis
        Fitted about another point, where the model without it fails.
    case, model : FlightCase, LinearizedModel
        Without the effect, about the point where the model holds.
    whiten : callable
        Whitening filter there, under which the model's own effects are marginalised.
    null : NullModelFit
        The model without it about that point.
    """
    linear = _fit_where_model_holds(case, model, [h.instance], whiten, null)
    if linear.gain <= h.gain:
        return h
    return replace(h, gain=linear.gain, score_gain=linear.score_gain)


def null_model_about(h: Hypothesis, case: FlightCase) -> tuple[LinearizedModel, NullModelFit] | None:
    """The model without an effect about the point of its hypothesis, where most of its gain is in the point.

    The iteration of a failing model's point may end before the model holds, or at a mode that is not the most probable
    one, whereas that with an effect of hardly any size goes on. The evidence that this point has over that of the null
    model is none for the effect.

    Parameters
    ----------
    h : Hypothesis
        Fitted about its own reconstruction, with its gain over the null model about the most probable point so far.
    case : FlightCase
        Without the effect.

    Returns
    -------
    model : LinearizedModel
    null : NullModelFit
        None for both where the larger part of the gain is that of the effect at its own point (Savage-Dickey ratio).
    """
    over_zero, least = h.fit.gain_over_zero(h.key), case.settings.named_gain_nats
    if over_zero > max(least, _OWN_SHARE * h.gain) or h.gain - over_zero < least:
        return None
    model = linearize_at(case, h.fit.point, h.model.failing_excess)
    null = fit_null_model(model, case.effects, h.null.excess_share)
    return model, replace(null, white_log_likelihood=max(null.white_log_likelihood, h.null.white_log_likelihood))


def as_projection(h: Hypothesis, leader: Hypothesis) -> tuple[float, Hypothesis]:
    """A hypothesis with the least squares projection of what a leader explains about its own point on its columns.

    Where the model without an effect fails, the Jacobians about its point are those of another motion, and neither the
    sizes of an effect nor its similarity to another one are known there. About the reconstruction of a leader that
    explains the flight they are.

    Parameters
    ----------
    h : Hypothesis
        Fitted about a failing model.
    leader : Hypothesis
        Fitted about its own reconstruction.

    Returns
    -------
    similarity : float
        Correlation of the leader's explained white residuals with the projection, between 0 and 1.
    hypothesis : Hypothesis
        With the sizes of the projection, within their bounds.
    """
    model = leader.model
    own, target = (effect_jacobian(model, a.at_zero()) for a in (h.instance, leader.instance))
    rows = np.concatenate((own.rows, target.rows), axis=1)
    white = model.fitted_noise_filter(rows, np.concatenate((own.initial_mean, target.initial_mean), axis=1))
    x = white[:, : len(own.names)]
    explained = white[:, len(own.names) :] @ np.array([leader.instance.values[name] for name in target.names])
    estimate = regress(explained, x, own.sigma).estimate
    values = h.instance.values | dict(zip(own.names, estimate.tolist(), strict=True))
    instance = replace(h.instance, values=values).within_bounds()
    effects = tuple(instance if a.key == h.key else a for a in h.fit.effects)
    limited = np.array([instance.values[name] for name in own.names])
    return correlation(explained, x @ limited), replace(h, fit=replace(h.fit, effects=effects))


def relinearize_with_effect(
    h: Hypothesis, reference: NullModelFit, contends: bool = True, converged: bool = False
) -> Hypothesis:
    """The same hypothesis fitted about a reconstruction that has the effect.

    The effect's change of the path then enters to all orders. The fit starts at the most likely parameters at the noise
    that the effect leaves. Where the model without the effect fails about its first point, the gain becomes that of the
    effect about its own point over the null model about the point where that is most probable (the ratio of two
    marginal likelihoods, each by Laplace's approximation at its own maximum). So it does where the model without the
    effect holds only with a nuisance parameter many sigmas from its stated value, if that gain is larger: there the
    Jacobians of the one maximum do not hold at the other. Where it holds with credible values, the gain of the first
    fit is kept: evidence differs by some nats from point to point, and both models are compared about the same one. The
    iteration ends at the first point if the effect explains little there, unless it contends and the null model makes
    progress about another point: then the effect may, too. Below `complemented_explained_share` of the misfit, with
    which no effect is named, it does not count.

    Parameters
    ----------
    h : Hypothesis
        Fitted about a point without the effect.
    reference : NullModelFit
        The model without the effect about the point where it is most probable.
    contends : bool
        Whether its gain about the first point is near that of the leader.
    converged : bool
        Whether its parameters are estimates about a reconstruction that has the effect (`as_projection`): the fit
        starts from them.
    """
    settings, start = h.case.settings, h
    if not (h.at_floor or h.model.holds or converged):
        at_stated_noise = [h.stated_noise_fit] if h.stated_noise_fit is not None else []
        start = _best(h.key, [h.fit], at_stated_noise, h.null, h.case, h.model, thorough=True)
    h.model.release()
    case = h.case.reconstruct_with(start.fit.effects)
    first = linearize_at(case, smoothed_point(case.reconstruction), h.model.failing_excess)
    failing_share = max(settings.holds_share, settings.alternative_progress * h.null.excess_share)
    explained_share = h.null.explained_share(first.white_excess_log_likelihood)
    fails = not start.at_floor and first.excess_variance.share > failing_share
    # not where the null model is about another point, or becomes more probable there
    smoothed = h.model.point.bin_states is None
    progress = reference.evidence - h.null.evidence > settings.complemented_explained_share * h.null.misfit
    comparable = smoothed and not (contends and progress)
    if comparable and fails and not converged and explained_share < settings.least_progress:
        return replace(start.with_reference(reference), explained_share=explained_share)
    case, model, fit = iterate_to_convergence(case, iterations=2, first=first)
    relinearized = _best(h.key, [fit], [], reference, case, model, thorough=True)
    if h.model.holds:
        same_point = h.with_reference(reference)
        credible = h.model.largest_nuisance_sigmas <= settings.credible_nuisance_sigmas
        if credible or same_point.gain >= relinearized.gain:
            relinearized = replace(relinearized, gain=same_point.gain, score_gain=same_point.score_gain)
    return replace(relinearized, explained_share=reference.explained_share(model.white_excess_log_likelihood))
