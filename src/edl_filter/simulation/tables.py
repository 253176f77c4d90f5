"""The model of the world as arrays that the integrator's kernel reads.

Gridded aerodynamic tables go over as they are; whatever is no grid (the smooth surrogate, curves that are cubic in the
angle, a join that is no plain switch) is tabulated finely. The air, with the effects on density and wind, is tabulated
every `AIR_STEP` of altitude.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from edl_filter.aero.database import Database
from edl_filter.aero.grid import GridTable, Slice
from edl_filter.aero.transition import FreeMolecularBridge, join_regimes
from edl_filter.effects.world import World
from edl_filter.simulation.parachute import Parachute

Array = NDArray[np.float64]

#: Step of the table of the air, m: a divisor of the usual steps of atmosphere tables, so that their nodes are kept.
AIR_STEP = 5.0
#: Altitudes that the table spans, m; outside, the density goes on with the last step's scale height.
AIR_SPAN = (-10e3, 240e3)
#: Grid for what is no grid: Mach number (curves are steep through the speed of sound), angle (rad), log10 of the
#: Knudsen number. Linear between its points, coefficients are off by 1e-4 at most there, 4e-6 above Mach 2.
MACH = np.concatenate((np.arange(0.0, 2.0, 0.005), np.arange(2.0, 40.01, 0.05)))
ALPHA_STEP, KNUDSEN_STEP = np.radians(0.1), 0.01
#: Knudsen number above which nothing changes any more: free-molecular flow.
KNUDSEN_END = 1e2


class Tables(NamedTuple):
    """What the kernel reads; numba takes it as a tuple of arrays.

    Attributes
    ----------
    planet : (7,) array
        mu (m³/s²), J2, its radius (m), equatorial radius (m), flattening, rate of the ground and of the air (rad/s).
    vehicle : (10,) array
        Mass (kg), diameter (m), reference area (m²), nominal centre of mass behind the nose (diameters), the true
        one's offset from it (3, m), Knudsen number times density (kg/m³), Knudsen number where rarefied flow begins,
        speed per Mach number of a table that is entered by speed (m/s; 0: by Mach).
    inertia, inverse : (3, 3) arrays
        About the true centre of mass, kg m²; and its inverse.
    air_start, air_step : float
        First altitude and step of `air`, m.
    air : (N, 4) array
        Logarithm of the density (kg/m³), square of the speed of sound (m²/s²), wind towards east and north (m/s).
    mach, alpha, continuum : (M,), (A,), (M, A, 3) arrays
        CA, CN and Cm about the nose.
    log_knudsen, thin_alpha, thin, share : (K,), (B,), (K, B, 3), (K,) arrays
        In rarefied flow the coefficients are ``(1 - share) continuum + thin``.
    damping_mach, damping : (D,) arrays
        Cmq.
    parachute : (4,) array
        Area (m²), attachment's distance behind the nominal centre of mass (m), inflation time (s), deployment (s).
    parachute_mach, parachute_drag : (P,) arrays
    """

    planet: Array
    vehicle: Array
    inertia: Array
    inverse: Array
    air_start: float
    air_step: float
    air: Array
    mach: Array
    alpha: Array
    continuum: Array
    log_knudsen: Array
    thin_alpha: Array
    thin: Array
    share: Array
    damping_mach: Array
    damping: Array
    parachute: Array
    parachute_mach: Array
    parachute_drag: Array


def tabulate(world: World, parachute: Parachute) -> Tables:
    """Arrays for the kernel, with the effects on planet, air and rigid body in them.

    Effects on coefficients, and further forces and moments, are not: see `edl_filter.simulation.increments`.
    """
    planet, body = world.gravity_planet, world.rigid_body
    turning = float(np.prod([a.effect.atmosphere_rate(a.values) for a in world.effects]))
    mach, alpha, continuum = _continuum(world.database)
    start, log_knudsen, thin_alpha, thin, share = _rarefied(world.database)
    unit_knudsen = float(world.gas.knudsen(1.0, world.diameter))
    altitude = np.arange(AIR_SPAN[0], AIR_SPAN[1] + AIR_STEP, AIR_STEP)
    return Tables(
        planet=np.array([
            planet.mu, planet.j2, planet.gravity_radius, planet.equatorial_radius, planet.flattening,
            planet.rotation_rate, planet.rotation_rate * turning,
        ]),
        vehicle=np.array([
            body.mass, world.diameter, world.area, world.x_over_d, *body.offset, unit_knudsen, start,
            world.database.speed_per_mach or 0.0,
        ]),
        inertia=np.ascontiguousarray(body.inertia, float),
        inverse=np.asarray(np.linalg.inv(body.inertia), np.float64),
        air_start=AIR_SPAN[0],
        air_step=AIR_STEP,
        air=air_table(world, altitude),
        mach=mach,
        alpha=alpha,
        continuum=continuum,
        log_knudsen=log_knudsen,
        thin_alpha=thin_alpha,
        thin=thin,
        share=share,
        damping_mach=np.asarray(world.damping.mach, float),
        damping=np.asarray(world.damping.cmq, float),
        parachute=np.array([parachute.area, parachute.arm, parachute.inflation, np.inf]),
        parachute_mach=np.asarray(parachute.mach, float),
        parachute_drag=np.asarray(parachute.drag_coefficient, float),
    )  # fmt: skip


def air_table(world: World, altitude: Array) -> Array:
    """Log density, squared speed of sound and wind (east, north), with the effects', ``(N, 4)``."""
    density, wind = world.atmosphere.density(altitude), world.atmosphere.wind_at(altitude)
    for a in world.effects:
        density = density * a.effect.density(a.values, altitude)
        wind = wind + a.effect.wind(a.values, altitude)
    return np.column_stack((np.log(density), world.atmosphere.speed_of_sound(altitude) ** 2, wind))


