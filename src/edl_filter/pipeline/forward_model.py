"""From a mission to the forward model: database, damping, rigid body, effects."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from edl_filter.aero.body import SphereCone
from edl_filter.aero.damping import Damping, read_damping
from edl_filter.aero.database import Database, load_database
from edl_filter.aero.increment_tables import IncrementTables
from edl_filter.aero.increments_file import read_increments
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import ForwardModel, compose_body
from edl_filter.effects.types import Body
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.world import VehicleChangeConfig
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere


def forward_model_of(
    mission: Mission, planet: Planet, atmosphere: Atmosphere, effects: Sequence[EffectInstance] | None = None
) -> ForwardModel:
    """The forward model of a mission.

    Parameters
    ----------
    mission : Mission
        Checked mission.
    planet, atmosphere : Planet, Atmosphere
        The mission's own, without effects, as in `Reconstruction`.
    effects : sequence of EffectInstance, optional
        Instead of the mission's.

    Raises
    ------
    InputError
        The mission has no aerodynamics or no inertia, or a table or effect is invalid.
    """
    if mission.aerodynamics is None:
        raise InputError(f"{mission.source or mission.name}: aerodynamics: found nothing; a prediction needs it.")
    if mission.vehicle.inertia is None:
        raise InputError(f"{mission.source or mission.name}: vehicle.inertia: found nothing; a prediction needs it.")
    return ForwardModel(
        planet=planet,
        atmosphere=atmosphere,
        gas=atmosphere.gas,
        database=database_of(mission),
        damping=damping_of(mission),
        body=body_of(mission),
        diameter=mission.vehicle.diameter,
        x_over_d=mission.vehicle.centre_of_mass,
        effects=mission.active_effects() if effects is None else tuple(effects),
        changed_bodies=changed_bodies(body_of(mission), mission.vehicle_changes()),
    )


def database_of(mission: Mission) -> Database:
    """Aerodynamic database of a mission that names one."""
    aero = mission.aerodynamics
    assert aero is not None
    database = load_database(
        mission.aerodynamic_table("continuum"),
        mission.aerodynamic_table("rarefied"),
        continuum_limit=aero.continuum_limit,
        join=aero.join,
        family=aero.family,
        speed_per_mach=aero.velocity_per_mach,
        interpolation=aero.interpolation,
        body=_forebody(mission),
        base_pressure=aero.base_pressure,
        continuum_moment_point=aero.continuum_moment_point,
        rarefied_moment_point=aero.rarefied_moment_point,
    )
    path = mission.increments_path()
    if path is None:
        return database
    update = read_increments(path, aero.family, f"{mission.source or mission.name}: aerodynamics.increments")
    return replace(database, increments=IncrementTables(update))


def _forebody(mission: Mission) -> SphereCone | None:
    """The forebody that the mission states, if it does."""
    shape = None if mission.aerodynamics is None else mission.aerodynamics.forebody
    if shape is None:
        return None
    try:
        return SphereCone(mission.vehicle.diameter, shape.nose_radius, shape.shoulder_radius, shape.cone_half_angle)
    except InputError as error:
        raise InputError(f"{mission.source}: aerodynamics.forebody: {error}") from None


def damping_of(mission: Mission) -> Damping:
    """Pitch and yaw damping of a mission; none where it names no table."""
    path = mission.damping_path()
    return Damping() if path is None else read_damping(path)


def body_of(mission: Mission, effects: Sequence[EffectInstance] = ()) -> Body:
    """The vehicle at entry, with effects.

    Parameters
    ----------
    mission : Mission
        Its `vehicle`.
    effects : sequence of EffectInstance
        Those that change mass, inertia or centre of mass act.

    Returns
    -------
    Body
        Mass, kg; inertia, kg m², zero where the mission states none; offset of the centre of mass, m.
    """
    vehicle = mission.vehicle
    body = Body(
        mass=vehicle.mass,
        inertia=np.zeros((3, 3)) if vehicle.inertia is None else vehicle.inertia.tensor,
        offset=vehicle.diameter * np.array([0.0, *vehicle.centre_of_mass_offset]),
    )
    return compose_body(body, effects)


def body_before(mission: Mission, time: float, effects: Sequence[EffectInstance] = ()) -> Body:
    """The vehicle just before a time (s since the epoch), with effects: as earlier events of the mission left it."""
    entry = body_of(mission)
    bodies = [entry, *(b for t, b in changed_bodies(entry, mission.vehicle_changes()) if t < time)]
    return compose_body(bodies[-1], effects)


def changed_bodies(body: Body, events: Iterable[tuple[float, VehicleChangeConfig]]) -> tuple[tuple[float, Body], ...]:
    """Bodies that events leave: from which time on, s since the epoch.

    Parameters
    ----------
    body : Body
        At entry.
    events : iterable of (time, event)
        In order of time, s; events that do not change the body are passed over.
    """
    bodies = []
    for time, event in events:
        before = body
        if event.mass is not None:
            body = replace(body, mass=event.mass)
        if event.centre_of_mass_shift is not None:
            body = replace(body, offset=body.offset + np.array(event.centre_of_mass_shift))
        if event.inertia is not None:
            body = replace(body, inertia=event.inertia.tensor)
        if body is not before:
            bodies.append((time, body))
    return tuple(bodies)
