"""The nominal model that a mission states, as a world to fly in."""

from __future__ import annotations

import numpy as np

from edl_filter.aero.database import load_database
from edl_filter.assembly import read_atmosphere
from edl_filter.effects.effect import Body
from edl_filter.effects.world import Damping, World
from edl_filter.mission import Mission
from edl_filter.planet import Planet
from edl_filter.postflight.gas import Gas

_DAMPING = Damping(
    np.array([0.0, 1.2, 1.5, 2.0, 2.5, 3.5, 6.0, 40.0]), np.array([-0.05, 0.1, 0.25, 0.18, 0.06, -0.05, -0.1, -0.1])
)


def nominal_world(mission: Mission, planet: Planet) -> World:
    """World of a mission's model, without effects."""
    a, v, m = mission.aerodynamics, mission.vehicle, mission.atmosphere
    assert a is not None and v.inertia is not None  # the scenario is checked
    database = load_database(
        mission.aerodynamic_table("continuum"),
        mission.aerodynamic_table("rarefied"),
        continuum_limit=a.continuum_limit,
        join=a.join,
        family=a.family,
        speed_per_mach=a.velocity_per_mach,
        interpolation=a.interpolation,
        continuum_moment_point=a.continuum_moment_point,
        rarefied_moment_point=a.rarefied_moment_point,
    )
    gas = Gas(m.gas_constant, m.heat_capacity_ratio, m.molecule_diameter, m.molecule_mass)
    return World(
        planet, read_atmosphere(mission), gas, database, _DAMPING, Body(v.mass, v.inertia.tensor), v.diameter,
        v.centre_of_mass,
    )  # fmt: skip
