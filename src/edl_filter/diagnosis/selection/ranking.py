"""Ranking: which effect is missing, by evidence.

Every effect of the catalogue that is not in the model is screened linearly (`screening`), once at the noise that the
model shows and once at the stated noise. The shortlisted effects are fitted (`hypothesis`), the leading ones about a
new reconstruction. The same evidence, in nats, is computed for the model without a further effect and for an unmodelled
acceleration (`noise.unmodelled_acceleration`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from edl_filter.diagnosis.linear_model.credible_model import credible_model
from edl_filter.diagnosis.linear_model.flight_case import FlightCase
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration, most_likely_process
from edl_filter.diagnosis.noise.variance_components import estimate_variance_components
from edl_filter.diagnosis.selection.hypothesis import (
    Hypothesis,
    as_projection,
    fit_hypothesis,
    null_model_about,
    relinearize_with_effect,
    with_gain_where_model_holds,
)
from edl_filter.diagnosis.selection.map_fit import NullModelFit, fit_null_model, most_probable_null
from edl_filter.diagnosis.selection.screening import (
    ScreeningResult,
    correlation,
    marginalize_model_effects,
    scan_jacobians,
    screen,
    shortlist,
)
from edl_filter.effects.base import Effect, EffectInstance, EffectKey, label_of
from edl_filter.effects.instances import candidates
from edl_filter.effects.sensor_chain import canonical_key
from edl_filter.errors import InputError
from edl_filter.estimation.kalman import Whitening, log_likelihood, whitening_filter
from edl_filter.estimation.parallel import in_background, map_processes, one_blas_thread, process_count

Progress = Callable[[str], None]

#: Share of the prior cost of a name below which effects are not relinearised where the model holds: gains about the
#: first point are accurate there, and none of the effects can be named.
_NAMEABLE_SHARE = 0.5
#: Share of the misfit about the point of the screening that another point explains without a further effect, from which
#: effects are screened about that one too. A smaller one is the point's convergence, and the screening serves both.
_MOVED_SHARE = 0.5


@dataclass(frozen=True)
class Ranking:
    """All hypotheses about one model.

    Attributes
    ----------
    case, model : FlightCase, LinearizedModel
    screening : dict
        Key of the effect → screening result at the noise that the model without it shows.
    hypotheses : list of Hypothesis
        Fitted, most probable first.
    unmodelled : UnmodelledAcceleration
        The most likely process.
    unmodelled_gain : float
        Its evidence over the model at its own noise about the point where it is most likely, as all gains, nats.
    excess_noise_gain : float
        Evidence of the noise that this model shows over the stated noise about the same point, less the penalty of its
        variances; zero where the model holds there.
    nuisance_gain : float
        Evidence that the sigma of the nuisance parameter farthest off is larger than stated (`nuisance_gain`).
    failed : dict
        Label of the effect → message of a user's effect whose hooks fail.
    """

    case: FlightCase
    model: LinearizedModel
    screening: dict[EffectKey, ScreeningResult]
    hypotheses: list[Hypothesis]
    unmodelled: UnmodelledAcceleration
    unmodelled_gain: float
    excess_noise_gain: float
    nuisance_gain: float = 0.0
    failed: dict[str, str] = field(default_factory=dict)


def rank(case: FlightCase, effects: Iterable[Effect], progress: Progress = lambda _: None) -> Ranking:
    """Rank the effects that may be missing from a case's model.

    Parameters
    ----------
    case : FlightCase
        The flight with what its mission states as uncertain.
    effects : iterable of Effect
        Those in the model already are passed over, or offered once more if they act at a place; sensor effects are
        offered in every IMU (`effects.instances.candidates`).
    progress : callable
        Called with what is being done.
    """
    with (
        one_blas_thread()
    ):  # throughout: of two threads that limit BLAS in turn the second would restore the first's limit
        effects = list(effects)
        ranking = _rank(case, candidate_instances(case, effects), progress)
        return _with_complement(ranking, effects, progress)


def _with_complement(ranking: Ranking, effects: Sequence[Effect], progress: Progress) -> Ranking:
    """The ranking, whose first name states whether a second effect explains what it leaves.

    The first name is the one that `decide` would give: that with the largest `Hypothesis.conservative_gain`. A second
    effect is sought only where the first explains at least `complemented_explained_share` and less than
    `sufficient_share`, and leaves excess variance. The first of two hidden effects does so, and so does an incorrect
    effect that resembles a part of something outside the catalogue. A first effect below `named_explained_share` needs
    a second one with which hardly any excess variance is left.
    """
    settings = ranking.case.settings
    if not ranking.hypotheses:
        return ranking
    place = max(range(len(ranking.hypotheses)), key=lambda i: ranking.hypotheses[i].conservative_gain)
    first = ranking.hypotheses[place]
    ambiguous = settings.complemented_explained_share <= first.explained_share < settings.sufficient_share
    if first.at_floor or not ambiguous:
        return ranking
    progress(f"searching for a second effect in addition to {first.label}")
    case = ranking.case.reconstruct_with(first.fit.effects)
    seconds = _rank(case, candidate_instances(case, effects), progress).hypotheses
    least = settings.sufficient_share if first.explained_share >= settings.named_explained_share else np.inf
    complemented = any(h.at_floor or h.explained_share >= least for h in seconds)
    hypotheses = list(ranking.hypotheses)
    hypotheses[place] = replace(first, complemented=complemented)
    return replace(ranking, hypotheses=hypotheses)


def _rank(case: FlightCase, effects: Sequence[EffectInstance], progress: Progress) -> Ranking:
    """The ranking without the search for a second effect.

    Effects are screened about the point of `credible_model`. Where its model fails and another point, of its
    alternative mode or of a hypothesis, explains most of the misfit, the path of the first point is far from the
    truth: what is missing in addition is not seen there. If the leader does not explain the flight, effects are then
    screened about the most probable point too. Of two effects, one may move the path so far that the other one is
    found only there.
    """
    settings = case.settings
    progress("comparing model and measurements")
    model, alternative_mode = credible_model(case)
    case = model.case
    holding = alternative_mode if alternative_mode is not None and alternative_mode.holds else None
    models = [m for m in (model, alternative_mode) if m is not None]
    nulls = []
    if alternative_mode is not None:
        alternative_mode.release_filters()
    for m in models:
        nulls.append(fit_null_model(m, case.effects, model.excess_variance.share))
        m.release_filters()  # from here on, one model has filters at a time
    reference, most_likely = most_probable_null(nulls), max(models, key=lambda m: m.log_evidence)
    progress("screening the catalogue and an unmodelled acceleration")
    # the cached properties of the model that it reads were computed for `most_likely`, before a thread may start
    with in_background(lambda: fit_unmodelled(model)) as unmodelled_fit:
        failed: dict[str, str] = {}
        # where the model holds an effect has its full evidence, for which the scan of one with places is too coarse
        shares = [effects]
        if holding is not None:
            shares = [[a for a in effects if a.effect.places], [a for a in effects if not a.effect.places]]
        screenings = []
        for m, share in zip(models, shares, strict=False):
            screenings.append(_screen(m, share, case.end, failed))
            m.release_filters()
        hypotheses: list[Hypothesis] = []
        for screened, null in zip(screenings, nulls, strict=False):
            best = max((h.gain for h in hypotheses), default=0.0)
            fitted = _fit_shortlist(case, screened, null, settings.rival_gain_share * best, failed, progress)
            relinearized, better = _relinearize_leaders(case, fitted, reference, failed, progress)
            if better is not None:
                most_likely, reference = better
                hypotheses = [h.with_reference(reference) for h in hypotheses]
            if holding is not None and screened.model is not holding:
                relinearized = _compare_where_model_holds(case, relinearized, screenings[-1], nulls[-1])
            hypotheses += relinearized
            screened.model.release()
        hypotheses.sort(key=lambda h: -h.gain)
        unexplained = bool(hypotheses) and hypotheses[0].explained_share < settings.sufficient_share
        at_screening = max(nulls[: len(screenings)], key=lambda n: n.evidence)
        if unexplained and at_screening.explained_share(reference.white_log_likelihood) >= _MOVED_SHARE:
            progress("screening about the most probable point")
            screened = _screen(most_likely, effects, case.end, failed)
            fitted = _fit_shortlist(case, screened, reference, 0.0, failed, progress)
            relinearized, better = _relinearize_leaders(case, fitted, reference, failed, progress)
            if better is not None:
                most_likely, reference = better
            hypotheses = _most_probable([h.with_reference(reference) for h in (*hypotheses, *relinearized)])
            screened.model.release()
        unmodelled, unmodelled_evidence = unmodelled_fit()
    if most_likely is not model and any(h.conservative_gain > settings.named_gain_nats for h in hypotheses):
        # a name may be given: it is compared with the process about the same point
        unmodelled, unmodelled_evidence = max(
            (unmodelled, unmodelled_evidence), fit_unmodelled(most_likely), key=lambda fit: fit[1]
        )
    at_stated_noise = log_likelihood(most_likely.state_space, most_likely.residual_vector, most_likely.initial_mean)
    return Ranking(
        case=case,
        model=model,
        screening={key: result for screened in screenings for key, result in screened.results[0].items()},
        hypotheses=hypotheses,
        unmodelled=unmodelled,
        # the model's own effects are at their values in both
        unmodelled_gain=unmodelled_evidence - most_likely.log_evidence,
        excess_noise_gain=most_likely.log_evidence - at_stated_noise,
        nuisance_gain=nuisance_gain(most_likely),
        failed=failed,
    )


def _most_probable(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """The hypothesis with the largest gain of each effect, sorted by gain."""
    by_gain = sorted(hypotheses, key=lambda h: h.gain)
    return sorted({h.key: h for h in by_gain}.values(), key=lambda h: -h.gain)


def nuisance_gain(model: LinearizedModel) -> float:
    """Evidence that one stated sigma is too small, nats.

    The log Bayes factor of the most likely sigma over the stated one for the parameter that is farthest off, by z
    sigmas, z²/2 - 1/2 - log z, less the logarithm of the number of parameters from which it was selected.

    Parameters
    ----------
    model : LinearizedModel
        About the point where it is most probable.

    Returns
    -------
    float
        Zero where the model fails, or where no parameter is farther off than the largest of so many by chance.
    """
    z = model.largest_nuisance_sigmas
    if not model.holds or z <= 1.0:
        return 0.0
    return max(0.5 * z**2 - 0.5 - float(np.log(z)) - float(np.log(model.state_space.size)), 0.0)


def _compare_where_model_holds(
    case: FlightCase, hypotheses: Sequence[Hypothesis], screened: _Screened, null: NullModelFit
) -> list[Hypothesis]:
    """Hypotheses that leave hardly any excess variance, also about the point where the model without them holds."""
    if not any(h.at_floor for h in hypotheses):
        return list(hypotheses)
    whiten = _filters(screened.model)[0]
    return [with_gain_where_model_holds(h, case, screened.model, whiten, null) if h.at_floor else h for h in hypotheses]


@dataclass(frozen=True)
class _Screened:
    """Effects screened about one point, with each whitening filter of `_filters`."""

    model: LinearizedModel
    results: list[dict[EffectKey, ScreeningResult]]


def candidate_instances(case: FlightCase, effects: Iterable[Effect]) -> list[EffectInstance]:
    """Effects, at zero, that may be missing from a case's model: `effects.instances.candidates` for its IMUs."""
    telemetry = case.reconstruction.telemetry
    present = {canonical_key(a, telemetry.driving) for a in case.effects}
    return candidates(effects, present, [record.name for record in telemetry.checking])


