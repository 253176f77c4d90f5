"""Screening: linear regression of the residuals on every effect of the catalogue, at every place of its scan grid.

The columns of an effect at each place are whitened and regressed on the residuals (`estimation.regression`). The result
is the effect's evidence, averaged over the places, and the places from which a nonlinear fit starts. While effects are
screened, the parameters of the model's own effects are marginalised with their priors, as they are free in every fit:
with X their white columns times their prior sigmas, white rows have the covariance ``1 + X Xᵀ``, whose inverse square
root is ``1 - U (1 - 1/√(1 + s²)) Uᵀ`` by the singular values s and left singular vectors U of X.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from edl_filter.diagnosis.linear_model.effect_jacobian import (
    EffectJacobian,
    effect_jacobian,
    effect_jacobians,
    is_ordered,
    is_wavelength,
    scan_grid,
    scan_range,
    stacked,
)
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.residual_analysis.change_point import abrupt_changes
from edl_filter.diagnosis.residual_analysis.unexplained import Remainder, describe_remainder
from edl_filter.effects.base import Effect, EffectInstance, EffectKey, Parameter
from edl_filter.estimation.kalman import Whitening, WhiteningFilter
from edl_filter.estimation.regression import LinearFit, regress, smallest_size
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array, SingleArray

Item = TypeVar("Item")

#: Columns that are whitened together at least.
_BATCH_COLUMNS = 64


@dataclass(frozen=True)
class ScreeningResult:
    """An effect regressed linearly, at its best place.

    Attributes
    ----------
    instance : EffectInstance
        With the estimated sizes.
    jacobian : EffectJacobian
    fit : LinearFit
    gain : float
        Log Bayes factor over the model without it, averaged over the places, nats.
    rows : (R, k) array
        White columns.
    information : (k,) array
        Largest squared norm of each white column over the places.
    alternatives : tuple of EffectInstance
        The effect at other places whose columns are dissimilar to those of the best, most likely first.
    """

    instance: EffectInstance
    jacobian: EffectJacobian
    fit: LinearFit
    gain: float
    rows: Array
    information: Array
    alternatives: tuple[EffectInstance, ...] = ()

    @property
    def explained(self) -> Array:
        """White residuals that the fit explains ``(R,)``."""
        return self.rows @ self.fit.estimate

    def smallest_sizes(self, gain: float) -> dict[str, float]:
        """Smallest value of each size whose expected gain is `gain` nats, at its most informative place."""
        return {
            name: smallest_size(float(a), float(s), gain)
            for name, a, s in zip(self.jacobian.names, self.information, self.jacobian.sigma, strict=True)
        }


def scan_jacobians(
    model: LinearizedModel, effects: Sequence[EffectInstance], end: float, failed: dict[str, str] | None = None
) -> Iterator[EffectJacobian]:
    """Columns of every effect at all places of its scan grid, effect by effect, a batch computed when it is asked for.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    effects : sequence of EffectInstance
        Their places are those of the scan grid.
    end : float
        End of the comparison, s: the last place in time.
    failed : dict, optional
        Effect → message of an effect whose hooks fail, perhaps after some of its places; raised if not given.

    Yields
    ------
    EffectJacobian
        Of one effect at one place.
    """
    messages: dict[str, str] = {} if failed is None else failed
    begin, lowest = scan_range(model)
    oscillating = any(_frequencies(a.effect) for a in effects)
    line = describe_remainder(model) if oscillating else None
    beginning = any(q.kind == "time" and q.scan > 1 for a in effects for q in a.effect.places)
    changes = abrupt_changes(model) if beginning else []

    def at_places() -> Iterator[EffectInstance]:
        for instance in effects:
            stated = _places_of_line(instance.effect, line)
            for places in scan_grid(instance.effect, begin, end, lowest, model.settings, stated, changes):
                if instance.label in messages:
                    break
                yield replace(instance, values=places)

    for batch in _batches(at_places(), lambda a: len(a.effect.sizes)):
        yield from effect_jacobians(model, [(a, None) for a in batch], failed)


def _frequencies(effect: Effect) -> list[Parameter]:
    return [q for q in effect.places if q.kind == "frequency" and q.scan > 1]


def _places_of_line(effect: Effect, remainder: Remainder | None) -> dict[str, list[float]]:
    """Places of an oscillating effect from the spectral line of the unexplained remainder; empty without one.

    A flight resolves a frequency to the inverse of the oscillation's duration, and an effect whose phase is zero at the
    epoch to an eighth of the inverse of its last time: a scan of its whole range would pass over it.
    """
    if remainder is None or remainder.frequency is None or not _frequencies(effect):
        return {}
    step, width = 0.125 / remainder.t1, 1.0 / (remainder.t1 - remainder.t0)
    offsets = step * np.arange(-np.ceil(width / step), np.ceil(width / step) + 1.0)
    places = {}
    for q in _frequencies(effect):
        values = remainder.frequency + offsets
        places[q.name] = values[(values >= q.low) & (values <= q.high)].tolist() or [q.default]
    times = [q for q in effect.places if q.kind == "time" and q.scan > 1]
    for q, time in zip(times, (remainder.t0, remainder.t1), strict=False):
        places[q.name] = [time]
    return places


def screen(
    model: LinearizedModel, filters: Sequence[Whitening], jacobians: Iterable[EffectJacobian]
) -> list[dict[EffectKey, ScreeningResult]]:
    """Regress the residuals on every effect, at every place.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    filters : sequence of callable
        Whitening filters, such as by `marginalize_model_effects`.
    jacobians : iterable of EffectJacobian
        Of `scan_jacobians`. A batch of them is whitened in one pass, and dropped.

    Returns
    -------
    list of dict
        For each filter: key of the effect → `ScreeningResult` at its best place.
    """
    residuals = [model.white_residuals(whiten) for whiten in filters]
    scans: list[dict[EffectKey, _Scan]] = [{} for _ in filters]
    for batch in _batches(jacobians, lambda j: len(j.names)):
        columns = stacked(batch)
        for whiten, y, by_key in zip(filters, residuals, scans, strict=True):
            white, column = whiten(*columns), 0
            for j in batch:
                x = white[:, column : column + len(j.names)]
                column += len(j.names)
                by_key.setdefault(j.instance.key, _Scan(model.settings)).add(j, x, y)
    return [{key: scan.result() for key, scan in by_key.items()} for by_key in scans]


def _batches(items: Iterable[Item], columns: Callable[[Item], int]) -> Iterator[list[Item]]:
    """Effects or their Jacobians with `_BATCH_COLUMNS` columns or a few more in each batch."""
    batch: list[Item] = []
    for item in items:
        batch.append(item)
        if sum(columns(i) for i in batch) >= _BATCH_COLUMNS:
            yield batch
            batch = []
    if batch:
        yield batch


class _Scan:
    """Fits of one effect at its places: of the columns only those of the best place are kept.

    What the fits explain is kept in single precision: of two places it only matters whether they are similar.
    """

    def __init__(self, settings: DecisionSettings) -> None:
        self.settings = settings
        self.gains: list[float] = []
        self.information: Array | float = 0.0
        self.best: tuple[LinearFit, EffectJacobian, Array] | None = None
        self.promising: list[tuple[float, EffectInstance, SingleArray]] = []

    def add(self, jacobian: EffectJacobian, x: Array, y: Array) -> None:
        """Regress white residuals `y` ``(R,)`` on the white columns `x` ``(R, k)`` of a place."""
        fit = regress(y, x, jacobian.sigma)
        self.gains.append(fit.gain)
        self.information = np.maximum(self.information, np.sum(x**2, axis=0))
        if self.best is None or fit.gain > self.best[0].gain:
            self.best = fit, jacobian, x.copy()  # a view would keep the columns of the whole batch
        if fit.gain > self.settings.minimum_screening_gain:
            explained = (x @ fit.estimate).astype(np.float32)
            self.promising.append((fit.gain, _with_sizes(jacobian, fit), explained))

    def result(self) -> ScreeningResult:
        """The fit at the best place, with the evidence averaged over all places."""
        assert self.best is not None
        fit, jacobian, x = self.best
        gains = np.array(self.gains)
        mean = float(gains.max() + np.log(np.mean(np.exp(gains - gains.max()))))
        information = np.asarray(self.information, float)
        return ScreeningResult(_with_sizes(jacobian, fit), jacobian, fit, mean, x, information, self._alternatives())

    def _alternatives(self) -> tuple[EffectInstance, ...]:
        """The effect at up to `starting_places` - 1 places besides the best, each dissimilar to those before."""
        ranked = sorted(self.promising, key=lambda place: -place[0])
        distinct = ranked[:1]
        for place in ranked[1:]:
            if len(distinct) == self.settings.starting_places:
                break
            y = place[2].astype(float)
            if all(correlation(y, d[2].astype(float)) < self.settings.distinct_correlation for d in distinct):
                distinct.append(place)
        return tuple(instance for _, instance, _ in distinct[1:])


def marginalize_model_effects(model: LinearizedModel, whiten: WhiteningFilter) -> Whitening:
    """A whitening filter under which the parameters of the model's own effects are nuisance parameters.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    whiten : WhiteningFilter
        Of the model's state space.

    Returns
    -------
    callable
        The filter itself where the model has no free effect.
    """
    own = [effect_jacobian(model, a, [q.name for q in a.fitted]) for a in model.effects if a.fitted]
    if not own:
        return whiten
    columns = whiten(*stacked(own))
    vectors, size, _ = np.linalg.svd(columns * np.concatenate([j.sigma for j in own]), full_matrices=False)
    removed = 1.0 - 1.0 / np.sqrt(1.0 + size**2)

    def marginalized(columns: Array, initial_mean: Array) -> Array:
        rows = whiten(columns, initial_mean)
        return rows - vectors @ (removed[:, None] * (vectors.T @ rows))

    return marginalized


def refine_places(model: LinearizedModel, instance: EffectInstance, whiten: Whitening) -> EffectInstance:
    """Move an effect's places by coordinate search with decreasing steps to where its evidence is largest."""
    scanned = [q for q in instance.effect.places if q.scan > 1]
    if not scanned:
        return instance
    settings, y = model.settings, model.white_residuals(whiten)

    def evaluate(candidate: EffectInstance) -> tuple[float, EffectInstance]:
        j = effect_jacobian(model, candidate.at_zero())
        fit = regress(y, whiten(j.rows, j.initial_mean), j.sigma)
        sizes = dict(zip(j.names, fit.estimate.tolist(), strict=True))
        return fit.gain, replace(candidate, values=candidate.values | sizes)

    gain, best = evaluate(instance)
    steps = {}
    for q in scanned:
        low, high = (q.low, q.high) if np.isfinite([q.low, q.high]).all() else (0.0, model.bins.edges[-1])
        spacing = (high - low) / (q.scan if q.kind == "phase" else q.scan - 1)
        if is_wavelength(q):
            spacing = instance.values[q.name] ** 2 * (1.0 / low - 1.0 / high) / (q.scan - 1)
        steps[q.name] = settings.altitude_step_m if q.kind == "altitude" else spacing
    for _ in range(settings.place_refinements):
        for name in steps:
            steps[name] *= 0.5
            for sign in (1.0, -1.0):
                candidate = replace(best, values=best.values | {name: best.values[name] + sign * steps[name]})
                if not (is_ordered(candidate) and _within_bounds(candidate, name)):
                    continue
                candidate_gain, fitted = evaluate(candidate)
                if candidate_gain > gain:
                    gain, best = candidate_gain, fitted
                    break
    return best


