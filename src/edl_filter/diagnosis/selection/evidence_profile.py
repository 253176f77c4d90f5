"""Evidence of one effect against one of its places: at which onset it would explain most, and how sharply."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from edl_filter.diagnosis.linear_model.effect_jacobian import effect_jacobian, is_ordered, scan_grid, scan_range
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.selection.screening import marginalize_model_effects
from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.registry import find_effect, validated_effect
from edl_filter.errors import InputError
from edl_filter.estimation.regression import regress

if TYPE_CHECKING:
    from xarray import DataArray


def evidence_profile(
    model: LinearizedModel,
    effect: str | Effect | type[Effect],
    place: str | None = None,
    values: Sequence[float] | None = None,
) -> DataArray:
    """Evidence of an effect at every value of a place, at the noise that the model shows.

    For each value the best combination of the other places is taken.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    effect : str, Effect or class
        Not in the model.
    place : str, optional
        Parameter that says where; the first one that is scanned if not given.
    values : sequence of float, optional
        Where to evaluate it, instead of the catalogue's grid.

    Returns
    -------
    DataArray
        Gain over the model as it is (nats), along the parameter's name.

    Raises
    ------
    InputError
        The effect is in the model, or has no such place, or none of the values is in order with its other places.
    """
    from xarray import DataArray

    resolved = find_effect(effect) if isinstance(effect, str) else validated_effect(effect)
    if any(a.key == (resolved.name, None) for a in model.effects):
        raise InputError(f"scan: found {resolved.name} in the model already; expected an effect that is not.")
    q = _scanned_place(resolved, place)
    begin, lowest = scan_range(model)
    whiten = marginalize_model_effects(model, model.fitted_noise_filter)
    y = model.white_residuals(whiten)
    best: dict[float, float] = {}
    grid = scan_grid(resolved, begin, float(model.bins.edges[-1]), lowest, model.settings)
    if values is not None:
        remaining = {tuple((places | {q.name: 0.0}).items()) for places in grid}
        grid = [dict(places) | {q.name: float(v)} for places in remaining for v in values]
        grid = [places for places in grid if is_ordered(EffectInstance(resolved, places))]
        if not grid:
            raise InputError(f"scan: found no value of {q.name} that is in order with the effect's other bounds.")
    for places in grid:
        j = effect_jacobian(model, EffectInstance(resolved, places))
        gain = regress(y, whiten(j.rows, j.initial_mean), j.sigma).gain
        best[places[q.name]] = max(gain, best.get(places[q.name], -np.inf))
    axis = sorted(best)
    gains = DataArray(
        [best[v] for v in axis],
        {q.name: (q.name, axis, {"units": q.unit, "long_name": q.description})},
        (q.name,),
        name=resolved.name,
    )
    gains.attrs = {"units": "nats", "long_name": f"evidence for {resolved.name} over the model as it is"}
    return gains


def _scanned_place(effect: Effect, place: str | None) -> Parameter:
    scanned = {q.name: q for q in effect.places if q.scan > 1}
    if not scanned or (place is not None and place not in scanned):
        accepted = ", ".join(scanned) or "none"
        raise InputError(f"scan: found {place or 'no place'} of {effect.name}; accepted: {accepted}.")
    return scanned[place] if place is not None else next(iter(scanned.values()))