def _screen(model: LinearizedModel, effects: Sequence[EffectInstance], end: float, failed: dict[str, str]) -> _Screened:
    """At the noise that the model shows, and at the stated noise; without the effects whose hooks fail."""
    results = screen(model, _filters(model), scan_jacobians(model, effects, end, failed))
    return _Screened(model, [{k: r for k, r in result.items() if label_of(k) not in failed} for result in results])


def _filters(model: LinearizedModel) -> list[Whitening]:
    """Whitening filters at the noise that the model shows and, where that differs, at the stated noise."""
    noises = [model.fitted_noise_filter]
    if not model.excess_variance.is_zero:
        noises.append(model.stated_noise_filter)
    return [marginalize_model_effects(model, w) for w in noises]


def _fit_shortlist(
    case: FlightCase,
    screened: _Screened,
    null: NullModelFit,
    least: float,
    failed: dict[str, str],
    progress: Progress,
) -> list[Hypothesis]:
    """The shortlisted effects fitted: those whose linear gain is not below `least`.

    As many as there are processes are fitted at first, and then all others: where a model fails, one of the first may
    explain everything, and dissimilar effects are not fitted.
    """
    settings, results, filters = case.settings, screened.results, _filters(screened.model)
    keys = [k for k in shortlist(results, settings) if max(r[k].gain for r in results) >= least]
    hypotheses: list[Hypothesis] = []

    def is_dissimilar(key: EffectKey) -> bool:
        """Whether a hypothesis explains everything about a failing model, and this effect is dissimilar to it."""
        solved = next((h for h in hypotheses if h.at_floor), None) if not screened.model.holds else None
        if solved is None:
            return False
        similarity = correlation(results[-1][solved.key].explained, results[-1][key].explained)
        return similarity < settings.distinct_correlation

    def fit(key: EffectKey) -> Hypothesis | InputError:
        starts = [(r[key], whiten) for r, whiten in zip(results, filters, strict=True)]
        try:
            return fit_hypothesis(case, screened.model, starts, null)
        except InputError as error:
            return error

    model = screened.model
    known = (*case.effects, *model.point.constants, *(results[0][k].instance for k in keys))
    shared = [case, model.case, model, model.point, model.field, model.units, null, *(a.effect for a in known)]
    count = process_count()
    groups = [keys[:count], keys[count:]] if count > 1 else [[k] for k in keys]
    for group in groups:
        group = [k for k in group if not is_dissimilar(k)]
        for key in group:
            progress(f"refitting {label_of(key)}")
        for key, hypothesis in zip(group, map_processes(fit, group, shared), strict=True):
            if is_dissimilar(key):
                continue
            if isinstance(hypothesis, InputError):
                failed[label_of(key)] = str(hypothesis)
            elif np.any(hypothesis.explained):  # an effect whose place is outside the flight is no hypothesis
                hypotheses.append(hypothesis)
    return hypotheses