def shortlist(rankings: list[dict[EffectKey, ScreeningResult]], settings: DecisionSettings) -> list[EffectKey]:
    """Keys of the effects among the first of any screening, each once."""
    keys: list[EffectKey] = []
    for results in rankings:
        ranked = sorted(results, key=lambda k: -results[k].gain)
        positive = [k for k in ranked[: settings.shortlist_size] if results[k].gain > settings.minimum_screening_gain]
        keys += [k for k in positive if k not in keys]
    return keys


def correlation(a: Array, b: Array) -> float:
    """Absolute correlation of two explained residuals ``(R,)``; 0 where they belong to different linear models."""
    if len(a) != len(b):
        return 0.0
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return abs(float(a @ b)) / scale if scale > 0.0 else 0.0


def _with_sizes(jacobian: EffectJacobian, fit: LinearFit) -> EffectInstance:
    """The effect of a Jacobian with the sizes of a fit."""
    sizes = dict(zip(jacobian.names, fit.estimate.tolist(), strict=True))
    return replace(jacobian.instance, values=jacobian.instance.values | sizes)


def _within_bounds(instance: EffectInstance, name: str) -> bool:
    """Whether a place is between its bounds; a phase has none."""
    q = next(p for p in instance.effect.parameters if p.name == name)
    return q.kind == "phase" or q.low <= instance.values[name] <= q.high
