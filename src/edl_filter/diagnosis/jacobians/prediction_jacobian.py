"""How the differences hang on the unknowns: the linear problem that `whitening` passes through.

Where the flight goes (`navigation`) is linear in the error of the filter's vector by the same propagation that the
filter uses, differenced; what the model predicts there by differences of the model itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from edl_filter import rotations
from edl_filter.diagnosis.bins import Bins, bin_means
from edl_filter.diagnosis.comparison import Differences, Setup, predicted, rounding, stepped
from edl_filter.diagnosis.path import PER_BIN, Nodes
from edl_filter.diagnosis.unknowns import Allowance, Unknowns, distances
from edl_filter.effects.deviation import CoefficientUnits, Deviation
from edl_filter.effects.effect import Active, Effect, Parameter, Values
from edl_filter.effects.world import World
from edl_filter.navigation.increments import edge_weights
from edl_filter.navigation.layout import SENSOR_STATES

Array = NDArray[np.float64]

#: Steps of the differences: m, m/s, rad.
_NAV_STEPS = np.repeat([100.0, 0.05, 1e-5], 3)
_RATE_STEP = 1e-3

#: How far a bend stands out: times the median around it.
_BEND = 3.0


@dataclass(frozen=True)
class Slopes:
    """Derivatives of the predictions, bin by bin.

    Attributes
    ----------
    force : (B, 3, c) array
        Of the specific force, by the columns of `names`.
    turn : (B - 1, 3, c) array
        Of the steps of the rate.
    names : dict
        position, velocity, attitude (the local error of the state), density (relative), wind_east, wind_north (m/s),
        ca, cn, cm (by sigmas of the database), mass, inertia (relative), rate (rad/s) → slice of columns.
    force_bend, turn_bend : (B, 3), (B - 1, 3) arrays
        By how much two sigmas of density bend the predictions off a straight line: at the step where one table ends and
        another begins nobody knows to a tenth of a second when it comes. And what sums over nodes may be wrong by.
    """

    force: Array
    turn: Array
    names: dict[str, slice]
    force_bend: Array
    turn_bend: Array


class _Probe(Effect):
    """Small changes of the air, to differentiate by."""

    name = "probe"
    parameters = tuple(Parameter(n, "", n) for n in ("east", "north", "density"))

    def wind(self, p: Values, altitude: Array) -> Array:
        return np.tile([p["east"], p["north"]], (len(altitude), 1))

    def density(self, p: Values, altitude: Array) -> Array:
        return np.full(len(altitude), 1.0 + p["density"])


def slopes(setup: Setup, bins: Bins, found: Differences, density_sigma: float, units: CoefficientUnits) -> Slopes:
    """Differentiate the predictions along the path; `density_sigma` is relative."""
    nodes, world = found.nodes, setup.world
    parts_f: list[Array] = []
    parts_t: list[Array] = []

    def add(plus: tuple[Array, Array], minus: tuple[Array, Array], step: float) -> None:
        parts_f.append((plus[0] - minus[0]) / step)
        parts_t.append((plus[1] - minus[1]) / step)

    for j, step in enumerate(_NAV_STEPS):
        add(_at(world, bins, _moved(nodes, j, step)), _at(world, bins, _moved(nodes, j, -step)), 2.0 * step)

    def probed(**change: float) -> tuple[Array, Array]:
        other = world.having((*world.effects, Active(_Probe(), change)))
        return _at(other, bins, nodes)

    for name, step in (("density", 1e-3), ("east", 0.5), ("north", 0.5)):
        add(probed(**{name: step}), probed(**{name: -step}), 2.0 * step)
    base = predicted(world, bins, found.flow, found.tables)
    here = world.deviation or Deviation.none(units)
    for name in ("ca", "cn", "cm"):
        off = replace(here, **{name: getattr(here, name) + 1.0})
        add(predicted(replace(world, deviation=off), bins, found.flow, found.tables), base, 1.0)
    force, moment = world.loads(found.flow, found.tables)
    parts_f += [-base[0], np.zeros_like(base[0])]
    still = stepped(world, bins, found.flow, np.zeros_like(moment))
    parts_t += [np.zeros_like(base[1]), still - base[1]]
    for turn in _RATE_STEP * np.eye(3):
        sides = [replace(found.flow, rate=found.flow.rate + s) for s in (turn, -turn)]
        plus, minus = (predicted(world, bins, flow, found.tables) for flow in sides)
        add(plus, minus, 2.0 * _RATE_STEP)
    names = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9), "density": slice(9, 10)}
    names |= {
        "wind_east": slice(10, 11),
        "wind_north": slice(11, 12),
        "ca": slice(12, 13),
        "cn": slice(13, 14),
        "cm": slice(14, 15),
    }
    names |= {"mass": slice(15, 16), "inertia": slice(16, 17), "rate": slice(17, 20)}
    denser, thinner = probed(density=2.0 * density_sigma), probed(density=-2.0 * density_sigma)
    sums = rounding(world, bins, found.flow, force, moment)
    bend = [np.hypot(a + b - 2.0 * c, r) for a, b, c, r in zip(denser, thinner, base, sums, strict=True)]
    return Slopes(np.stack(parts_f, axis=2), np.stack(parts_t, axis=2), names, *bend)


def _moved(nodes: Nodes, j: int, step: float) -> Nodes:
    nav = nodes.nav.copy()
    if j < 6:
        nav[:, j] += step
    else:
        turn = np.zeros(3)
        turn[j - 6] = step
        nav[:, 6:] = rotations.multiply(nav[:, 6:], rotations.from_rotation_vector(turn))
    return replace(nodes, nav=nav)


def _at(world: World, bins: Bins, nodes: Nodes) -> tuple[Array, Array]:
    flow = world.flow(nodes.time, nodes.nav[:, :3], nodes.nav[:, 3:6], nodes.nav[:, 6:], nodes.rate)
    return predicted(world, bins, flow)


@dataclass(frozen=True)
class Rows:
    """The rows that a bin's end brings, before they are put into the order of time.

    Attributes
    ----------
    design : (B, 6 + 6 p, n + m) array
        Specific force, step of the rate, then force and rate of each of p checking IMUs.
    noise : (B, 6 + 6 p, 6 + 6 p) array
        Covariance of the rows' own noise.
    use : (B, 6 + 6 p) array of bool
    values : (B, 6 + 6 p) array
        The differences.
    """

    design: Array
    noise: Array
    use: NDArray[np.bool_]
    values: Array


def bin_rows(
    setup: Setup,
    bins: Bins,
    found: Differences,
    quiet: tuple[Array, Array],
    unknowns: Unknowns,
    slope: Slopes,
    sigma: dict[str, float],
    allowance: Allowance,
) -> Rows:
    """Design of the rows at the bins' ends.

    `quiet` are means over the bins of force and rate without their own noise, `sigma` what `one_sigma` says.
    """
    samples, layout = setup.problem.samples, unknowns.layout
    b, others = len(bins.interval), len(setup.checking)
    width = 6 + 6 * others
    design = np.zeros((b, width, unknowns.size))
    driving = setup.driving
    sigma_f = bin_sigma(bins, driving.time, driving.interval, driving.force_noise)
    sigma_w = bin_sigma(bins, driving.time, driving.interval, driving.rate_noise)

    def put(name: str, column: slice, gain: float) -> None:
        """An unknown's value at the bin's end, where the step of the rate is; for the force half a bin before."""
        at = unknowns[name]
        design[:, :3, at.start] = slope.force[:, :, column.start] * gain
        design[:-1, 3:6, at.start] = slope.turn[:, :, column.start] * gain
        if at.stop - at.start == 2:
            design[:, :3, at.start + 1] = -0.5 * passed[name][:, None] * design[:, :3, at.start]

    passed = distances(allowance, bins.interval, np.diff(found.flow.altitude[::PER_BIN]))
    for name in ("position", "velocity", "attitude"):
        at = layout[name]
        design[:, :3, at] = slope.force[:, :, slope.names[name]]
        design[:-1, 3:6, at] = slope.turn[:, :, slope.names[name]]
    for name, gain in sigma.items():
        if name in unknowns:
            put(name, slope.names[name], gain)

    # gyro noise: the step of the rate itself, and the turn within the two bins that the step is taken over
    eye = np.eye(3)
    before, after = unknowns["rate_before"], unknowns["rate_after"]
    design[:, 3:6, before], design[:, 3:6, after] = -eye, eye
    inner = slope.turn[:, :, slope.names["attitude"]] * (bins.interval[:-1] / 6.0)[:, None, None]
    design[:-1, 3:6, before] += inner
    design[:-1, 3:6, after] -= inner

    force, rate = quiet
    step = np.concatenate((np.diff(rate, axis=0), np.zeros((1, 3))))
    own = _sensor_design(force, rate)
    for name, block in own.items():
        if name in layout:
            at = layout[name]
            if name.startswith("accelerometer"):
                design[:, :3, at] += block
            else:
                gyro = slope.turn[:, :, slope.names["rate"]]
                at_edge = 0.5 * (block[:-1] + block[1:])
                design[:-1, 3:6, at] -= np.einsum("bij,bjk->bik", gyro, at_edge)
                if name == "gyro_scale":
                    design[:, 3:6, at] += step[:, :, None] * eye
    here = setup.driving.position[0]
    read = bin_means(bins.edges, samples.time, samples.interval, found.path.rate)
    jerk_f = lever_error(bins, read, here)
    values = np.full((b, width), np.nan)
    values[:, :3], values[:-1, 3:6] = found.force, found.turn
    noise = np.zeros((b, width, width))
    noise[:, range(3), range(3)] = (sigma_f**2)[:, None] + slope.force_bend**2 + jerk_f**2
    noise[:, range(3, 6), range(3, 6)] = ((0.05 * sigma_w) ** 2)[:, None]
    noise[:-1, range(3, 6), range(3, 6)] += slope.turn_bend**2
    for i, record in enumerate(setup.checking):
        f0, w0 = 6 + 6 * i, 9 + 6 * i
        values[:, f0 : f0 + 3], values[:, w0 : w0 + 3] = found.other_force[i], found.other_rate[i]
        for name, block in own.items():
            row = slice(f0, f0 + 3) if name.startswith("accelerometer") else slice(w0, w0 + 3)
            if name in layout:  # stands in the prediction
                design[:, row, layout[name]] = -block
            if f"other{i}_{name}" in unknowns:
                design[:, row, unknowns[f"other{i}_{name}"]] = block
        design[:, w0 : w0 + 3, before] = -eye
        other_f = bin_sigma(bins, record.time, record.interval, record.force_noise)
        other_w = bin_sigma(bins, record.time, record.interval, record.rate_noise)
        between = lever_error(bins, read, record.position[0] - here)
        noise[:, range(f0, f0 + 3), range(f0, f0 + 3)] = (sigma_f**2 + other_f**2)[:, None] + between**2
        noise[:, range(w0, w0 + 3), range(w0, w0 + 3)] = (other_w**2)[:, None]
        for c in range(3):
            noise[:, c, f0 + c] = noise[:, f0 + c, c] = -(sigma_f**2)
        for c in range(3):
            for other in range(i):
                noise[:, 6 + 6 * other + c, f0 + c] = noise[:, f0 + c, 6 + 6 * other + c] = sigma_f**2
    use = np.isfinite(values) & bins.sound[:, None]
    use[:-1, 3:6] &= bins.sound[1:, None]
    use[-1, 3:6] = False
    return Rows(np.where(use[:, :, None], design, 0.0), noise, use, np.where(use, values, 0.0))


def one_sigma(allowance: Allowance) -> dict[str, float]:
    """What one sigma of each unknown of air and vehicle is, relative or m/s; slopes by coefficients are by sigmas."""
    return {
        "density": allowance.density, "wind_east": allowance.wind, "wind_north": allowance.wind,
        "mass": allowance.mass, "inertia": allowance.inertia, "ca": 1.0, "cn": 1.0, "cm": 1.0,
    }  # fmt: skip


def coefficient_sigma(setup: Setup, found: Differences, allowance: Allowance) -> CoefficientUnits:
    """One sigma of the database at the nodes: its own, and what numbers cannot do better."""
    flow, tables = found.flow, found.tables
    limits = setup.world.database.lookup(flow.mach, flow.knudsen, flow.alpha_total, flow.speed).three_sigma
    third, least = allowance.coefficients / 3.0, allowance.numerical
    return CoefficientUnits(
        flow.time,
        ca=np.hypot(third * limits.ca, least * tables.ca),
        cn=np.hypot(third * limits.cn, least * tables.cn),
        cm=np.hypot(third * limits.cm, least * tables.cm_nose),
    )


def _sensor_design(force: Array, rate: Array) -> dict[str, Array]:
    """What an instrument's errors add to its readings, ``(B, 3, 3)`` each; in the order of `SENSOR_STATES`."""
    eye = np.broadcast_to(np.eye(3), (len(force), 3, 3))
    by_name = {
        "accelerometer_bias": eye,
        "accelerometer_scale": force[:, :, None] * np.eye(3),
        "accelerometer_misalignment": -rotations.cross_matrix(force),
        "gyro_bias": eye,
        "gyro_scale": rate[:, :, None] * np.eye(3),
    }
    return {name: by_name[name] for name in SENSOR_STATES}


