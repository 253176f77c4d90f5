"""The model of the world that missions state and effects change: air, loads and rigid body, vectorised over time.

`World` holds what the mission says together with the effects that are switched on. Prediction and simulation ask it
the same questions: how does the air meet the vehicle (`flow`), and what does it do to it (`loads`).

Loads are those of the entry vehicle with its heat shield on, before the parachute:
``F = q S (-CA, CY, -CN)``, moments about the nose moved to the centre of mass (eq. 11.1), pitch and yaw damping
``Cmq (rate D / 2V) q S D``, and what effects add (`edl_filter.effects.effect`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.aero.database import Database
from edl_filter.aero.planes import moments_at_cm, split
from edl_filter.effects.deviation import Deviation
from edl_filter.effects.effect import Active, Body, Flow, Totals
from edl_filter.planet import Planet, ellipsoid
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.postflight.gas import Gas

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Damping:
    """Pitch and yaw damping against Mach number, linear between nodes and held at the edges."""

    mach: Array = field(default_factory=lambda: np.array([0.0, 1.0]))
    cmq: Array = field(default_factory=lambda: np.zeros(2))

    def at(self, mach: Array) -> Array:
        """Coefficient at Mach numbers ``(N,)``."""
        return np.interp(mach, self.mach, self.cmq)


@dataclass(frozen=True)
class World:
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
        Without effects; its offset is what the mission puts the centre of mass beside the axis.
    diameter, x_over_d : float
        m; nominal centre of mass behind the nose, diameters.
    effects : tuple of Active
    deviation : Deviation, optional
        What one flight was off all this, without being an effect.
    """

    planet: Planet
    atmosphere: Atmosphere
    gas: Gas
    database: Database
    damping: Damping
    body: Body
    diameter: float
    x_over_d: float
    effects: tuple[Active, ...] = ()
    deviation: Deviation | None = None

    def having(self, effects: Sequence[Active]) -> World:
        """The same world with other effects."""
        return replace(self, effects=tuple(effects))

    @property
    def area(self) -> float:
        """Reference area, m²."""
        return np.pi / 4.0 * self.diameter**2

    @property
    def gravity_planet(self) -> Planet:
        """Planet with the effects' gravity."""
        planet = self.planet
        for a in self.effects:
            planet = a.effect.gravity(a.values, planet)
        return planet

    @property
    def rigid_body(self) -> Body:
        """Body with the effects'."""
        body = self.body
        for a in self.effects:
            body = a.effect.vehicle(a.values, body)
        return body if self.deviation is None else self.deviation.body(body)

    @property
    def centre_of_mass(self) -> tuple[float, float, float]:
        """The true one, in diameters: behind the nose, to the right and down."""
        return self.rigid_body.centre(self.x_over_d, self.diameter)

    def flow(self, time: Array, position: Array, velocity: Array, inertial_from_body: Array, rate: Array) -> Flow:
        """How the air meets the vehicle.

        Parameters
        ----------
        time : (N,) array
            s.
        position, velocity : (N, 3) arrays
            Inertial, m and m/s.
        inertial_from_body : (N, 4) array
        rate : (N, 3) array
            rad/s, body axes.
        """
        planet = self.planet
        latitude, longitude, altitude = planet.geodetic(time, position)
        enu = ellipsoid.enu_from_fixed(latitude, longitude + planet.rotation.angle(time))
        turning = np.prod([a.effect.atmosphere_rate(a.values) for a in self.effects])
        spin = np.array([0.0, 0.0, planet.rotation_rate * turning])
        wind, density = self.atmosphere.wind_at(altitude), self.atmosphere.density(altitude)
        for a in self.effects:
            if a.effect.acts("wind"):
                wind = wind + a.effect.wind(a.values, altitude)
            if a.effect.acts("density"):
                density = density * a.effect.density(a.values, altitude)
        if self.deviation is not None:
            wind, density = self.deviation.blown(time, wind), self.deviation.thinned(time, density)
        blown = np.einsum("nji,nj->ni", enu[:, :2], wind)
        air = velocity - np.cross(spin, position) - blown
        body = rotations.rotate(rotations.conjugate(inertial_from_body), air)
        speed = np.linalg.norm(air, axis=1)
        return Flow(
            time=time,
            altitude=altitude,
            velocity_body=body,
            rate=rate,
            speed=speed,
            density=density,
            mach=speed / self.atmosphere.speed_of_sound(altitude),
            knudsen=self.gas.knudsen(density, self.diameter),
            dynamic_pressure=0.5 * density * speed**2,
            alpha_total=np.arctan2(np.hypot(body[:, 1], body[:, 2]), body[:, 0]),
            diameter=self.diameter,
        )

    def looked_up(self, flow: Flow) -> Totals:
        """Coefficients of the tables alone."""
        found = self.database.lookup(flow.mach, flow.knudsen, flow.alpha_total, flow.speed)
        return Totals(found.ca, found.cn, found.cm_nose, np.zeros(len(flow.time)), self.damping.at(flow.mach))

    def totals(self, flow: Flow, tables: Totals | None = None) -> Totals:
        """Coefficients with the effects'; `tables` is `looked_up` there, if it is known already."""
        totals = self.looked_up(flow) if tables is None else tables
        for a in self.effects:
            totals = a.effect.coefficients(a.values, flow, totals)
        return totals if self.deviation is None else self.deviation.coefficients(flow.time, totals)

    def loads(self, flow: Flow, tables: Totals | None = None) -> tuple[Array, Array]:
        """Force (N) and moment about the true centre of mass (N m), ``(N, 3)`` each, body axes."""
        totals, d = self.totals(flow, tables), self.diameter
        _, v, w = flow.velocity_body.T
        cn, cy, cm, yaw = split(totals.cn, totals.cm_nose, v, w)
        cl, cm, yaw = moments_at_cm((totals.ca, cy, cn), (totals.cl, cm, yaw), self.centre_of_mass)
        damping = totals.cmq * d / (2.0 * np.maximum(flow.speed, 1.0))
        cm = cm + damping * flow.rate[:, 1]
        yaw = yaw + damping * flow.rate[:, 2]
        push = (flow.dynamic_pressure * self.area)[:, None]
        force = push * np.stack((-totals.ca, cy, -cn), axis=1)
        moment = push * d * np.stack((cl, cm, yaw), axis=1)
        for a in self.effects:
            if a.effect.acts("force_moment"):
                more_force, more_moment = a.effect.force_moment(a.values, flow)
                force, moment = force + more_force, moment + more_moment
        return force, moment
