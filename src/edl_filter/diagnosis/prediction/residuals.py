"""Prediction beside measurement: what the model says that every instrument should have read.

Along a dead-reckoned path (`path`) the model of the world gives force and moment at some nodes of every bin
(`bins`). Specific force is averaged over the bin by Simpson's rule. Rates are never differentiated: the step of the
mean rate from one bin to the next is the integral of the angular acceleration with a triangular weight,

    w[k+1] - w[k] = ∫ α(t) (t - t[k-1])/dt dt over bin k  +  ∫ α(t) (t[k+1] - t)/dt' dt over bin k + 1,

and Euler's equations (thesis 6.6 to 6.8) give α at the nodes; so both sides go through the same sampling. A second
IMU is compared with what the first says that it should read, the constraints with what the path says.

All differences are measured minus predicted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter.diagnosis.bins import Bins, bin_means
from edl_filter.diagnosis.path import PER_BIN, Nodes, Path, dead_reckon, node_rates, nodes_of
from edl_filter.effects.effect import Flow, Totals
from edl_filter.effects.world import World
from edl_filter.navigation.constraints import Altimeter
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.increments import Samples, lever_arm_acceleration
from edl_filter.telemetry.record import ImuRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Setup:
    """The model, and the measurements as it understands them.

    Attributes
    ----------
    problem : Problem
        Samples with the effects' sensor errors taken off, gravity and entry state with the effects'.
    world : World
    driving : ImuRecord
        The IMU behind the samples, with its own noise: what a sample hides disturbs integration, not its mean.
    checking : tuple of ImuRecord
        The other IMUs, body axes.
    """

    problem: Problem
    world: World
    driving: ImuRecord
    checking: tuple[ImuRecord, ...]


@dataclass(frozen=True)
class Frame:
    """What stays as it is while the model changes.

    Attributes
    ----------
    bins : Bins
    start : (10,) array
        State at the initial state's time from which the path begins.
    errors : (U, n) array
        Sensor errors by instrument, in the filter's vector.
    onboard : (C, 4) array or None
        On-board attitude carried to the constraints' times: what the gyros said, whatever the model.
    """

    bins: Bins
    start: Array
    errors: Array
    onboard: Array | None


@dataclass(frozen=True)
class Differences:
    """Measured minus predicted.

    Attributes
    ----------
    force : (B, 3) array
        Specific force, m/s².
    turn : (B - 1, 3) array
        Step of the rate between adjoining bins, rad/s.
    other_force, other_rate : tuples of (B, 3) arrays
        Of each checking IMU, m/s² and rad/s.
    constraints : tuple of (m,) arrays
    path : Path
    nodes : Nodes
    flow : Flow
        At the nodes.
    tables : Totals
        What the tables say there.
    felt, stepped : (B, 3), (B - 1, 3) arrays
        Specific force and steps of the rate as predicted.
    """

    force: Array
    turn: Array
    other_force: tuple[Array, ...]
    other_rate: tuple[Array, ...]
    constraints: tuple[Array, ...]
    path: Path
    nodes: Nodes
    flow: Flow
    tables: Totals
    felt: Array
    stepped: Array


def compare(frame: Frame, setup: Setup) -> Differences:
    """Run the whole chain once."""
    bins, problem, world = frame.bins, setup.problem, setup.world
    path = dead_reckon(problem, frame.start, frame.errors)
    samples = problem.samples
    force, rate = binned(bins, samples, (path.force, path.rate))
    nodes = nodes_of(path, bins, rate)
    flow = world.flow(nodes.time, nodes.nav[:, :3], nodes.nav[:, 3:6], nodes.nav[:, 6:], nodes.rate)
    tables = world.looked_up(flow)
    felt, step = predicted(world, bins, flow, tables)
    checking = [_other(record, bins, samples, path.rate, force, rate) for record in setup.checking]
    return Differences(
        force=force - felt,
        turn=np.diff(rate, axis=0) - step,
        other_force=tuple(f for f, _ in checking),
        other_rate=tuple(w for _, w in checking),
        constraints=constraint_differences(frame, path, problem),
        path=path,
        nodes=nodes,
        flow=flow,
        tables=tables,
        felt=felt,
        stepped=step,
    )


def beside_held(frame: Frame, setup: Setup, read: tuple[Array, Array], held: Differences) -> Differences:
    """Compare other readings, `path.readings`, and another vehicle, along a path that is held; no constraints."""
    bins, samples = frame.bins, setup.problem.samples
    force, rate = binned(bins, samples, read)
    flow = replace(held.flow, rate=node_rates(bins, rate))
    felt, step = predicted(setup.world, bins, flow, held.tables)
    checking = [_other(record, bins, samples, read[1], force, rate) for record in setup.checking]
    return replace(
        held,
        force=force - felt,
        turn=np.diff(rate, axis=0) - step,
        other_force=tuple(f for f, _ in checking),
        other_rate=tuple(w for _, w in checking),
        constraints=tuple(np.zeros_like(c) for c in held.constraints),
    )


def binned(bins: Bins, samples: Samples, read: tuple[Array, Array]) -> tuple[Array, Array]:
    """Means over the bins ``(B, 3)`` of force and rate that are given by sample."""
    force, rate = (bin_means(bins.edges, samples.time, samples.interval, x) for x in read)
    return force, rate


def predicted(world: World, bins: Bins, flow: Flow, tables: Totals | None = None) -> tuple[Array, Array]:
    """Mean specific force in the bins ``(B, 3)`` and steps of the rate between them ``(B - 1, 3)``."""
    force, moment = world.loads(flow, tables)
    return averaged(force / world.rigid_body.mass, bins), stepped(world, bins, flow, moment)


def more_predicted(world: World, bins: Bins, force: Array, moment: Array) -> tuple[Array, Array]:
    """What more force and moment at the nodes make of `predicted`."""
    turning = moment @ np.linalg.inv(world.rigid_body.inertia).T
    return averaged(force / world.rigid_body.mass, bins), triangle(turning, bins)


def averaged(values: Array, bins: Bins) -> Array:
    """Means over the bins from values at the nodes ``(PER_BIN B + 1, ...)``, Simpson's rule."""
    return _weighted(values, _SIMPSON)


