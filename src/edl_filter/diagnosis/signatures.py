"""Signatures: how every difference would change with an effect's parameters.

A signature is minus the derivative of all differences (`comparison`), so that differences = signature × size + noise
where the effect is missing. Whatever an effect changes is followed through the whole chain: samples, path, air, loads,
constraints. Effects that leave the path alone are asked on the path that is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.chain import Arrange, moves_air, moves_path
from edl_filter.diagnosis.comparison import Differences, Frame, Setup, compare, predicted
from edl_filter.diagnosis.path import PER_BIN
from edl_filter.diagnosis.sensitivity import Slopes
from edl_filter.diagnosis.timeline import Order, stated_start
from edl_filter.effects.effect import Active, Effect, Parameter
from edl_filter.navigation.layout import State

Array = NDArray[np.float64]
#: Altitude above which no layer begins or ends for the scan, and how far below the comparison's end it begins, m.
_THIN, _BELOW = 70e3, 3e3
#: Step of a derivative, in plausible sizes: small, for tables have bends wherever angles pass their nodes.
_STEP = 2e-3


@dataclass(frozen=True)
class Signature:
    """Columns of one effect.

    Attributes
    ----------
    active : Active
        About which values: its sizes are those of the model (zero if it is not in it).
    names : tuple of str
        Parameters, one per column.
    sigma : (k,) array
        Their plausible sizes.
    rows : (R, k) array
    start : (n, k) array
        What the columns expect of the unknowns at the beginning.
    """

    active: Active
    names: tuple[str, ...]
    sigma: Array
    rows: Array
    start: Array


@dataclass(frozen=True)
class Ground:
    """Where signatures are taken: a model, and all that was computed with it.

    Attributes
    ----------
    arrange : callable
        Effects → `Setup`.
    effects : tuple of Active
        In the model.
    frame : Frame
    setup : Setup
    found : Differences
    slopes : Slopes
    order : Order
    start : State
        Where the path begins.
    size : int
        Number of unknowns.
    """

    arrange: Arrange
    effects: tuple[Active, ...]
    frame: Frame
    setup: Setup
    found: Differences
    slopes: Slopes
    order: Order
    start: State
    size: int


def places(effect: Effect, begin: float, end: float, lowest: float | None = None) -> list[dict[str, float]]:
    """All places at which an effect is tried, at least one.

    Parameters
    ----------
    effect : Effect
    begin, end : float
        Bounds of parameters of kind ``time`` that have none, s.
    lowest : float, optional
        Altitude at which the comparison ends, m: altitudes are tried from a little below it upwards, in steps that grow
        as air thins.
    """
    grids = []
    for q in effect.places:
        low, high = (q.low, q.high) if np.isfinite([q.low, q.high]).all() else (begin, end)
        if q.scan == 0:
            grids.append([q.default])
        elif q.kind == "altitude" and lowest is not None:
            first = max(low, lowest - _BELOW)
            grids.append(list(first + (min(high, _THIN) - first) * (np.arange(q.scan) / (q.scan - 1)) ** 1.7))
        elif q.kind == "phase":
            grids.append(list(np.arange(q.scan) * (high - low) / q.scan + low))
        else:
            grids.append(list(np.linspace(low, high, q.scan)))
    names = [q.name for q in effect.places]
    found = [dict(zip(names, values, strict=True)) for values in product(*grids)]
    return [p for p in found if ordered(Active(effect, p))]


def ordered(active: Active) -> bool:
    """Lower edges lie below upper ones: bounds of one kind come in pairs, in the order of declaration."""
    for kind in ("altitude", "time", "mach"):
        values = [active.values[q.name] for q in active.effect.places if q.kind == kind]
        if any(b <= a for a, b in pairwise(values)):
            return False
    return True


def signature(ground: Ground, active: Active, names: Sequence[str] | None = None) -> Signature:
    """Columns of an effect about its values.

    Parameters
    ----------
    ground : Ground
    active : Active
        If an effect of that name is in the model, its column is taken about the model's values.
    names : sequence of str, optional
        Parameters; without it all sizes.
    """
    effect = active.effect
    wanted = tuple(names) if names is not None else tuple(q.name for q in effect.sizes)
    by_name = {q.name: q for q in effect.parameters}
    sigma = np.array([scale_of(by_name[n]) for n in wanted])
    rows, starts = [], []
    for name, s in zip(wanted, sigma, strict=True):
        step = _STEP * s if by_name[name].kind == "size" else _place_step(by_name[name].kind)
        column, start = _derivative(ground, active, name, step)
        rows.append(column)
        starts.append(start)
    return Signature(active, wanted, sigma, np.stack(rows, axis=1), np.stack(starts, axis=1))


def scale_of(parameter: Parameter) -> float:
    """One sigma of a parameter's prior: its plausible size, or that of a uniform one."""
    if parameter.kind == "size":
        return parameter.sigma
    spread = parameter.high - parameter.low
    return float(spread / np.sqrt(12.0)) if np.isfinite(spread) else 100.0


