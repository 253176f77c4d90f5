"""Derivatives of all residuals with respect to the parameters of an effect.

A column is minus the derivative of the residuals, so that residual = column × parameter + noise where the effect is
missing. Whatever an effect changes is followed through all steps of the prediction: samples, path, air, loads,
constraints. An effect that does not change the path is evaluated on the existing path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from edl_filter import rotations
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.prediction.dead_reckoning import (
    NODES_PER_BIN,
    DeadReckonedPath,
    corrected_readings,
    dead_reckon,
)
from edl_filter.diagnosis.prediction.predicted_readings import predict_increment
from edl_filter.diagnosis.prediction.reading_difference import difference_on_fixed_path
from edl_filter.diagnosis.prediction.residuals import constraint_residuals, own_lever_arm
from edl_filter.effects.base import Effect, EffectInstance, EffectKey
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.sensor_chain import acts_on_driving
from edl_filter.errors import InputError
from edl_filter.estimation.parallel import map_processes
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array

#: Step of a derivative with respect to a size, in plausible sizes: small, since the slope of the tables changes
#: wherever an angle passes one of their nodes.
_SIZE_STEP = 2e-3
#: Number of Jacobians that are kept about a point. Only those of effects that change the path or the readings are: they
#: cost ten times the others, and the scan, the constant nuisance parameters and the first steps of fits have some in
#: common.
_KEPT_JACOBIANS = 64
#: Prior standard deviation of a time whose bounds are those of the flight, s: somewhat more than that of a uniform
#: distribution over an entry of four to five minutes.
_TIME_SIGMA = 100.0
#: Exponent by which the altitudes of a scan are spaced: steps increase as the air becomes thinner.
_ALTITUDE_SPACING = 1.7


@dataclass(frozen=True)
class EffectJacobian:
    """Columns of one effect.

    Attributes
    ----------
    instance : EffectInstance
        About whose values; its sizes are those of the model (zero if it is not in it).
    names : tuple of str
        Parameters, one per column.
    sigma : (k,) array
        Prior standard deviations.
    rows : (R, k) array
    initial_mean : (n, k) array
        Change of the stated initial mean of the states.
    """

    instance: EffectInstance
    names: tuple[str, ...]
    sigma: Array
    rows: Array
    initial_mean: Array


def stacked(jacobians: Sequence[EffectJacobian]) -> tuple[Array, Array]:
    """Columns of several Jacobians side by side: rows ``(R, k)``, and changes of the initial mean ``(n, k)``."""
    return (
        np.concatenate([j.rows for j in jacobians], axis=1),
        np.concatenate([j.initial_mean for j in jacobians], axis=1),
    )


def scan_grid(
    effect: Effect,
    begin: float,
    end: float,
    lowest: float,
    settings: DecisionSettings,
    stated: Mapping[str, Sequence[float]] | None = None,
    changes: Sequence[float] = (),
) -> list[dict[str, float]]:
    """All combinations of places at which an effect is screened, at least one.

    Lengths have equal steps of their inverse: over a flight's range of altitudes, two waves are dissimilar by the
    difference of their wave numbers, not of their lengths.

    Parameters
    ----------
    effect : Effect
        The effect.
    begin, end : float
        Bounds of parameters of kind ``time`` that have none, s.
    lowest : float
        Altitude at the end of the comparison, m; altitudes are scanned from below it upwards.
    settings : DecisionSettings
        Thresholds of the diagnosis.
    stated : mapping, optional
        Name of a place → the values at which it is screened, instead of its scan.
    changes : sequence of float
        Times at which parameters of kind ``time`` are screened as well, s.
    """
    grids: list[Sequence[float]] = []
    for q in effect.places:
        if stated is not None and q.name in stated:
            grids.append(stated[q.name])
            continue
        low, high = (q.low, q.high) if np.isfinite([q.low, q.high]).all() else (begin, end)
        if q.scan == 0:
            grids.append([q.default])
        elif q.kind == "altitude":
            first = max(low, lowest - settings.altitude_scan_below_m)
            span = min(high, settings.altitude_scan_top_m) - first
            grids.append(list(first + span * (np.arange(q.scan) / (q.scan - 1)) ** _ALTITUDE_SPACING))
        elif q.kind == "phase":
            # the sign of the size covers the other half of the turn
            turn, count = (0.5 * (high - low), (q.scan + 1) // 2) if effect.half_turn else (high - low, q.scan)
            grids.append(np.linspace(low, low + turn, count, endpoint=False).tolist())
        elif is_wavelength(q):
            grids.append((1.0 / np.linspace(1.0 / high, 1.0 / low, q.scan)).tolist())
        else:
            added = [t for t in changes if low <= t <= high] if q.kind == "time" else []
            grids.append(sorted({*np.linspace(low, high, q.scan).tolist(), *added}))
    names = [q.name for q in effect.places]
    combinations = [dict(zip(names, values, strict=True)) for values in product(*grids)]
    return [places for places in combinations if is_ordered(EffectInstance(effect, places))]


def is_wavelength(parameter: Parameter) -> bool:
    """Whether a place is scanned at equal steps of its inverse, the wave number."""
    return parameter.kind == "length" and parameter.low > 0.0


def scan_range(model: LinearizedModel) -> tuple[float, float]:
    """First time, s, with a dynamic pressure above `scan_start_pressure_pa`; lowest altitude of the comparison, m."""
    flow = model.residuals.flow
    above_threshold = flow.dynamic_pressure > model.settings.scan_start_pressure_pa
    return float(model.residuals.nodes.time[np.argmax(above_threshold)]), float(np.min(flow.altitude))


def is_ordered(instance: EffectInstance) -> bool:
    """Whether lower bounds lie below upper ones: bounds of one kind come in pairs, in the order of declaration."""
    for kind in ("altitude", "time", "mach"):
        values = [instance.values[q.name] for q in instance.effect.places if q.kind == kind]
        if any(b <= a for a, b in pairwise(values)):
            return False
    return True


def effect_jacobian(
    model: LinearizedModel, instance: EffectInstance, names: Sequence[str] | None = None
) -> EffectJacobian:
    """Columns of an effect about its values.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    instance : EffectInstance
        If an effect of its key is in the model, its columns replace that effect's values by these.
    names : sequence of str, optional
        Parameters; all sizes if not given.
    """
    chosen, sigma = _chosen(instance, names)
    by_name = {q.name: q for q in instance.effect.parameters}

    def compute() -> tuple[Array, Array]:
        columns, means = [], []
        for name, s in zip(chosen, sigma, strict=True):
            step = _SIZE_STEP * s if by_name[name].kind == "size" else _place_step(by_name[name].kind)
            column, mean = _derivative(model, instance, name, step)
            columns.append(column)
            means.append(mean)
        return np.stack(columns, axis=1), np.stack(means, axis=1)

    columns = model.computed_jacobians.get(_key(model, instance, chosen)) or compute()
    _keep(model, instance, chosen, columns)
    return EffectJacobian(instance, chosen, sigma, *columns)


def effect_jacobians(
    model: LinearizedModel,
    instances: Sequence[tuple[EffectInstance, Sequence[str] | None]],
    failed: dict[str, str] | None = None,
) -> list[EffectJacobian]:
    """`effect_jacobian` of several effects, the expensive ones computed by several processes.

    Parameters
    ----------
    model : LinearizedModel
        The linearised model.
    instances : sequence of (EffectInstance, sequence of str or None)
        Effects, and the parameters of each as of `effect_jacobian`.
    failed : dict, optional
        Effect → message of an effect whose hooks fail, which is left out; raised if not given.
    """

    def columns(i: int) -> tuple[Array, Array] | InputError:
        try:
            j = effect_jacobian(model, *instances[i])
        except InputError as error:
            return error
        return j.rows, j.initial_mean

    # the columns of an effect that does not change the path cost less than a copy of the process
    expensive = [i for i, a in enumerate(instances) if a[0].effect.changes_path and not _is_kept(model, *a)]
    by_process = dict(zip(expensive, map_processes(columns, expensive), strict=True))
    jacobians = []
    for i, (instance, names) in enumerate(instances):
        computed = by_process[i] if i in by_process else columns(i)
        if not isinstance(computed, InputError):
            chosen, sigma = _chosen(instance, names)
            jacobians.append(EffectJacobian(instance, chosen, sigma, *computed))
            _keep(model, instance, chosen, computed)
        elif failed is None:
            raise computed
        else:
            failed.setdefault(instance.label, str(computed))
    return jacobians


def _key(model: LinearizedModel, instance: EffectInstance, names: tuple[str, ...]) -> tuple[object, ...]:
    return (_identity(instance), names, tuple(_identity(a) for a in model.effects if not a.is_zero))


def _is_kept(model: LinearizedModel, instance: EffectInstance, names: Sequence[str] | None) -> bool:
    """Whether the columns about this point are kept."""
    return _key(model, instance, _chosen(instance, names)[0]) in model.computed_jacobians


def _keep(
    model: LinearizedModel, instance: EffectInstance, names: tuple[str, ...], columns: tuple[Array, Array]
) -> None:
    """Keep the columns of an effect that changes the path, in place of the oldest ones."""
    kept, key = model.computed_jacobians, _key(model, instance, names)
    if not instance.effect.changes_path or key in kept:
        return
    if len(kept) >= _KEPT_JACOBIANS:
        kept.pop(next(iter(kept)))
    kept[key] = columns


def _chosen(instance: EffectInstance, names: Sequence[str] | None) -> tuple[tuple[str, ...], Array]:
    """Parameters of a Jacobian, all sizes if not given, and their prior standard deviations ``(k,)``."""
    chosen = tuple(names) if names is not None else tuple(q.name for q in instance.effect.sizes)
    by_name = {q.name: q for q in instance.effect.parameters}
    return chosen, np.array([prior_sigma(by_name[n]) for n in chosen])


def _identity(instance: EffectInstance) -> tuple[EffectKey, tuple[tuple[str, float], ...]]:
    """Key and values of an effect."""
    return instance.key, tuple(sorted(instance.values.items()))


def prior_sigma(parameter: Parameter) -> float:
    """Prior standard deviation of a parameter: its plausible size, or that of a uniform distribution over its range.

    A time whose bounds are the flight's own has `_TIME_SIGMA`.
    """
    if parameter.kind == "size":
        return parameter.sigma
    spread = parameter.high - parameter.low
    return float(spread / np.sqrt(12.0)) if np.isfinite(spread) else _TIME_SIGMA


def _place_step(kind: str) -> float:
    """Step of a derivative with respect to a place: s, m, m, rad, 1; 1e-4 Hz for a frequency, 0.1 rad after 160 s."""
    return {"time": 0.2, "altitude": 50.0, "length": 20.0, "phase": 0.01, "mach": 0.05}.get(kind, 1e-4)


def _derivative(model: LinearizedModel, instance: EffectInstance, name: str, step: float) -> tuple[Array, Array]:
    """Minus the derivative of the residuals with respect to one parameter, and that of the initial mean."""
    effect = instance.effect
    remaining = tuple(a for a in model.effects if a.key != instance.key)

    def displaced(change: float) -> EffectInstance:
        return replace(instance, values=instance.values | {name: instance.values[name] + change})

    initial_mean = np.zeros(model.nuisance.size)
    if not effect.changes_path:
        rows = model.index.stack_predictions(*_load_difference(model, remaining, displaced(step), displaced(-step)))
        return rows / (2.0 * step), initial_mean
    sides = [(*remaining, displaced(d)) for d in (step, -step)]
    if not acts_on_driving(instance, model.inputs.driving):
        return -_difference_on_fixed_path(model, effect, sides) / (2.0 * step), initial_mean
    plus, minus = (model.model_inputs(effects) for effects in sides)
    if effect.acts("entry_state"):
        initial_mean = (model.initial_mean_of(minus) - model.initial_mean_of(plus)) / (2.0 * step)
    up, down = (dead_reckon(s.problem, model.reference.start, model.reference.errors) for s in (plus, minus))
    rows = path_difference(model, up, down)
    for part, a, b in zip(
        model.index.constraint_rows,
        constraint_residuals(model.reference, up, plus.problem),
        constraint_residuals(model.reference, down, minus.problem),
        strict=True,
    ):
        rows[part] = b - a
    if effect.changes_readings:
        rows -= _difference_on_fixed_path(model, effect, sides)
    return rows / (2.0 * step), initial_mean


def path_difference(model: LinearizedModel, up: DeadReckonedPath, down: DeadReckonedPath) -> Array:
    """Change of the predictions of the bins from one path to another, as rows ``(R,)``.

    By the Jacobian that propagates the nuisance parameters: the change of the path by an effect is nearly that by an
    error of the initial state or of a sensor. A column computed otherwise would keep the difference of the two
    computations after those have been marginalised: a thousandth of the column, and hundreds of sigmas.
    """
    edges = up.indices(model.bins.edges)
    rotation = rotations.to_rotation_vector(
        rotations.multiply(rotations.conjugate(down.nav[edges, 6:]), up.nav[edges, 6:])
    )
    change = np.concatenate((up.nav[edges, :6] - down.nav[edges, :6], rotation), axis=1)
    columns = model.jacobian.columns
    nav = slice(columns["position"].start, columns["attitude"].stop)
    force = np.einsum("bij,bj->bi", model.jacobian.force[:, :, nav], 0.5 * (change[1:] + change[:-1]))
    rate_step = np.einsum("bij,bj->bi", model.jacobian.rate_step[:, :, nav], change[1:-1])
    return model.index.stack_predictions(force, rate_step)


def _difference_on_fixed_path(
    model: LinearizedModel, effect: Effect, sides: Sequence[Sequence[EffectInstance]]
) -> Array:
    """Residuals of the bins ``(R,)`` on a fixed path, plus less minus: the change of the readings themselves.

    `sides` are the model's effects with `effect` displaced to plus and to minus.
    """
    inputs = [model.denoised_inputs(effects) for effects in sides]
    errors = model.reference.errors
    plus, minus = ((i, *corrected_readings(i.problem, errors, own_lever_arm(i))) for i in inputs)
    same_loads = not effect.is_model_effect
    change = difference_on_fixed_path(model.bins, plus, minus, model.residuals, same_loads)
    return model.index.stack_predictions(change.force, change.rate_step, change.checking_force, change.checking_rate)


def _load_difference(
    model: LinearizedModel, remaining: Sequence[EffectInstance], plus: EffectInstance, minus: EffectInstance
) -> tuple[Array, Array]:
    """Change of the predictions from `minus` to `plus` on the existing path.

    A change of the air acts by the Jacobian of the nuisance parameters density and wind, for the reason that
    `path_difference` gives.
    """
    bins, flow, tables = model.bins, model.residuals.flow, model.residuals.tables
    constants = model.point.constants
    up, down = (model.inputs.forward_model.with_effects((*remaining, *constants, a)) for a in (plus, minus))
    (force_up, moment_up), (force_down, moment_down) = up.loads(flow, tables), down.loads(flow, tables)
    force, rate_step = predict_increment(up, bins, force_up - force_down, moment_up - moment_down)
    if plus.effect.changes_air:
        air_up, air_down = _air(model, plus), _air(model, minus)
        for name, value in air_up.items():
            column, amount = model.jacobian.columns[name].start, value - air_down[name]
            force = force + model.jacobian.force[:, :, column] * amount[:, None]
            at_edge = 0.5 * (amount[:-1] + amount[1:])
            rate_step = rate_step + model.jacobian.rate_step[:, :, column] * at_edge[:, None]
    return force, rate_step


def _air(model: LinearizedModel, instance: EffectInstance) -> dict[str, Array]:
    """An effect's change of the air at the bins' middles ``(B,)``, in the units of the nuisance parameters."""
    middle = slice(NODES_PER_BIN // 2, None, NODES_PER_BIN)
    effect, altitude = instance.effect, model.residuals.flow.altitude[middle]
    position = model.residuals.nodes.nav[middle]
    wind = effect.wind(instance.values, altitude)
    rotation_rate = effect.atmosphere_rate(instance.values) * model.inputs.forward_model.planet.rotation_rate
    return {
        "density": np.log(effect.density(instance.values, altitude)),
        "wind_east": wind[:, 0] + rotation_rate * np.hypot(position[:, 0], position[:, 1]),
        "wind_north": wind[:, 1],
    }
