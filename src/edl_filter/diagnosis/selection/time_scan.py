"""Scan of the times of effects, from which a nonlinear fit starts where the model still fails.

In: a linearised model, effects with their values, and a whitening filter. Out: the effects with other times and, where
a time is far from its former value, other sizes. The likelihood is that of the linear-Gaussian problem about the
model's point, which stays.

An effect that begins at a time is a step, so that the likelihood has local maxima: of the time bins between the value
and the true time only those within the step of the derivative change it. No step of Gauss-Newton leaves such a maximum.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian, is_ordered, scan_range
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.effects.base import EffectInstance, EffectKey, effect_with_key
from edl_filter.effects.parameters import Parameter
from edl_filter.estimation.kalman import WhiteningFilter
from edl_filter.estimation.regression import regress

#: Residuals that are whitened together: each takes a tenth of the time that one takes alone.
_BATCH_COLUMNS = 64

Effects = tuple[EffectInstance, ...]


def scan_times(model: LinearizedModel, effects: Sequence[EffectInstance], whiten: WhiteningFilter) -> Effects:
    """Effects with each of their times at the largest likelihood of two scans.

    The first scan is over the flight, at the times of the screening, with the sizes most probable at each of them: the
    screening itself was about a point without the effect, where the model may fail by more than the effect. The second
    one is about the time of the first. The variance components of a fit allow for the bins that fail, over whole
    intervals (`noise_piece_s`), so that the likelihood hardly depends on the time within them, except in the bin of the
    true time: the scan covers an interval to each side.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    effects : sequence of EffectInstance
        All effects of the model.
    whiten : WhiteningFilter
        Of the model.

    Returns
    -------
    tuple of EffectInstance
        In the same order.
    """
    settings, best = model.settings, tuple(effects)
    steps = int(settings.noise_piece_s / settings.time_scan_step_s)
    offsets = settings.time_scan_step_s * np.arange(-steps, steps + 1)
    for key, q in [(a.key, q) for a in effects for q in a.fitted if q.kind == "time"]:
        best = most_likely(model, [best, *_screened(model, best, key, q, whiten)], whiten)
        value = effect_with_key(best, key).values[q.name]
        trials = [_at_time(best, key, q, value + float(offset)) for offset in offsets]
        ordered = [trial for trial in trials if all(is_ordered(a) for a in trial)]
        best = most_likely(model, [best, *ordered], whiten)
    return best


def most_likely(model: LinearizedModel, candidates: Sequence[Effects], whiten: WhiteningFilter) -> Effects:
    """The effects with which the residuals have the largest likelihood; of equal ones the first.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    candidates : sequence of tuple of EffectInstance
        Values of all effects of the model.
    whiten : WhiteningFilter
        Of the model.
    """
    likelihoods: list[float] = []
    for batch in (candidates[i : i + _BATCH_COLUMNS] for i in range(0, len(candidates), _BATCH_COLUMNS)):
        residuals = np.empty((model.index.count, len(batch)))
        initial_means = np.empty((len(model.initial_mean), len(batch)))
        for i, effects in enumerate(batch):
            changed = model.with_effects(effects)  # large: one is kept
            residuals[:, i], initial_means[:, i] = changed.residual_vector, changed.initial_mean
        likelihoods += [
            whiten.log_likelihood(column) + model.case.log_abs_det_jacobian(effects)
            for column, effects in zip(whiten(residuals, initial_means).T, batch, strict=True)
        ]
    return candidates[int(np.argmax(likelihoods))]


def _screened(
    model: LinearizedModel, effects: Effects, key: EffectKey, time: Parameter, whiten: WhiteningFilter
) -> list[Effects]:
    """The effects with one of their times, and the sizes that go with it, where its evidence is largest in the flight.

    Empty for an effect without free sizes, and for a time that is not screened.
    """
    instance = effect_with_key(effects, key)
    sizes = [q.name for q in instance.fitted if q.kind == "size"]
    if not sizes or time.scan < 2:
        return []
    without = model.with_effects([a for a in effects if a.key != key])
    y = without.white_residuals(whiten)
    best, gain = instance, -np.inf
    for value in np.linspace(scan_range(model)[0], model.case.end, time.scan):
        trial = replace(instance.at_zero(), values=instance.at_zero().values | {time.name: float(value)})
        if not is_ordered(trial):
            continue
        j = effect_jacobian(without, trial, sizes)
        fit = regress(y, whiten(j.rows, j.initial_mean), j.sigma)
        if fit.gain > gain:
            gain, best = fit.gain, replace(trial, values=trial.values | dict(zip(sizes, fit.estimate, strict=True)))
    return [tuple(best if a.key == key else a for a in effects)]


def _at_time(effects: Effects, key: EffectKey, time: Parameter, value: float) -> Effects:
    """Effects with one time at a value, limited to its bounds."""
    instance = effect_with_key(effects, key)
    moved = replace(instance, values=instance.values | {time.name: value}).within_bounds()
    return tuple(moved if a.key == key else a for a in effects)
