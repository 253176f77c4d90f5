"""Forward model of the entry: flow, loads and rigid body, vectorised over time.

This module is the one place where the models that a mission states are composed with the effects that are switched on.
`ForwardModel` does so for prediction and simulation: `ForwardModel.flow` gives the flow about the vehicle, and
`ForwardModel.loads` its force and moment. The functions ``compose_*`` do it for callers that have no aerodynamic
database: the filter's problem, its constraints and the air data.

Loads are those of the entry vehicle with its heat shield on, before the parachute:
``F = q S (-CA, CY, -CN)``, moments about the nose moved to the centre of mass (eq. 11.1), pitch and yaw damping
``Cmq (rate D / 2V) q S D``, and what effects add (`edl_filter.effects.base`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from edl_filter import rotations
from edl_filter.aero.conventions import reference_area, total_angle
from edl_filter.aero.damping import Damping
from edl_filter.aero.database import Database
from edl_filter.aero.planes import moments_at_cm, split
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.perturbation import Perturbation
from edl_filter.effects.types import AeroCoefficients, Body, FlightCondition
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import Gas
from edl_filter.types import Array, BoolArray

if TYPE_CHECKING:
    from edl_filter.telemetry.record import InitialState

#: Iterations of `invert_entry_state`: each leaves the effect's size times the error before.
_ENTRY_ITERATIONS = 8


def compose_gravity(planet: Planet, effects: Sequence[EffectInstance]) -> Planet:
    """The planet with the gravity field that the effects give it."""
    for a in effects:
        planet = a.effect.gravity(a.values, planet)
    return planet


def compose_air_rotation(planet: Planet, effects: Sequence[EffectInstance]) -> Planet:
    """A planet that rotates at the rate of the air: right for velocities relative to the air, not for longitudes."""
    factors = [a.effect.atmosphere_rate(a.values) for a in effects if a.effect.acts("atmosphere_rate")]
    return replace(planet, rotation_rate=planet.rotation_rate * float(np.prod(factors))) if factors else planet


def compose_density(density: Array, effects: Sequence[EffectInstance], altitude: Array) -> Array:
    """Density with the effects' factors.

    Parameters
    ----------
    density : (N,) array
        Without effects, kg/m³.
    effects : sequence of EffectInstance
        In the order in which they act.
    altitude : (N,) array
        Areodetic, m.

    Returns
    -------
    (N,) array
        kg/m³.
    """
    for a in effects:
        if a.effect.acts("density"):
            density = density * a.effect.density(a.values, altitude)
    return density


def compose_wind(wind: Array, effects: Sequence[EffectInstance], altitude: Array) -> Array:
    """Wind with the effects' winds added.

    Parameters
    ----------
    wind : (N, 2) array
        Without effects, towards east and north, m/s.
    effects : sequence of EffectInstance
        In the order in which they act.
    altitude : (N,) array
        Areodetic, m.

    Returns
    -------
    (N, 2) array
        m/s.
    """
    for a in effects:
        if a.effect.acts("wind"):
            wind = wind + a.effect.wind(a.values, altitude)
    return wind


def compose_coefficients(
    coefficients: AeroCoefficients, effects: Sequence[EffectInstance], flow: FlightCondition
) -> AeroCoefficients:
    """Total coefficients with the changes that the effects make in the given flow."""
    for a in effects:
        coefficients = a.effect.coefficients(a.values, flow, coefficients)
    return coefficients


def compose_loads(
    force: Array, moment: Array, effects: Sequence[EffectInstance], flow: FlightCondition
) -> tuple[Array, Array]:
    """Force and moment with those that the effects add in the given flow.

    Parameters
    ----------
    force, moment : (N, 3) arrays
        Without effects: N, and N m about the centre of mass; body axes.
    effects : sequence of EffectInstance
        In the order in which they act.
    flow : FlightCondition
        Flow of the N samples.

    Returns
    -------
    force, moment : (N, 3) arrays
        N and N m.
    """
    for a in effects:
        if a.effect.acts("force_moment"):
            added_force, added_moment = a.effect.force_moment(a.values, flow)
            force, moment = force + added_force, moment + added_moment
    return force, moment


def compose_body(body: Body, effects: Sequence[EffectInstance]) -> Body:
    """The rigid body with the effects' mass, inertia and centre of mass."""
    for a in effects:
        body = a.effect.vehicle(a.values, body)
    return body


def compose_entry_state(stated: InitialState, effects: Sequence[EffectInstance]) -> InitialState:
    """The true entry state, by the effects, where `stated` was stated."""
    for a in effects:
        stated = a.effect.entry_state(a.values, stated)
    return stated