def _place_step(kind: str) -> float:
    """Step of a derivative by a place: s, m, m, rad, 1, Hz."""
    return {"time": 0.2, "altitude": 50.0, "length": 20.0, "phase": 0.01, "mach": 0.05}.get(kind, 1e-3)


def _derivative(ground: Ground, active: Active, name: str, step: float) -> tuple[Array, Array]:
    """Minus the derivative of the differences by one parameter, and of the start."""
    effect, others = active.effect, tuple(a for a in ground.effects if a.name != active.name)

    def at(change: float) -> Active:
        return replace(active, values=active.values | {name: active.values[name] + change})

    start = np.zeros(ground.size)
    if moves_path(effect):
        plus, minus = (ground.arrange((*others, at(d))) for d in (step, -step))
        up, down = (ground.order.stack(compare(ground.frame, s)) for s in (plus, minus))
        if effect.acts("entry_state"):
            n = ground.setup.problem.layout.size
            start[:n] = (stated_start(minus, ground.start) - stated_start(plus, ground.start)) / (2.0 * step)
        return (down - up) / (2.0 * step), start
    plus_p, minus_p = (_loads_only(ground, others, at(d)) for d in (step, -step))
    return (_stacked(ground, *plus_p) - _stacked(ground, *minus_p)) / (2.0 * step), start


def _loads_only(ground: Ground, others: Sequence[Active], active: Active) -> tuple[Array, Array]:
    """Predictions with the effect, on the path that is there."""
    world, bins = ground.setup.world.having((*others, active)), ground.frame.bins
    effect, flow = active.effect, ground.found.flow
    if not moves_air(effect):
        return predicted(world, bins, flow, ground.found.tables)
    if effect.acts("atmosphere_rate") or active.name in {a.name for a in ground.effects}:
        nodes = ground.found.nodes
        moved = world.flow(nodes.time, nodes.nav[:, :3], nodes.nav[:, 3:6], nodes.nav[:, 6:], nodes.rate)
        return predicted(world, bins, moved)
    # a scan has hundreds of places: air that is a little different acts by the slopes that are known
    force, turn = predicted(world, bins, flow, ground.found.tables)
    middle = flow.altitude[PER_BIN // 2 :: PER_BIN]
    denser, wind = np.log(effect.density(active.values, middle)), effect.wind(active.values, middle)
    for name, amount in (("density", denser), ("wind_east", wind[:, 0]), ("wind_north", wind[:, 1])):
        column = ground.slopes.names[name].start
        force = force + ground.slopes.force[:, :, column] * amount[:, None]
        at_edge = 0.5 * (amount[:-1] + amount[1:])
        turn = turn + ground.slopes.turn[:, :, column] * at_edge[:, None]
    return force, turn


def _stacked(ground: Ground, force: Array, turn: Array) -> Array:
    """Predictions in the order of the rows; nothing elsewhere."""
    out = np.zeros(ground.order.count)
    table = np.zeros(ground.order.bin_rows.shape)
    table[:, :3], table[:-1, 3:6] = force, turn
    used = ground.order.bin_rows >= 0
    out[ground.order.bin_rows[used]] = table[used]
    return out
