"""The forward model as arrays that the kernel of the integrator reads.

Gridded aerodynamic tables are copied; every other table (the smooth surrogate, curves that are cubic in the angle, a
join that is not a switch) is tabulated on a fine grid. The air, with the effects on density and wind, is tabulated
every `AIR_STEP` of altitude.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from edl_filter.aero.database import Database
from edl_filter.aero.grid import GridTable, Slice
from edl_filter.aero.transition import FreeMolecularBridge, join_regimes
from edl_filter.effects.forward_model import ForwardModel, compose_air_rotation
from edl_filter.effects.types import Body
from edl_filter.errors import InputError
from edl_filter.simulation.parachute import Parachute
from edl_filter.types import Array

#: Step of the table of the air, m: a divisor of the usual steps of atmosphere tables, so that it contains their nodes.
AIR_STEP = 5.0
#: Altitudes of the table, m; outside, the density is extrapolated with the scale height of the last step.
AIR_SPAN = (-10e3, 240e3)
#: Grid for tables that are not gridded: Mach number (curves are steep through the speed of sound), angle (rad), log10
#: of the Knudsen number. Linear interpolation has errors of the coefficients up to 1e-4, above Mach 2 up to 4e-6.
MACH = np.concatenate((np.arange(0.0, 2.0, 0.005), np.arange(2.0, 40.01, 0.05)))
ALPHA_STEP, KNUDSEN_STEP = np.radians(0.1), 0.01
#: Knudsen number above which the coefficients are constant: free-molecular flow.
KNUDSEN_END = 1e2


class Tables(NamedTuple):
    """Arguments of the kernel; numba takes them as a tuple of arrays.

    Attributes
    ----------
    planet : (7,) array
        mu (m³/s²), J2, its radius (m), equatorial radius (m), flattening, rate of the ground and of the air (rad/s).
    vehicle : (10,) array
        Mass (kg), diameter (m), reference area (m²), nominal centre of mass behind the nose (diameters), offset of the
        true one from it (3, m), Knudsen number times density (kg/m³), Knudsen number at which rarefied flow begins,
        speed per Mach number of a table that is entered by speed (m/s; 0: by Mach number).
    inertia, inverse : (3, 3) arrays
        About the true centre of mass, kg m²; and the inverse of that.
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


class RigidBody(NamedTuple):
    """A body as the kernel takes it.

    Attributes
    ----------
    mass : float
        kg.
    offset : (3,) array
        Of the true centre of mass from the nominal one, m.
    inertia, inverse : (3, 3) arrays
        About the true centre of mass, kg m²; and the inverse of that.
    """

    mass: float
    offset: Array
    inertia: Array
    inverse: Array


def tabulate_body(forward_model: ForwardModel, body: Body) -> RigidBody:
    """A body without effects as the kernel takes it, with those of the forward model."""
    changed = replace(forward_model, body=body).rigid_body
    inertia = np.ascontiguousarray(changed.inertia, float)
    return RigidBody(changed.mass, np.asarray(changed.offset, float), inertia, np.asarray(np.linalg.inv(inertia)))


def tabulate(forward_model: ForwardModel, parachute: Parachute) -> Tables:
    """Arrays for the kernel, with the effects on planet, air and rigid body.

    Effects on coefficients, and added forces and moments, are not in them: see `edl_filter.simulation.increments`.
    """
    planet, body = forward_model.gravity_planet, tabulate_body(forward_model, forward_model.body)
    mach, alpha, continuum = _continuum(forward_model.database)
    start, log_knudsen, thin_alpha, thin, share = _rarefied(forward_model.database)
    unit_knudsen = float(forward_model.gas.knudsen(1.0, forward_model.diameter))
    altitude = np.arange(AIR_SPAN[0], AIR_SPAN[1] + AIR_STEP, AIR_STEP)
    return Tables(
        planet=np.array([
            planet.mu, planet.j2, planet.gravity_radius, planet.equatorial_radius, planet.flattening,
            planet.rotation_rate, compose_air_rotation(planet, forward_model.effects).rotation_rate,
        ]),
        vehicle=np.array([
            body.mass, forward_model.diameter, forward_model.area, forward_model.x_over_d, *body.offset, unit_knudsen,
            start, forward_model.database.speed_per_mach or 0.0,
        ]),
        inertia=body.inertia,
        inverse=body.inverse,
        air_start=AIR_SPAN[0],
        air_step=AIR_STEP,
        air=air_table(forward_model, altitude),
        mach=mach,
        alpha=alpha,
        continuum=continuum,
        log_knudsen=log_knudsen,
        thin_alpha=thin_alpha,
        thin=thin,
        share=share,
        damping_mach=np.asarray(forward_model.damping.mach, float),
        damping=np.asarray(forward_model.damping.cmq, float),
        parachute=np.array([parachute.area, parachute.arm, parachute.inflation, np.inf]),
        parachute_mach=np.asarray(parachute.mach, float),
        parachute_drag=np.asarray(parachute.drag_coefficient, float),
    )  # fmt: skip


