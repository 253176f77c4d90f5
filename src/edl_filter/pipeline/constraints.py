"""What a mission holds the flight to: its constraints with their values.

The mission says which statements are to be used and how well they are known; the telemetry, or the mission itself,
holds the values. Nothing is estimated here but means over windows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from edl_filter.effects.air import air_planet, changed_atmosphere
from edl_filter.effects.effect import Active
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.estimation import LandingSite
from edl_filter.mission.sections import FromTelemetry
from edl_filter.modelling import body_of
from edl_filter.navigation import constraints as known
from edl_filter.navigation.increments import Samples
from edl_filter.planet import Planet, ellipsoid
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.record import Telemetry

Array = NDArray[np.float64]


def statements(
    mission: Mission,
    telemetry: Telemetry,
    samples: Samples,
    planet: Planet,
    atmosphere: Atmosphere,
    start: float,
    effects: Sequence[Active] = (),
) -> list[known.Constraint]:
    """All constraints that the mission wants, from `start` (s) on; the air that they ask is that of the effects."""
    c = mission.constraints
    atmosphere = changed_atmosphere(atmosphere, effects)
    found: list[known.Constraint] = []
    if c.pre_entry_zero_force is not None:
        z = c.pre_entry_zero_force
        part = window(samples, z.start_s, z.end_s, "pre_entry_zero_force")
        noise = float(np.sqrt(np.mean(part.force_noise**2) / len(part.time)))
        found.append(known.ZeroSpecificForce(start, mean(part), np.full(3, np.hypot(z.sigma, noise))))
    if c.onboard_attitude is not None:
        found += onboard_attitudes(telemetry, c.onboard_attitude.interval_s, start)
    if c.parachute is not None:
        found.append(_parachute(mission, telemetry, air_planet(planet, effects), atmosphere))
    if c.steady_descent is not None:
        found.append(_steady_descent(mission, samples, planet, atmosphere, body_of(mission, effects).mass))
    if c.landing is not None and not (isinstance(c.landing, LandingSite) and not c.landing.use):
        found.append(_landing(mission, telemetry, planet))
    if c.rest is not None:
        found += _rest(mission, telemetry, samples, planet)
    if c.altimeter is not None:
        found += _altimeter(mission, telemetry)
    return found


def window(samples: Samples, start: float, end: float, name: str) -> Samples:
    """Samples within a constraint's window."""
    first, last = samples.index(start), samples.index(end)
    if last - first < 2:
        raise InputError(
            f"constraints.{name}: no telemetry between {start:g} and {end:g} s; it runs from "
            f"{samples.time[0]:g} to {samples.time[-1]:g} s."
        )
    return samples.part(first, last)


def mean(samples: Samples) -> Array:
    """Mean specific force over time, body axes."""
    return samples.interval @ samples.mean_force / samples.interval.sum()


def onboard_attitudes(telemetry: Telemetry, interval: float, start: float) -> list[known.Constraint]:
    """On-board attitudes every `interval` and on both sides of a gap, where the gyros were read themselves.

    Where the rates were made from the on-board quaternion it would say nothing new.
    """
    attitude, driving = telemetry.attitude, telemetry.driving
    if attitude is None:
        raise InputError("constraints.onboard_attitude: the telemetry has no on-board attitude.")
    gyros = np.isin(driving.source, [i for i, s in enumerate(driving.sources) if s in ("HIGHRATE", "gap")])
    if not gyros.any():
        return []
    span = driving.time[gyros]
    gap = driving.source == (driving.sources.index("gap") if "gap" in driving.sources else -1)
    inside, edges = _within(attitude.time, driving.time[gap], driving.interval[gap])
    found: list[known.Constraint] = []
    last = -np.inf
    for k in np.flatnonzero((attitude.time > max(start, span[0])) & (attitude.time <= span[-1]) & ~inside):
        time = float(attitude.time[k])
        if time - last >= interval or k in edges:
            quaternion, sigma = attitude.inertial_from_body[k], float(attitude.sigma[k])
            found.append(known.OnboardAttitude(time, quaternion, sigma))
            last = time
    return found


def _within(time: Array, end: Array, interval: Array) -> tuple[NDArray[np.bool_], set[int]]:
    """Which of `time` lie within gaps of adjoining samples, and the indices of the last before and first after each."""
    begins = end - interval
    first = np.flatnonzero(np.diff(begins, prepend=-np.inf) > 1.5 * interval)
    inside = np.zeros(len(time), bool)
    edges: set[int] = set()
    for start, stop in zip(begins[first], np.append(end[first[1:] - 1], end[-1:]), strict=True):
        inside |= (time > start + 1e-6) & (time < stop - 1e-6)
        before, after = np.flatnonzero(time <= start + 1e-6), np.flatnonzero(time >= stop - 1e-6)
        edges |= {int(before[-1]), int(after[0])} if len(before) and len(after) else set()
    return inside, edges


def _event(mission: Mission, telemetry: Telemetry, name: str, constraint: str) -> float:
    times = telemetry.events | mission.event_times()
    if name not in times:
        raise InputError(f"{mission.source}: constraints.{constraint} needs the event {name}; there is none.")
    return times[name]


