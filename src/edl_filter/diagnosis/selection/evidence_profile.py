"""Evidence for one effect against one of its places: when an onset would explain most, and how sharply."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from edl_filter.diagnosis.beside import beside_own
from edl_filter.diagnosis.linear import Linear
from edl_filter.diagnosis.regression import regress
from edl_filter.diagnosis.signatures import places, signature
from edl_filter.effects.effect import Active, Effect, Parameter
from edl_filter.effects.loading import find_effect, of_session
from edl_filter.errors import InputError

if TYPE_CHECKING:
    from xarray import DataArray

#: Dynamic pressure from which a time is tried, Pa.
_FELT = 1.0


def scan(
    linear: Linear,
    effect: str | Effect | type[Effect],
    place: str | None = None,
    values: Sequence[float] | None = None,
) -> DataArray:
    """Evidence for an effect, with the model's failures taken for noise, at every value of a place.

    Of the places that differ in other parameters only the best counts.

    Parameters
    ----------
    linear : Linear
        The comparison.
    effect : str, Effect or class
        Not in the model.
    place : str, optional
        Parameter that says where; the first one that is scanned if not given.
    values : sequence of float, optional
        Where to try it, instead of the catalogue's grid.

    Returns
    -------
    DataArray
        Gain over the model as it is (nats), along the parameter's name.

    Raises
    ------
    InputError
        The effect is in the model, or has no such place.
    """
    from xarray import DataArray

    one = find_effect(effect) if isinstance(effect, str) else of_session(effect)
    if any(a.name == one.name for a in linear.ground.effects):
        raise InputError(f"scan: found {one.name} in the model already; expected an effect that is not.")
    q = _scanned(one, place)
    flow, nodes = linear.ground.found.flow, linear.ground.found.nodes.time
    begin = float(nodes[np.argmax(flow.dynamic_pressure > _FELT)])
    soft = beside_own(linear, linear.soft)
    y = linear.white(soft)
    best: dict[float, float] = {}
    tried = places(one, begin, float(linear.bins.edges[-1]), float(np.min(flow.altitude)))
    if values is not None:
        others = {tuple((at | {q.name: 0.0}).items()) for at in tried}
        tried = [dict(at) | {q.name: float(v)} for at in others for v in values]
    for at in tried:
        s = signature(linear.ground, Active(one, at))
        gain = regress(y, soft(s.rows, s.start), s.sigma).gain
        best[at[q.name]] = max(gain, best.get(at[q.name], -np.inf))
    grid = sorted(best)
    gains = DataArray(
        [best[v] for v in grid],
        {q.name: (q.name, grid, {"units": q.unit, "long_name": q.description})},
        (q.name,),
        name=one.name,
    )
    gains.attrs = {"units": "nats", "long_name": f"evidence for {one.name} over the model as it is"}
    return gains


def _scanned(effect: Effect, place: str | None) -> Parameter:
    found = {q.name: q for q in effect.places if q.scan > 1}
    if not found or (place is not None and place not in found):
        known = ", ".join(found) or "none"
        raise InputError(f"scan: found {place or 'no place'} of {effect.name}; accepted: {known}.")
    return found[place] if place is not None else next(iter(found.values()))