def air_table(forward_model: ForwardModel, altitude: Array) -> Array:
    """Air with the effects.

    Parameters
    ----------
    forward_model : ForwardModel
        Atmosphere and effects.
    altitude : (N,) array
        Areodetic, m.

    Returns
    -------
    (N, 4) array
        Logarithm of the density (kg/m³), square of the speed of sound (m²/s²), wind towards east and north (m/s).
    """
    density, wind = forward_model.air_at(altitude)
    return np.column_stack((np.log(density), forward_model.atmosphere.speed_of_sound(altitude) ** 2, wind))


def _continuum(database: Database) -> tuple[Array, Array, Array]:
    """Nodes in Mach number ``(M,)`` and angle ``(A,)``, and the coefficients there, ``(M, A, 3)``."""
    if database.increments is not None:
        raise InputError(
            "aerodynamics.increments: found increments of another flight; a simulation takes none. Leave the key out."
        )
    table = database.continuum
    if isinstance(table, GridTable):
        mach = table.nodes
        alpha = table.alpha if table.interpolation == "linear" else _angles(table.alpha_max)
    else:
        mach, alpha = MACH, _angles(table.alpha_max)
    return mach, alpha, _on_grid(table.at(np.repeat(mach, len(alpha))), alpha, len(mach))


def _rarefied(database: Database) -> tuple[float, Array, Array, Array, Array]:
    """Start of rarefied flow; nodes in log10(Kn) and angle; what is added there; share that the continuum loses."""
    table, limit = database.rarefied, database.continuum_limit
    if isinstance(table, GridTable) and database.join == "switch" and table.interpolation == "linear":
        values = _on_grid(table.at(np.repeat(table.nodes, len(table.alpha))), table.alpha, len(table.nodes))
        return limit, np.log10(table.nodes), table.alpha, values, np.ones(len(table.nodes))
    start = limit * (10.0**-0.5 if database.join == "blend" else 1.0)
    # the first node is slightly above the limit, where the look-up is rarefied
    first = np.log10(start)
    nodes = np.append(first + 1e-9, np.arange(first + KNUDSEN_STEP, np.log10(KNUDSEN_END), KNUDSEN_STEP))
    end = table.end.alpha if isinstance(table, FreeMolecularBridge) else table.alpha
    alpha = _angles(min(float(end[-1]), database.continuum.alpha_max))
    knudsen = 10.0 ** np.repeat(nodes, len(alpha))
    angles, count = np.tile(alpha, len(nodes)), len(nodes)
    # the sum is linear in the continuum's curve: two different curves give its weight and the remainder
    curves = [database.continuum.at(np.full(len(knudsen), m)) for m in (5.0, 25.0)]
    below = [c.evaluate(angles) for c in curves]
    joined = [join_regimes(c, table, knudsen, limit, database.join).evaluate(angles) for c in curves]
    weight = ((joined[1] - joined[0])[0] / (below[1] - below[0])[0]).reshape(count, -1)[:, 0]
    thin = joined[0] - np.repeat(weight, len(alpha)) * below[0]
    return start, nodes, alpha, np.ascontiguousarray(thin.T.reshape(count, len(alpha), 3)), 1.0 - weight


def _angles(highest: float) -> Array:
    return np.linspace(0.0, highest, max(2, round(highest / ALPHA_STEP) + 1))


def _on_grid(cut: Slice, alpha: Array, count: int) -> Array:
    """(count, A, 3) coefficients of a cut whose samples repeat each node for every angle."""
    values = cut.evaluate(np.tile(alpha, count))
    return np.ascontiguousarray(values.T.reshape(count, len(alpha), 3))