def fit_unmodelled(model: LinearizedModel) -> tuple[UnmodelledAcceleration, float]:
    """The most likely unmodelled acceleration, and the log evidence with it at the noise that it leaves, nats.

    The penalty of that noise is subtracted. Excess variance alone is an alternative, if the flight is more probable
    with that.
    """

    def likelihood_with(unmodelled: UnmodelledAcceleration) -> float:
        state_space = model.state_space_with_unmodelled(unmodelled)
        return log_likelihood(state_space, model.residual_vector, model.initial_mean)

    unmodelled, likelihood = most_likely_process(likelihood_with, model.settings)
    if model.excess_variance.is_zero:
        return unmodelled, likelihood
    excess, whiten = estimate_variance_components(
        whitening_filter(model.state_space_with_unmodelled(unmodelled)),
        model.index,
        model.residual_vector,
        model.initial_mean,
        model.settings,
        model.failing_excess,
    )
    evidence = whiten.log_likelihood(model.white_residuals(whiten)) - excess.penalty
    return unmodelled, max(evidence, model.log_evidence)


def _relinearize_leaders(
    case: FlightCase,
    hypotheses: list[Hypothesis],
    reference: NullModelFit,
    failed: dict[str, str],
    progress: Progress,
) -> tuple[list[Hypothesis], tuple[LinearizedModel, NullModelFit] | None]:
    """All hypotheses, the leader fitted about its own reconstruction, and others that may overtake it there.

    About a failing model gains are accurate to a factor only: a wrong name may lead where the right one changes the
    path by much. The right one reaches the noise about its own path, if nothing else is missing. So those with a share
    `rival_gain_share` of the leader's gain are relinearised too, and the ones that are best at the stated noise and at
    the noise that they leave. Where the leader explains everything, only those that explain the same can be as good;
    where it leaves excess variance, those that explain the same may explain the rest about their own reconstruction.
    About the reconstruction of a leader that explains everything, all hypotheses are compared with it once more
    (`_projections`).
    All gains are over the null model about the point where it is most probable, which is no advantage to those that are
    not relinearised. That point may be one of a hypothesis whose effect is insignificant there (`null_model_about`):
    then the null model about it, the most probable one of these, is returned too, and None otherwise.
    """
    settings = case.settings
    ranked = sorted(hypotheses, key=lambda h: -h.gain)
    close: list[EffectKey] = []
    best_by_evidence: list[EffectKey] = []
    if ranked and not ranked[0].model.holds:
        close = [h.key for h in ranked if h.gain > settings.rival_gain_share * ranked[0].gain]
        evidence = {h.key: h.stated_noise_fit.evidence for h in hypotheses if h.stated_noise_fit is not None}
        best_by_evidence = [max(hypotheses, key=lambda h: h.own_noise_evidence).key]
        best_by_evidence += sorted(evidence, key=lambda k: evidence[k])[-1:]
    projections: dict[EffectKey, Hypothesis] = {}
    explained, model_holds = {h.key: h.explained for h in ranked}, bool(ranked) and ranked[0].model.holds
    relinearized: set[EffectKey] = set()
    if model_holds and ranked[0].gain < _NAMEABLE_SHARE * settings.named_gain_nats:
        return [h.with_reference(reference) for h in ranked], None  # none of them can be named
    better: tuple[LinearizedModel, NullModelFit] | None = None
    while ranked and len(relinearized) < settings.relinearized_hypotheses:
        leader, rivals = explained[ranked[0].key], [*best_by_evidence, *close]
        if ranked[0].at_floor and ranked[0].gain > 0.0:
            rivals = [k for k in close if correlation(leader, explained[k]) >= settings.distinct_correlation]
            rivals += [h.key for h in ranked if h.key in projections]
        elif not ranked[0].at_floor and not model_holds:
            rivals += [h.key for h in ranked if correlation(leader, explained[h.key]) >= settings.same_correlation]
        waiting = [key for key in (ranked[0].key, *rivals) if key not in relinearized]
        if not waiting:
            break
        key = waiting[0]
        i = next(i for i, h in enumerate(ranked) if h.key == key)
        model_at_first_point = ranked[i].model
        relinearized.add(key)
        progress(f"refitting {label_of(key)} about a new reconstruction")
        try:
            start = projections.get(key, ranked[i])
            ranked[i] = relinearize_with_effect(start, reference, key in close, key in projections)
            null = null_model_about(ranked[i], case)
            if null is not None and null[1].evidence > reference.evidence:
                better, reference = null, null[1]
                ranked = [h.with_reference(reference) if h.key in relinearized else h for h in ranked]
        except InputError as error:
            failed[label_of(key)] = str(error)
        if ranked[i].model is not model_at_first_point:
            if ranked[i].at_floor and not model_holds and ranked[i].gain >= max(h.gain for h in ranked):
                projections = _projections(ranked[i], [h for h in ranked if h.key not in relinearized], failed)
            ranked[i].model.release()
        ranked.sort(key=lambda h: -h.gain)
    if better is not None:
        better[0].release_filters()
    return sorted((h.with_reference(reference) for h in ranked), key=lambda h: -h.gain), better


def _projections(
    leader: Hypothesis, others: Sequence[Hypothesis], failed: dict[str, str]
) -> dict[EffectKey, Hypothesis]:
    """Other hypotheses on whose columns the projection of what the leader explains is similar to it, with its sizes."""
    projections = {}
    for h in others:
        try:
            similarity, start = as_projection(h, leader)
        except InputError as error:
            failed[h.label] = str(error)
            continue
        if similarity >= leader.case.settings.same_correlation:
            projections[h.key] = start
    return projections