def stepped(world: World, bins: Bins, flow: Flow, moment: Array) -> Array:
    """Steps of the mean rate from the moment at the nodes."""
    return triangle(angular_acceleration(world, flow, moment), bins)


def angular_acceleration(world: World, flow: Flow, moment: Array) -> Array:
    """Euler's equations, ``I⁻¹ (M - w × I w)``, rad/s²."""
    inertia = world.rigid_body.inertia
    left = moment - np.cross(flow.rate, flow.rate @ inertia)
    return np.asarray(left @ np.linalg.inv(inertia).T, np.float64)


def triangle(values: Array, bins: Bins, weights: Array | None = None) -> Array:
    """Integrals over adjoining bins with the triangular weight, ``(B - 1, ...)`` at `PER_BIN` nodes each."""
    rule = _SIMPSON if weights is None else weights
    dt = bins.interval.reshape(-1, *(1,) * (values.ndim - 1))
    share = np.arange(PER_BIN + 1) / PER_BIN
    rising, falling = _weighted(values, rule * share), _weighted(values, rule * (1.0 - share))
    return dt[:-1] * rising[:-1] + dt[1:] * falling[1:]


def rounding(world: World, bins: Bins, flow: Flow, force: Array, moment: Array) -> tuple[Array, Array]:
    """What the sums over nodes may be wrong by: a third of what half of the nodes changes.

    Between tables' nodes the model is smooth and this is nothing; a bend inside a bin costs the rule its order, and of
    second order a third of the last step is left.
    """
    turn = angular_acceleration(world, flow, moment)
    felt = force / world.rigid_body.mass
    return (
        np.abs(_weighted(felt, _SIMPSON - _COARSE)) / 3.0,
        np.abs(triangle(turn, bins, _SIMPSON - _COARSE)) / 3.0,
    )


#: Weights of Simpson's rule over a bin of unit length, with all nodes and with every second one.
_SIMPSON = np.where(np.arange(PER_BIN + 1) % 2, 4.0, 2.0) / (3.0 * PER_BIN)
_COARSE = np.where(np.arange(PER_BIN + 1) % 4 == 2, 8.0, np.where(np.arange(PER_BIN + 1) % 4 == 0, 4.0, 0.0)) / (
    3.0 * PER_BIN
)
_SIMPSON[[0, -1]] /= 2.0
_COARSE[[0, -1]] /= 2.0


def _weighted(values: Array, weights: Array) -> Array:
    """Weighted sums over the nodes of every bin."""
    last = len(values) - 1
    out = weights[0] * values[:last:PER_BIN]
    for i in range(1, PER_BIN):
        out = out + weights[i] * values[i:last:PER_BIN]
    return out + weights[PER_BIN] * values[PER_BIN::PER_BIN]


def constraint_differences(frame: Frame, path: Path, problem: Problem) -> tuple[Array, ...]:
    """Measured minus predicted of every constraint."""
    constraints = problem.constraints
    at = np.searchsorted(problem.samples.time, np.array([c.time for c in constraints]) + 1e-6)
    units = problem.samples.unit[np.maximum(at - 1, 0)]
    nav = path.nav[at]
    if frame.onboard is not None:
        nav = np.concatenate((nav, frame.onboard), axis=1)
    found: dict[int, Array] = {}
    by_sphere: dict[float, list[int]] = {}
    for i, c in enumerate(constraints):
        if isinstance(c, Altimeter):  # of which there may be thousands: all at once
            by_sphere.setdefault(c.surface_radius, []).append(i)
        else:
            predicted_here = c.predict(nav[i][:, None], frame.errors[units[i]][:, None], problem.layout)[0]
            found[i] = c.measured - predicted_here
    for which in by_sphere.values():
        heights = constraints[which[0]].predict(nav[which].T, frame.errors[units[which]].T, problem.layout)
        found |= {i: constraints[i].measured - h for i, h in zip(which, heights, strict=True)}
    return tuple(found[i] for i in range(len(constraints)))


def _other(
    record: ImuRecord, bins: Bins, samples: Samples, turning: Array, force: Array, rate: Array
) -> tuple[Array, Array]:
    """What another IMU read beyond what the driving one says, means over the bins.

    `turning` is the rate sample by sample, `force` and `rate` the driving one's means over the bins. The lever
    arm's acceleration is taken sample by sample: in longer steps its tangential part loses an order.
    """
    read = bin_means(bins.edges, record.time, record.interval, record.specific_force)
    turned = bin_means(bins.edges, record.time, record.interval, record.angular_rate)
    place = np.broadcast_to(record.position[0], turning.shape)
    more = lever_arm_acceleration(samples.interval, turning, place, np.zeros(len(turning), np.int64))
    return read - force - bin_means(bins.edges, samples.time, samples.interval, more), turned - rate