def lever_error(bins: Bins, rate: Array, position: Array) -> Array:
    """What a lever arm's acceleration may be wrong by where a torque sets in all at once, ``(B, 3)``, m/s².

    The tangential part is the difference of rates at the bin's edges, of eighth order in the means (`increments`). At a
    bend of the rate that order is off by up to nine times of what sixth order changes in fourth; a bend is where this
    change stands out from the ten bins before and after.
    """
    change = np.zeros((len(rate) + 1, 3))
    if len(rate) > 6:
        pairs = (rate[2:-3] + rate[3:-2], rate[1:-4] + rate[4:-1], rate[:-5] + rate[5:])
        sixth, fourth = (sum(w * p for w, p in zip(edge_weights(k), pairs, strict=False)) for k in (3, 2))
        change[3:-3] = sixth - fourth
    size = np.linalg.norm(np.nan_to_num(change), axis=1)
    bent = size > _BEND * median_filter(size, 21)
    at_edges = np.where(bent[:, None], 9.0 * np.nan_to_num(change), 0.0)
    before, after = (np.cross(e, position) / bins.interval[:, None] for e in (at_edges[:-1], at_edges[1:]))
    return np.hypot(before, after)


def bin_sigma(bins: Bins, time: Array, interval: Array, noise: Array) -> Array:
    """One sigma of the means over the bins ``(B,)`` of samples with independent noise."""
    variance = bin_means(bins.edges, time, interval, noise**2 * interval)
    return np.sqrt(variance / bins.interval)