def _parachute(mission: Mission, telemetry: Telemetry, planet: Planet, atmosphere: Atmosphere) -> known.DynamicPressure:
    stated, sigma = mission.constraints.parachute, mission.atmosphere.density_sigma
    if isinstance(stated, FromTelemetry):
        fix = telemetry.parachute
        if fix is None:
            raise InputError(f"{mission.source}: constraints.parachute: the telemetry says nothing of it.")
        return known.DynamicPressure(
            fix.time, fix.dynamic_pressure, fix.dynamic_pressure_sigma, sigma, planet, atmosphere
        )
    assert stated is not None
    time = _event(mission, telemetry, "parachute_deploy", "parachute")
    return known.DynamicPressure(
        time, stated.dynamic_pressure, stated.dynamic_pressure_sigma, sigma, planet, atmosphere
    )


def _steady_descent(
    mission: Mission, samples: Samples, planet: Planet, atmosphere: Atmosphere, mass_at_entry: float
) -> known.SteadyDescent:
    """Terminal speed from the measured drag, ``m f = ρ V² C_D S / 2``, at whatever density the state's altitude has."""
    c, parachute = mission.constraints.steady_descent, mission.vehicle.parachute
    assert c is not None and parachute is not None and parachute.drag_coefficient is not None  # the mission is checked
    part = window(samples, c.start_s, c.end_s, "steady_descent")
    drag = float(part.interval @ np.linalg.norm(part.mean_force, axis=1) / part.interval.sum())
    time = 0.5 * (c.start_s + c.end_s)
    events = mission.event_times()
    masses = [e.mass for n, e in mission.vehicle.events.items() if e.mass is not None and events[n] < time]
    mass = masses[-1] if masses else mass_at_entry
    area = np.pi / 4.0 * parachute.area_diameter**2
    return known.SteadyDescent(
        time=time,
        dynamic_pressure=mass * drag / (parachute.drag_coefficient * area),
        wind_sigma=c.horizontal_sigma,
        # a speed goes with the root of the density
        speed_sigma=float(np.hypot(c.vertical_sigma, 0.5 * mission.atmosphere.density_sigma)),
        planet=planet,
        atmosphere=atmosphere,
    )


def _landing(mission: Mission, telemetry: Telemetry, planet: Planet) -> known.LandingSite:
    stated = mission.constraints.landing
    if isinstance(stated, FromTelemetry):
        fix = telemetry.landing
        if fix is None:
            raise InputError(f"{mission.source}: constraints.landing: the telemetry has no landing position.")
        return known.LandingSite(fix.time, fix.position, np.diag(fix.position_sigma**2), planet)
    assert stated is not None
    enu = ellipsoid.enu_from_fixed(stated.latitude, stated.longitude)
    sigma = np.array([stated.horizontal_sigma, stated.horizontal_sigma, stated.vertical_sigma])
    time = _event(mission, telemetry, "landing", "landing")
    return known.LandingSite(time, stated.position, enu.T @ np.diag(sigma**2) @ enu, planet)


def _rest(mission: Mission, telemetry: Telemetry, samples: Samples, planet: Planet) -> list[known.Constraint]:
    """Rest: no velocity, and minus gravity on the accelerometers; in a flight file also rates on the gyros."""
    stated = mission.constraints.rest
    assert stated is not None
    if isinstance(stated, FromTelemetry):
        if telemetry.landing is None:
            raise InputError(f"{mission.source}: constraints.rest: the telemetry has no landing.")
        start, end = telemetry.landing.time, float(samples.time[-1])
    else:
        start, end = stated.start_s, stated.end_s
    part = window(samples, start, end, "rest")
    count = len(part.time)
    force_sigma = float(np.sqrt(np.mean(part.force_noise**2) / count))
    rate_sigma = float(np.sqrt(np.mean(part.rate_noise**2) / count))
    found: list[known.Constraint] = [known.RestVelocity(start, stated.velocity_sigma, planet)]
    if isinstance(stated, FromTelemetry):
        found.append(known.RestGravity(start, mean(part), force_sigma, planet))
        rate = part.interval @ part.mean_rate / part.interval.sum()
        found.append(known.RestRate(start, rate, rate_sigma, planet))
    elif stated.gravity_direction_sigma is not None:
        force = mean(part)
        sigma = float(np.hypot(force_sigma, np.linalg.norm(force) * stated.gravity_direction_sigma))
        found.append(known.RestGravity(start, force, sigma, planet))
    return found


def _altimeter(mission: Mission, telemetry: Telemetry) -> list[known.Constraint]:
    """Every reading up to the landing."""
    stated, record = mission.constraints.altimeter, telemetry.altimeter
    assert stated is not None
    if record is None:
        raise InputError(f"{mission.source}: constraints.altimeter: the telemetry has no altimeter.")
    end = telemetry.landing.time if telemetry.landing is not None else np.inf
    sigma = stated.sigma if stated.sigma is not None else record.sigma
    return [
        known.Altimeter(float(t), float(h), sigma, record.surface_radius)
        for t, h in zip(record.time, record.height, strict=True)
        if t <= end
    ]
