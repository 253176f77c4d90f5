"""Signatures: how every difference would change with an effect's parameters.

A signature is minus the derivative of all differences (`comparison`), so that differences = signature × size + noise
where the effect is missing. Whatever an effect changes is followed through the whole chain: samples, path, air, loads,
constraints. Effects that leave the path alone are asked on the path that is there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.diagnosis.chain import READING_HOOKS, Arrange, moves_air, moves_path
from edl_filter.diagnosis.comparison import (
    Differences,
    Frame,
    Setup,
    beside_held,
    compare,
    constraint_differences,
    more_predicted,
)
from edl_filter.diagnosis.deviating import offset
from edl_filter.diagnosis.path import PER_BIN, Path, dead_reckon, readings
from edl_filter.diagnosis.point import Point
from edl_filter.diagnosis.sensitivity import Slopes
from edl_filter.diagnosis.timeline import Order, stated_start
from edl_filter.effects.effect import Active, Effect, Parameter

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
    arranged, arranged_quiet : callable
        Effects → `Setup` of the mission's world; and with readings from which their own noise was taken.
    volume : callable
        Effects → what undoing them makes of a volume of readings, as its logarithm.
    effects : tuple of Active
        In the model.
    frame : Frame
    setup : Setup
    found : Differences
    slopes : Slopes
    order : Order
    point : Point
        About which it was computed.
    size : int
        Number of unknowns.
    """

    arranged: Arrange
    arranged_quiet: Arrange
    volume: Callable[[Sequence[Active]], float]
    effects: tuple[Active, ...]
    frame: Frame
    setup: Setup
    found: Differences
    slopes: Slopes
    order: Order
    point: Point
    size: int

    def arrange(self, effects: Sequence[Active]) -> Setup:
        """Model and measurements with effects, at the point's deviation."""
        return _deviating(self.arranged(effects), self.point)

    def arrange_quiet(self, effects: Sequence[Active]) -> Setup:
        """The same with quiet readings."""
        return _deviating(self.arranged_quiet(effects), self.point)

    def column(self, found: Differences) -> Array:
        """The differences ``(R,)`` that the unknowns and what is missing explain."""
        deviation = self.point.deviation
        return self.order.stack(found) + (0.0 if deviation is None else offset(self.order, self.slopes, deviation))

    def stated(self, setup: Setup) -> Array:
        """What a setup states of the unknowns at the beginning, about the point ``(n,)``."""
        out = np.zeros(self.size)
        out[: setup.problem.layout.size] = stated_start(setup, self.point.start)
        return out

    def moved(self, point: Point, effects: Sequence[Active]) -> Ground:
        """The same slopes about another point, with other effects."""
        frame = replace(self.frame, start=point.start.nav[:10], errors=point.errors)
        there = replace(self, effects=tuple(effects), frame=frame, point=point)
        setup = there.arrange(effects)
        return replace(there, setup=setup, found=compare(frame, setup))


def _deviating(setup: Setup, point: Point) -> Setup:
    return replace(setup, world=replace(setup.world, deviation=point.deviation))


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
        sides = [(*others, at(d)) for d in (step, -step)]
        plus, minus = (ground.arrange(effects) for effects in sides)
        if effect.acts("entry_state"):
            start = (ground.stated(minus) - ground.stated(plus)) / (2.0 * step)
        up, down = (dead_reckon(s.problem, ground.frame.start, ground.frame.errors) for s in (plus, minus))
        rows = carried(ground, up, down)
        for where, a, b in zip(
            ground.order.constraint_rows,
            constraint_differences(ground.frame, up, plus.problem),
            constraint_differences(ground.frame, down, minus.problem),
            strict=True,
        ):
            rows[where] = b - a
        if any(effect.acts(hook) for hook in READING_HOOKS):
            up_there, down_there = (_held(ground, effects) for effects in sides)
            rows += down_there - up_there
        return rows / (2.0 * step), start
    return _stacked(ground, *_loads_only(ground, others, at(step), at(-step))) / (2.0 * step), start