def _continuum(database: Database) -> tuple[Array, Array, Array]:
    """Nodes in Mach number and angle, and the coefficients there."""
    table = database.continuum
    if isinstance(table, GridTable):
        mach = table.nodes
        alpha = table.alpha if table.interpolation == "linear" else _angles(table.alpha_max)
    else:
        mach, alpha = MACH, _angles(table.alpha_max)
    return mach, alpha, _on_grid(table.at(np.repeat(mach, len(alpha))), alpha, len(mach))


def _rarefied(database: Database) -> tuple[float, Array, Array, Array, Array]:
    """Where rarefied flow begins; nodes in log10(Kn) and angle; what is added there; the continuum's loss."""
    table, limit = database.rarefied, database.continuum_limit
    if isinstance(table, GridTable) and database.join == "switch" and table.interpolation == "linear":
        values = _on_grid(table.at(np.repeat(table.nodes, len(table.alpha))), table.alpha, len(table.nodes))
        return limit, np.log10(table.nodes), table.alpha, values, np.ones(len(table.nodes))
    start = limit * (10.0**-0.5 if database.join == "blend" else 1.0)
    # the first node a hair above the limit: there the look-up counts as rarefied
    first = np.log10(start)
    nodes = np.append(first + 1e-9, np.arange(first + KNUDSEN_STEP, np.log10(KNUDSEN_END), KNUDSEN_STEP))
    end = table.end.alpha if isinstance(table, FreeMolecularBridge) else table.alpha
    alpha = _angles(min(float(end[-1]), database.continuum.alpha_max))
    knudsen = 10.0 ** np.repeat(nodes, len(alpha))
    angles, count = np.tile(alpha, len(nodes)), len(nodes)
    # the sum is linear in the continuum's curve: what two different curves make of it gives share and remainder
    curves = [database.continuum.at(np.full(len(knudsen), m)) for m in (5.0, 25.0)]
    below = [c.evaluate(angles) for c in curves]
    joined = [join_regimes(c, table, knudsen, limit, database.join).evaluate(angles) for c in curves]
    kept = ((joined[1] - joined[0])[0] / (below[1] - below[0])[0]).reshape(count, -1)[:, 0]
    thin = joined[0] - np.repeat(kept, len(alpha)) * below[0]
    return start, nodes, alpha, np.ascontiguousarray(thin.T.reshape(count, len(alpha), 3)), 1.0 - kept


def _angles(highest: float) -> Array:
    return np.linspace(0.0, highest, max(2, round(highest / ALPHA_STEP) + 1))


def _on_grid(cut: Slice, alpha: Array, count: int) -> Array:
    """(count, A, 3) coefficients of a cut whose samples repeat each node for every angle."""
    values = cut.evaluate(np.tile(alpha, count))
    return np.ascontiguousarray(values.T.reshape(count, len(alpha), 3))