def invert_entry_state(true: InitialState, effects: Sequence[EffectInstance]) -> InitialState:
    """The entry state that was stated where the true one is `true`: inverse of `compose_entry_state`, by iteration."""
    for a in [a for a in effects if a.effect.acts("entry_state")][::-1]:
        true = _invert_instance(true, a)
    return true


def _invert_instance(true: InitialState, instance: EffectInstance) -> InitialState:
    """The state that one effect turns into `true`."""
    stated = true
    for _ in range(_ENTRY_ITERATIONS):
        reached = instance.effect.entry_state(instance.values, stated)
        error = rotations.multiply(rotations.conjugate(reached.inertial_from_body), true.inertial_from_body)
        stated = replace(
            true,
            position=stated.position + (true.position - reached.position),
            velocity=stated.velocity + (true.velocity - reached.velocity),
            inertial_from_body=rotations.normalise(rotations.multiply(stated.inertial_from_body, error)),
        )
    return stated


@dataclass(frozen=True)
class ForwardModel:
    """All that acts on the vehicle before the parachute.

    Attributes
    ----------
    planet : Planet
    atmosphere : Atmosphere
        Preflight table.
    gas : Gas
    database : Database
    damping : Damping
    body : Body
        Without effects; its offset is that of the centre of mass from the axis, as the mission states it.
    diameter, x_over_d : float
        m; nominal centre of mass behind the nose, diameters.
    effects : tuple of EffectInstance
    perturbation : Perturbation, optional
        By how much air, coefficients and vehicle of one flight differ from all this, without being an effect.
    changed_bodies : tuple of (float, Body)
        Bodies that events of the flight leave, without effects: from which time on (s), in order of time.
    """

    planet: Planet
    atmosphere: Atmosphere
    gas: Gas
    database: Database
    damping: Damping
    body: Body
    diameter: float
    x_over_d: float
    effects: tuple[EffectInstance, ...] = ()
    perturbation: Perturbation | None = None
    changed_bodies: tuple[tuple[float, Body], ...] = ()

    def with_effects(self, effects: Sequence[EffectInstance]) -> ForwardModel:
        """The same model with other effects in place of its own."""
        return replace(self, effects=tuple(effects))

    @property
    def area(self) -> float:
        """Reference area, m²."""
        return reference_area(self.diameter)

    @property
    def gravity_planet(self) -> Planet:
        """Planet with the effects' gravity."""
        return compose_gravity(self.planet, self.effects)

    @property
    def rigid_body(self) -> Body:
        """Body at entry, with the effects and the perturbation."""
        return self._with_effects_and_perturbation(self.body)

    def _with_effects_and_perturbation(self, body: Body) -> Body:
        body = compose_body(body, self.effects)
        return body if self.perturbation is None else self.perturbation.perturb_body(body)

    def bodies(self, time: Array) -> Iterator[tuple[slice | BoolArray, Body]]:
        """Bodies with the effects and the perturbation, each with the samples of `time` at which it flies.

        Parameters
        ----------
        time : (N,) array
            s. At the time of an event the body is the one that the event leaves.

        Yields
        ------
        samples : slice or (N,) boolean array
        body : Body
        """
        if not self.changed_bodies:
            yield slice(None), self.rigid_body
            return
        number = np.searchsorted([t for t, _ in self.changed_bodies], time, side="right")
        for k, body in enumerate((self.body, *(b for _, b in self.changed_bodies))):
            samples = number == k
            if samples.any():
                yield samples, self._with_effects_and_perturbation(body)

    def specific_force(self, time: Array, force: Array) -> Array:
        """Specific force ``(N, 3)``, m/s², from the force ``(N, 3)``, N, at the times ``(N,)``, s."""
        out = np.empty(force.shape)
        for samples, body in self.bodies(time):
            out[samples] = force[samples] / body.mass
        return out

    def angular_acceleration(self, time: Array, rate: Array, moment: Array) -> Array:
        """Euler's equations, ``I⁻¹ (M - w × I w)``.

        Parameters
        ----------
        time : (N,) array
            s.
        rate : (N, 3) array
            rad/s, body axes.
        moment : (N, 3) array
            About the centre of mass, N m, body axes.

        Returns
        -------
        (N, 3) array
            rad/s².
        """
        out = np.empty(moment.shape)
        for samples, body in self.bodies(time):
            net_moment = moment[samples] - np.cross(rate[samples], rate[samples] @ body.inertia)
            out[samples] = net_moment @ np.linalg.inv(body.inertia).T
        return out

    def centre_of_mass(self, time: Array) -> Array:
        """Centre of mass with effects ``(N, 3)``, in diameters: behind the nose, to the right and down."""
        out = np.empty((len(time), 3))
        for samples, body in self.bodies(time):
            out[samples] = body.centre(self.x_over_d, self.diameter)
        return out

    def air_at(self, altitude: Array) -> tuple[Array, Array]:
        """Density and wind with the effects', without the perturbation, which depends on time.

        Parameters
        ----------
        altitude : (N,) array
            Areodetic, m.

        Returns
        -------
        density : (N,) array
            kg/m³.
        wind : (N, 2) array
            Towards east and north, m/s.
        """
        return (
            compose_density(self.atmosphere.density(altitude), self.effects, altitude),
            compose_wind(self.atmosphere.wind_at(altitude), self.effects, altitude),
        )

    def flow(
        self, time: Array, position: Array, velocity: Array, inertial_from_body: Array, rate: Array
    ) -> FlightCondition:
        """Flow about the vehicle along a trajectory.

        Parameters
        ----------
        time : (N,) array
            s.
        position, velocity : (N, 3) arrays
            Inertial, m and m/s.
        inertial_from_body : (N, 4) array
            Scalar last.
        rate : (N, 3) array
            rad/s, body axes.

        Returns
        -------
        FlightCondition
        """
        planet = self.planet
        latitude, longitude, altitude = planet.geodetic(time, position)
        enu = planet.enu_at(time, latitude, longitude)
        density, wind = self.air_at(altitude)
        if self.perturbation is not None:
            wind, density = self.perturbation.perturb_wind(time, wind), self.perturbation.perturb_density(time, density)
        air_planet = compose_air_rotation(planet, self.effects)
        air = air_planet.velocity_relative(position, velocity) - np.einsum("nji,nj->ni", enu[:, :2], wind)
        body = rotations.rotate(rotations.conjugate(inertial_from_body), air)
        speed = np.linalg.norm(air, axis=1)
        return FlightCondition(
            time=time,
            altitude=altitude,
            velocity_body=body,
            rate=rate,
            speed=speed,
            density=density,
            mach=speed / self.atmosphere.speed_of_sound(altitude),
            knudsen=self.gas.knudsen(density, self.diameter),
            dynamic_pressure=0.5 * density * speed**2,
            alpha_total=total_angle(body),
            diameter=self.diameter,
        )

    def table_coefficients(self, flow: FlightCondition) -> AeroCoefficients:
        """Coefficients of the database and the damping table alone, without effects."""
        entry = self.database.lookup(flow.mach, flow.knudsen, flow.alpha_total, flow.speed)
        return AeroCoefficients(entry.ca, entry.cn, entry.cm_nose, np.zeros(len(flow.time)), self.damping.at(flow.mach))

    def coefficients(self, flow: FlightCondition, tables: AeroCoefficients | None = None) -> AeroCoefficients:
        """Coefficients with the effects and the perturbation.

        Parameters
        ----------
        flow : FlightCondition
            Flow of the N samples.
        tables : AeroCoefficients, optional
            `table_coefficients` of that flow, where the caller has them already.
        """
        coefficients = compose_coefficients(
            self.table_coefficients(flow) if tables is None else tables, self.effects, flow
        )
        if self.perturbation is None:
            return coefficients
        return self.perturbation.perturb_coefficients(flow, coefficients)

    def loads(self, flow: FlightCondition, tables: AeroCoefficients | None = None) -> tuple[Array, Array]:
        """Force and moment on the vehicle.

        Parameters
        ----------
        flow : FlightCondition
            Flow of the N samples.
        tables : AeroCoefficients, optional
            As in `coefficients`.

        Returns
        -------
        force, moment : (N, 3) arrays
            N, and N m about the true centre of mass; body axes.
        """
        totals, d = self.coefficients(flow, tables), self.diameter
        _, v, w = flow.velocity_body.T
        cn, cy, cm, yaw = split(totals.cn, totals.cm_nose, v, w)
        x, y, z = self.centre_of_mass(flow.time).T
        cl, cm, yaw = moments_at_cm((totals.ca, cy, cn), (totals.cl, cm, yaw), (x, y, z))
        damping = totals.cmq * d / (2.0 * np.maximum(flow.speed, 1.0))
        cm = cm + damping * flow.rate[:, 1]
        yaw = yaw + damping * flow.rate[:, 2]
        if self.perturbation is not None and (fixed := self.perturbation.body_fixed(flow)):
            cy, cn = cy + fixed["side_asymmetry"], cn + fixed["normal_asymmetry"]
            cm, yaw = cm + fixed["pitch_asymmetry"], yaw + fixed["yaw_asymmetry"]
        push = (flow.dynamic_pressure * self.area)[:, None]
        force = push * np.stack((-totals.ca, cy, -cn), axis=1)
        moment = push * d * np.stack((cl, cm, yaw), axis=1)
        return compose_loads(force, moment, self.effects, flow)
