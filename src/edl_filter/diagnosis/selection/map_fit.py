"""Maximum a posteriori fit of effects: all parameters, places and times included, by Gauss–Newton.

Each iteration predicts the readings with the effects at their values, computes the Jacobian there, whitens
both, and solves with the prior (Gelman et al., Bayesian Data Analysis, 2013, ch. 13; the evidence is Laplace's
approximation). A step that reduces the posterior is shortened. While effects are only compared, path and air stay at
the linearisation point of the model without the effect. In a final fit (`moving`) the point moves to the most probable
nuisance parameters at each new value of the effects: a gyro's bias and the initial roll, say, are strongly correlated
over many sigmas, and along a curved ridge of the posterior a fit that moves one of them alone stops far from the
maximum.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian, is_ordered, prior_sigma, stacked
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import at_map_point
from edl_filter.diagnosis.linear_model.linearization_point import LinearizationPoint
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.effects.base import EffectInstance, EffectKey, effect_with_key
from edl_filter.effects.parameters import Parameter
from edl_filter.estimation.kalman import Whitening, WhiteningFilter
from edl_filter.estimation.regression import regress
from edl_filter.types import Array

#: Factor by which a step is shortened.
_SHORTER = 0.3


@dataclass(frozen=True)
class MapFit:
    """Effects at their most probable values.

    Attributes
    ----------
    effects : tuple of EffectInstance
    names : tuple of ((str, str or None), str)
        Key of the effect, and parameter, of each column.
    covariance : (k, k) array
        Posterior covariance of the parameters; that of times contains the spacing of the nodes at which the model is
        evaluated.
    evidence : float
        Log marginal likelihood (Laplace), nats.
    residual_vector, initial_mean : (R,), (n,) arrays
        Residuals at these values, and the stated initial mean of the states.
    white : (R,) array
        White residuals.
    columns : (R, k) array
        White Jacobian at the last linearisation, before the last step.
    sigma : (k,) array
        Prior standard deviations.
    point : LinearizationPoint
        About which the residuals are.
    """

    effects: tuple[EffectInstance, ...]
    names: tuple[tuple[EffectKey, str], ...]
    covariance: Array
    evidence: float
    residual_vector: Array
    initial_mean: Array
    white: Array
    columns: Array
    sigma: Array
    point: LinearizationPoint

    @property
    def parameter_sigma(self) -> Array:
        """Posterior standard deviations ``(k,)``."""
        return np.sqrt(np.diag(self.covariance))

    def parameters(self, effect: EffectKey) -> dict[str, tuple[float, float]]:
        """Value and one sigma of every parameter of an effect; zero sigma where it was not fitted."""
        instance = effect_with_key(self.effects, effect)
        sigma = dict(zip(self.names, self.parameter_sigma, strict=True))
        return {q: (v, float(sigma.get((effect, q), 0.0))) for q, v in instance.values.items()}

    def gain_over_zero(self, effect: EffectKey) -> float:
        """Log Bayes factor of an effect over the same model with its sizes zero, nats.

        The model without the effect is nested in the model with it. The ratio of their marginal likelihoods is that of
        prior and posterior density of the sizes at zero, all other parameters marginalised (Savage-Dickey ratio:
        Dickey, Annals of Mathematical Statistics 42 (1971) 204), here in Laplace's approximation. No further fit is
        needed, but the approximation is poor many sigmas from zero: a large gain is an order of magnitude.
        """
        instance = effect_with_key(self.effects, effect)
        sizes = [q.name for q in instance.effect.sizes]
        own = [self.names.index((effect, name)) for name in sizes]
        values, covariance = np.array([instance.values[n] for n in sizes]), self.covariance[np.ix_(own, own)]
        log_volume = 0.5 * np.linalg.slogdet(covariance)[1] - float(np.sum(np.log(self.sigma[own])))
        return float(0.5 * values @ np.linalg.solve(covariance, values) + log_volume)


def fit_map(
    model: LinearizedModel,
    effects: Sequence[EffectInstance],
    whiten: WhiteningFilter,
    steps: int | None = None,
    moving: bool = False,
) -> MapFit:
    """Fit all free parameters of `effects`, starting at their values, limited to their bounds.

    The values of a linear screening can lie beyond the bounds, where the model may have no meaning (a negative
    density).

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    effects : sequence of EffectInstance
        All effects of the model that is fitted.
    whiten : WhiteningFilter
        Of the model, with an unmodelled acceleration or without.
    steps : int, optional
        Largest number of Gauss–Newton steps.
    moving : bool
        Whether the linearisation point moves with the effects.
    """
    settings = model.settings
    current = model.with_effects([a.within_bounds() for a in effects])
    free = [(a.key, q) for a in current.effects for q in a.fitted]
    names = tuple((e, q.name) for e, q in free)
    sigma = np.array([prior_sigma(q) for _, q in free])
    centre = np.array([0.0 if q.kind == "size" else _value(current.effects, e, q.name) for e, q in free])
    log_posterior, white = _log_posterior(current, whiten, centre, sigma, names)
    moved = at_map_point(current, whiten, white, current.effects) if moving else None
    if moved is not None:
        moved_posterior, moved_white = _log_posterior(moved, whiten, centre, sigma, names)
        if moved_posterior > log_posterior:
            current, log_posterior, white = moved, moved_posterior, moved_white

    columns = np.zeros((len(white), 0))
    covariance = np.diag(sigma**2)

    def search(step: Array, theta: Array) -> tuple[tuple[LinearizedModel, float, Array] | None, bool]:
        """The model after a part of the step that increases the posterior, and whether the whole step hardly does."""
        for part, trial in _line_search(current.effects, free, theta, step, settings.shortest_step):
            candidates = [current.with_effects(trial)]
            if moving:  # or not: the chord iteration of the point may lose tens of nats
                moved = at_map_point(current, whiten, white - part * (columns @ step), trial)
                if moved is None:
                    continue
                candidates.append(moved)
            values = [(c, *_log_posterior(c, whiten, centre, sigma, names)) for c in candidates]
            best = max(values, key=lambda v: v[1])
            if best[1] > log_posterior:
                return best, False
            if part == 1.0 and best[1] > log_posterior - settings.fit_convergence_nats:
                return None, True
        return None, False

    def at_nodes(best: tuple[LinearizedModel, float, Array]) -> tuple[LinearizedModel, float, Array]:
        """The model with each time in the middle between two nodes, within a bin, where the posterior is largest."""
        for key, q in [(e, q) for e, q in free if q.kind == "time"]:
            middles = _middles_between_nodes(best[0], _value(best[0].effects, key, q.name))
            trials = [_with_values(best[0].effects, [(key, q)], np.array([middle])) for middle in middles]
            models = [best[0].with_effects(trial) for trial in trials if all(is_ordered(a) for a in trial)]
            values = [(m, *_log_posterior(m, whiten, centre, sigma, names)) for m in models]
            largest = max(values, key=lambda v: v[1], default=best)
            if largest[1] > best[1] - settings.fit_convergence_nats:  # about equal where only the middle is new
                best = largest
        return best

    limit = settings.fit_iterations if steps is None else steps
    for _ in range(limit if free else 0):
        columns = _white_columns(current, whiten, free)
        prior = np.diag(1.0 / sigma**2)
        theta = np.array([_value(current.effects, e, q.name) for e, q in free])
        information = columns.T @ columns + prior
        covariance = np.linalg.inv(information)
        gradient = columns.T @ white - prior @ (theta - centre)
        better = None
        for step in _gauss_newton_steps(information, gradient, free):
            better, converged = search(step, theta)
            if better is not None or converged:
                break
        before = log_posterior
        current, log_posterior, white = better or (current, log_posterior, white)
        if log_posterior - before < settings.fit_convergence_nats:
            current, log_posterior, white = at_nodes((current, log_posterior, white))
        if log_posterior - before < settings.fit_convergence_nats:
            break
    log_volume = 0.5 * np.linalg.slogdet(covariance)[1] - float(np.sum(np.log(sigma))) if free else 0.0
    spacing = float(np.median(model.bins.interval)) / NODES_PER_BIN
    node_variance = np.array([spacing**2 / 12.0 if q.kind == "time" else 0.0 for _, q in free])
    canonical = tuple(a.canonical_phase() for a in current.effects)
    sign = np.array([_sign(canonical, current.effects, e, q) for e, q in free])
    return MapFit(
        effects=canonical,
        names=names,
        covariance=sign[:, None] * covariance * sign + np.diag(node_variance),
        evidence=log_posterior + log_volume,
        residual_vector=current.residual_vector,
        initial_mean=current.initial_mean,
        white=white,
        columns=columns * sign if columns.shape[1] else columns,
        sigma=sigma,
        point=current.point,
    )


def fit_linear(model: LinearizedModel, instance: EffectInstance, whiten: Whitening, null_evidence: float) -> MapFit:
    """Fit one further effect in the linear problem about the model's point.

    Where the model holds, its nuisance parameters are at their most probable values, and an effect that they have
    absorbed changes little in the sum of both. The linear problem then has the whole evidence, whereas residuals about
    a point moved with the same Jacobians (chord iteration) lose up to tens of nats.

    Parameters
    ----------
    model : LinearizedModel
        Without the effect.
    instance : EffectInstance
        At the places and sizes of the screening.
    whiten : callable
        Whitening filter under which the model's own effects are marginalised.
    null_evidence : float
        Log marginal likelihood of the model without the effect, nats.
    """
    places = [q for q in instance.fitted if q.kind != "size"]
    by_size = effect_jacobian(model, instance.at_zero())
    jacobians = [by_size, effect_jacobian(model, instance, [q.name for q in places])] if places else [by_size]
    columns = [model.residual_vector[:, None], *(j.rows for j in jacobians)]
    means = [model.initial_mean[:, None], *(j.initial_mean for j in jacobians)]
    white = whiten(np.concatenate(columns, axis=1), np.concatenate(means, axis=1))
    y, x, sigma = white[:, 0], white[:, 1:], np.concatenate([j.sigma for j in jacobians])
    fit = regress(y, x, sigma)
    values = dict(zip(by_size.names, fit.estimate.tolist(), strict=False))
    moved = {
        q.name: instance.values[q.name] + change
        for q, change in zip(places, fit.estimate[len(values) :].tolist(), strict=True)
    }
    estimate = replace(instance, values=instance.values | values).within_bounds()
    displaced = replace(estimate, values=estimate.values | moved).within_bounds()
    limited = np.array([estimate.values[name] for name in by_size.names] + fit.estimate[len(values) :].tolist())
    beyond = limited - fit.estimate
    names = tuple((instance.key, name) for name in (*by_size.names, *(q.name for q in places)))
    return MapFit(
        effects=(*model.effects, displaced if is_ordered(displaced) else estimate),
        names=names,
        covariance=fit.covariance,
        evidence=null_evidence + fit.gain - 0.5 * float(beyond @ np.linalg.solve(fit.covariance, beyond)),
        residual_vector=model.residual_vector,
        initial_mean=model.initial_mean,
        white=y - x @ limited,
        columns=x,
        sigma=sigma,
        point=model.point,
    )


@dataclass(frozen=True)
class NullModelFit:
    """The model without a further effect, at its most probable parameters: the reference of all gains.

    Attributes
    ----------
    evidence : float
        As that of a `MapFit`, at the noise that the model shows, less the penalty of that noise, nats.
    log_likelihood : float
        The same without the priors of parameters, nats.
    excess_share : float
        Share of the rows with excess variance about the point where the model may fail.
    white_log_likelihood : float
        With white excess variance, nats.
    holding_log_likelihood : float
        Expected of a model that holds, nats.
    """

    evidence: float
    log_likelihood: float
    excess_share: float
    white_log_likelihood: float
    holding_log_likelihood: float

    @property
    def misfit(self) -> float:
        """Log-likelihood between the null model and one that holds, nats."""
        return self.holding_log_likelihood - self.white_log_likelihood

    def explained_share(self, white_log_likelihood: float) -> float:
        """Share of the misfit that another model gains, 0 to 1."""
        gain = white_log_likelihood - self.white_log_likelihood
        if gain >= self.misfit or self.misfit <= 0.0:  # nothing is left to explain
            return 1.0
        return max(gain, 0.0) / self.misfit


def fit_null_model(
    model: LinearizedModel, effects: Sequence[EffectInstance], excess_share: float | None = None
) -> NullModelFit:
    """Fit the model without a further effect about a point.

    Its own effects are fitted as in every hypothesis, so that the cost of their priors is on both sides. Otherwise each
    of them would reduce the gains of all further effects by its own cost, some eight nats a parameter.

    Parameters
    ----------
    model : LinearizedModel
        About the point.
    effects : sequence of EffectInstance
        The model's.
    excess_share : float, optional
        Share of the rows with excess variance about the point where the model may fail; about this point if omitted.
    """
    steps, whiten = model.settings.null_fit_iterations, model.fitted_noise_filter
    best = fit_map(model, effects, whiten, steps=steps, moving=model.holds)
    log_likelihood = whiten.log_likelihood(best.white) + model.case.log_abs_det_jacobian(best.effects)
    share = model.excess_variance.share if excess_share is None else excess_share
    return NullModelFit(
        evidence=best.evidence - model.noise_penalty,
        log_likelihood=log_likelihood - model.noise_penalty,
        excess_share=share,
        white_log_likelihood=model.white_excess_log_likelihood,
        holding_log_likelihood=model.holding_log_likelihood,
    )


def most_probable_null(nulls: Sequence[NullModelFit]) -> NullModelFit:
    """The null model about the point where it is most probable; its white log-likelihood is the largest of all."""
    white = max(n.white_log_likelihood for n in nulls)
    return replace(max(nulls, key=lambda n: n.evidence), white_log_likelihood=white)


def _value(effects: Sequence[EffectInstance], effect: EffectKey, parameter: str) -> float:
    return effect_with_key(effects, effect).values[parameter]


def _middles_between_nodes(model: LinearizedModel, time: float) -> Array:
    """Times in the middle between adjoining nodes, a time bin before `time` and after it.

    The model is evaluated at the nodes, so that the likelihood of an effect's beginning changes only where it crosses a
    node: no derivative shows it, and the time between two nodes is uniformly distributed.
    """
    nodes = model.residuals.nodes.time
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    between = int(np.searchsorted(nodes, time)) - 1
    return np.asarray(middles[max(between - NODES_PER_BIN, 0) : between + NODES_PER_BIN + 1], np.float64)


def _sign(
    canonical: Sequence[EffectInstance], fitted: Sequence[EffectInstance], effect: EffectKey, parameter: Parameter
) -> float:
    """-1 for a size whose sign the canonical form changes, its phase half a turn on; otherwise 1."""
    if parameter.kind != "size":
        return 1.0
    return -1.0 if _value(canonical, effect, parameter.name) * _value(fitted, effect, parameter.name) < 0.0 else 1.0


def _gauss_newton_steps(
    information: Array, gradient: Array, free: Sequence[tuple[EffectKey, Parameter]]
) -> Iterator[Array]:
    """The step of all parameters, then that of the sizes with the places fixed.

    The prediction is summed over nodes within each time bin, so that the likelihood has a step where a place crosses a
    node. There no step of all parameters may increase it although the sizes are far from their maximum.
    """
    yield np.asarray(np.linalg.solve(information, gradient))
    size = np.array([q.kind == "size" for _, q in free])
    if not np.all(size) and np.any(size):
        step = np.zeros(len(free))
        step[size] = np.linalg.solve(information[np.ix_(size, size)], gradient[size])
        yield step


def _line_search(
    effects: Sequence[EffectInstance],
    free: Sequence[tuple[EffectKey, Parameter]],
    theta: Array,
    step: Array,
    shortest: float,
) -> Iterator[tuple[float, tuple[EffectInstance, ...]]]:
    """The whole step, then decreasing parts of it; not those that place an upper bound below a lower one."""
    part = 1.0
    while part > shortest:
        trial = _with_values(effects, free, theta + part * step)
        if all(is_ordered(a) for a in trial):
            yield part, trial
        part *= _SHORTER


def _with_values(
    effects: Sequence[EffectInstance], free: Sequence[tuple[EffectKey, Parameter]], theta: Array
) -> tuple[EffectInstance, ...]:
    """Effects with the free parameters at `theta`, limited to their bounds."""
    values: dict[EffectKey, dict[str, float]] = {}
    for (effect, q), v in zip(free, theta, strict=True):
        values.setdefault(effect, {})[q.name] = float(v)
    return tuple(replace(a, values=a.values | values.get(a.key, {})).within_bounds() for a in effects)


def _log_posterior(
    model: LinearizedModel, whiten: WhiteningFilter, centre: Array, sigma: Array, names: Sequence[tuple[EffectKey, str]]
) -> tuple[float, Array]:
    """Log posterior up to a constant, and the white residuals."""
    white = model.white_residuals(whiten)
    theta = np.array([_value(model.effects, e, n) for e, n in names])
    log_likelihood = whiten.log_likelihood(white) + model.case.log_abs_det_jacobian(model.effects)
    return log_likelihood - 0.5 * float(np.sum(((theta - centre) / sigma) ** 2)), white


def _white_columns(
    model: LinearizedModel, whiten: WhiteningFilter, free: Sequence[tuple[EffectKey, Parameter]]
) -> Array:
    """White Jacobian with respect to all free parameters ``(R, k)``, with the effects at their values."""
    by_effect: dict[EffectKey, list[str]] = {}
    for effect, q in free:
        by_effect.setdefault(effect, []).append(q.name)
    parts = [effect_jacobian(model, effect_with_key(model.effects, e), names) for e, names in by_effect.items()]
    return whiten(*stacked(parts))