def carried(ground: Ground, up: Path, down: Path) -> Array:
    """What the predictions of the bins change from one path to another ``(R,)``.

    By the slopes by which the unknowns act: what an effect does to the path is nearly what an error of the start or of
    a sensor does, and a signature that went another way would keep, where those have been taken out, the difference
    of the two ways. That is a thousandth of the signature, and hundreds of sigmas.
    """
    edges = np.searchsorted(up.time, ground.frame.bins.edges - 1e-6)
    moved = np.concatenate(
        (up.nav[edges, :6] - down.nav[edges, :6], _turned(down.nav[edges, 6:], up.nav[edges, 6:])), axis=1
    )
    names = ground.slopes.names
    nav = slice(names["position"].start, names["attitude"].stop)
    felt = np.einsum("bij,bj->bi", ground.slopes.force[:, :, nav], 0.5 * (moved[1:] + moved[:-1]))
    return _stacked(ground, felt, np.einsum("bij,bj->bi", ground.slopes.turn[:, :, nav], moved[1:-1]))


def _turned(one: Array, other: Array) -> Array:
    """Rotation vectors ``(N, 3)`` that take one attitude to the other, in its body axes."""
    return rotations.to_rotation_vector(rotations.multiply(rotations.conjugate(one), other))


def _held(ground: Ground, effects: Sequence[Active]) -> Array:
    """Differences of the bins with effects, the path held where it is: what the readings themselves change ``(R,)``."""
    setup = ground.arrange_quiet(effects)
    there = beside_held(ground.frame, setup, readings(setup.problem, ground.frame.errors), ground.found)
    return ground.order.stack(there)


def _loads_only(ground: Ground, others: Sequence[Active], plus: Active, minus: Active) -> tuple[Array, Array]:
    """What the predictions change from `minus` to `plus`, on the path that is there.

    Air that is a little different acts by the slopes by which the unknown density and winds act, for the reason that
    `carried` gives.
    """
    bins, flow, tables = ground.frame.bins, ground.found.flow, ground.found.tables
    up, down = (ground.setup.world.having((*others, a)) for a in (plus, minus))
    (force_up, moment_up), (force_down, moment_down) = up.loads(flow, tables), down.loads(flow, tables)
    force, turn = more_predicted(up, bins, force_up - force_down, moment_up - moment_down)
    if moves_air(plus.effect):
        here, there = _air(ground, plus), _air(ground, minus)
        for name, value in here.items():
            column, amount = ground.slopes.names[name].start, value - there[name]
            force = force + ground.slopes.force[:, :, column] * amount[:, None]
            at_edge = 0.5 * (amount[:-1] + amount[1:])
            turn = turn + ground.slopes.turn[:, :, column] * at_edge[:, None]
    return force, turn


def _air(ground: Ground, active: Active) -> dict[str, Array]:
    """What an effect makes of the air at the bins' middles, as the unknowns count it."""
    middle = slice(PER_BIN // 2, None, PER_BIN)
    effect, altitude, place = active.effect, ground.found.flow.altitude[middle], ground.found.nodes.nav[middle]
    wind = effect.wind(active.values, altitude)
    turning = effect.atmosphere_rate(active.values) * ground.setup.world.planet.rotation_rate
    return {
        "density": np.log(effect.density(active.values, altitude)),
        "wind_east": wind[:, 0] + turning * np.hypot(place[:, 0], place[:, 1]),
        "wind_north": wind[:, 1],
    }


def _stacked(ground: Ground, force: Array, turn: Array) -> Array:
    """Predictions in the order of the rows; nothing elsewhere."""
    out = np.zeros(ground.order.count)
    table = np.zeros(ground.order.bin_rows.shape)
    table[:, :3], table[:-1, 3:6] = force, turn
    used = ground.order.bin_rows >= 0
    out[ground.order.bin_rows[used]] = table[used]
    return out
