"""The filter's constraints, from a mission and its telemetry.

The mission states which constraints are used and with which sigmas; the telemetry, or the mission itself,
holds the measured values. Nothing is estimated in this module except means over windows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from edl_filter import rotations
from edl_filter.aero.conventions import reference_area
from edl_filter.effects.adapters import atmosphere_with_effects
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import compose_air_rotation
from edl_filter.errors import InputError
from edl_filter.imu_model.lever_arm import edge_values
from edl_filter.mission import Mission
from edl_filter.mission.estimation import LandingSiteConfig
from edl_filter.mission.fields import FromTelemetryConfig
from edl_filter.navigation import constraints as models
from edl_filter.navigation.increments import Samples
from edl_filter.pipeline.forward_model import body_before
from edl_filter.pipeline.load import event_times
from edl_filter.pipeline.parachute import parachute_deployment
from edl_filter.planet import Planet, ellipsoid
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, InitialState, Telemetry
from edl_filter.types import Array, BoolArray


def build_constraints(
    mission: Mission,
    telemetry: Telemetry,
    samples: Samples,
    planet: Planet,
    atmosphere: Atmosphere,
    initial: InitialState,
    effects: Sequence[EffectInstance] = (),
) -> list[models.Constraint]:
    """All constraints that the mission names.

    Parameters
    ----------
    mission : Mission
        Checked mission.
    telemetry : Telemetry
        From which the effects are removed.
    samples : Samples
        Of the driving instrument.
    planet, atmosphere : Planet, Atmosphere
        The mission's own; the constraints use the air with the effects.
    initial : InitialState
        Entry state.
    effects : sequence of EffectInstance
        Those whose air and vehicle the constraints assume.

    Raises
    ------
    InputError
        The telemetry does not have what a constraint needs.
    """
    c, start = mission.constraints, initial.time
    atmosphere = atmosphere_with_effects(atmosphere, effects)
    constraints: list[models.Constraint] = []
    if c.pre_entry_zero_force is not None:
        z = c.pre_entry_zero_force
        part = window(samples, z.start_s, z.end_s, "pre_entry_zero_force")
        noise = np.sqrt(np.mean(part.force_noise**2, axis=0) / len(part.time))
        constraints.append(models.ZeroSpecificForce(start, mean(part), np.hypot(z.sigma, noise)))
    if c.onboard_attitude is not None:
        constraints += onboard_attitudes(telemetry, c.onboard_attitude.interval_s, start)
    if c.parachute is not None:
        constraints.append(_parachute(mission, telemetry, samples, planet, atmosphere, initial, effects))
    if c.steady_descent is not None:
        constraints.append(_steady_descent(mission, samples, planet, atmosphere, effects))
    if c.landing is not None and not (isinstance(c.landing, LandingSiteConfig) and not c.landing.use):
        constraints.append(_landing(mission, telemetry, planet))
    if c.rest is not None:
        constraints += _rest(mission, telemetry, samples, planet)
    if c.altimeter is not None:
        constraints += _altimeter(mission, telemetry)
    return constraints


def window(samples: Samples, start: float, end: float, name: str) -> Samples:
    """Samples within the window of the constraint `name`, from `start` to `end` (s)."""
    first, last = samples.index(start), samples.index(end)
    if last - first < 2:
        stretch = f"between {start:g} and {end:g} s" if end > start else f"from {start:g} s on"
        raise InputError(
            f"constraints.{name}: no telemetry {stretch}; it runs from {samples.time[0]:g} to {samples.time[-1]:g} s. "
            "Remove the constraint, or state a time within the telemetry."
        )
    return samples.part(first, last)


def mean(samples: Samples) -> Array:
    """Mean specific force over all samples, ``(3,)``, m/s², body axes."""
    return samples.interval @ samples.mean_force / samples.interval.sum()


#: Relative rate by which the clock of an IMU and that of a mission may differ; those of MER's differ by 2e-5.
_CLOCK_TOLERANCE = 1e-3


def onboard_attitudes(telemetry: Telemetry, interval: float, start: float) -> list[models.Constraint]:
    """On-board attitudes every `interval` (s) and on both sides of a gap, from `start` (s) on, where gyros were read.

    Where the rates were derived from the on-board quaternion, it would contain no new information.
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
    constraints: list[models.Constraint] = []
    last = -np.inf
    for k in np.flatnonzero((attitude.time > max(start, span[0])) & (attitude.time <= span[-1]) & ~inside):
        time = float(attitude.time[k])
        if time - last >= interval * (1.0 - _CLOCK_TOLERANCE) or k in edges:
            quaternion, sigma = attitude.inertial_from_body[k], float(attitude.sigma[k])
            constraints.append(models.OnboardAttitude(time, quaternion, sigma))
            last = time
    return constraints


def _within(time: Array, end: Array, interval: Array) -> tuple[BoolArray, set[int]]:
    """Which of `time` lie within gaps of adjoining samples, and the indices of the last before and first after each."""
    begins = end - interval
    first = np.flatnonzero(np.diff(begins, prepend=-np.inf) > 1.5 * interval)
    inside = np.zeros(len(time), bool)
    edges: set[int] = set()
    for start, stop in zip(begins[first], np.append(end[first[1:] - 1], end[-1:]), strict=True):
        inside |= (time > start + SAME_TIME) & (time < stop - SAME_TIME)
        before, after = np.flatnonzero(time <= start + SAME_TIME), np.flatnonzero(time >= stop - SAME_TIME)
        edges |= {int(before[-1]), int(after[0])} if len(before) and len(after) else set()
    return inside, edges


def _event(mission: Mission, telemetry: Telemetry, name: str, constraint: str) -> float:
    times = event_times(mission, telemetry)
    if name not in times:
        raise InputError(f"{mission.source}: constraints.{constraint} needs the event {name}; there is none.")
    return times[name]


def _parachute(
    mission: Mission,
    telemetry: Telemetry,
    samples: Samples,
    planet: Planet,
    atmosphere: Atmosphere,
    initial: InitialState,
    effects: Sequence[EffectInstance],
) -> models.Constraint:
    air_planet = compose_air_rotation(planet, effects)
    if isinstance(mission.constraints.parachute, FromTelemetryConfig):
        fix = telemetry.parachute
        if fix is None:
            raise InputError(f"{mission.source}: constraints.parachute: the telemetry has no parachute deployment.")
        density = mission.atmosphere.density_sigma
        return models.DynamicPressure(
            fix.time, fix.dynamic_pressure, fix.dynamic_pressure_sigma, density, air_planet, atmosphere
        )
    time = _event(mission, telemetry, "parachute_deploy", "parachute")
    return parachute_deployment(mission, telemetry, samples, planet, air_planet, atmosphere, initial, time, effects)


def _steady_descent(
    mission: Mission,
    samples: Samples,
    planet: Planet,
    atmosphere: Atmosphere,
    effects: Sequence[EffectInstance],
) -> models.SteadyDescent:
    """Terminal speed from the measured drag, ``m f = ρ V² C_D S / 2``, at whatever density the state's altitude has."""
    c, parachute = mission.constraints.steady_descent, mission.vehicle.parachute
    assert c is not None and parachute is not None and parachute.drag_coefficient is not None  # the mission is checked
    part = window(samples, c.start_s, c.end_s, "steady_descent")
    drag = float(part.interval @ np.linalg.norm(part.mean_force, axis=1) / part.interval.sum())
    time = 0.5 * (c.start_s + c.end_s)
    mass = body_before(mission, time, effects).mass
    area = reference_area(parachute.area_diameter)
    return models.SteadyDescent(
        time=time,
        dynamic_pressure=mass * drag / (parachute.drag_coefficient * area),
        wind_sigma=c.horizontal_sigma,
        # a speed goes with the root of the density
        speed_sigma=float(np.hypot(c.vertical_sigma, 0.5 * mission.atmosphere.density_sigma)),
        planet=planet,
        atmosphere=atmosphere,
    )


def _landing(mission: Mission, telemetry: Telemetry, planet: Planet) -> models.LandingSite:
    stated = mission.constraints.landing
    if isinstance(stated, FromTelemetryConfig):
        fix = telemetry.landing
        if fix is None:
            raise InputError(f"{mission.source}: constraints.landing: the telemetry has no landing position.")
        return models.LandingSite(fix.time, fix.position, np.diag(fix.position_sigma**2), planet)
    assert stated is not None
    enu = ellipsoid.enu_from_fixed(stated.latitude, stated.longitude)
    sigma = np.array([stated.horizontal_sigma, stated.horizontal_sigma, stated.vertical_sigma])
    time = _event(mission, telemetry, "landing", "landing")
    return models.LandingSite(time, stated.position, enu.T @ np.diag(sigma**2) @ enu, planet)


def _rest(mission: Mission, telemetry: Telemetry, samples: Samples, planet: Planet) -> list[models.Constraint]:
    """Rest: no velocity, and minus gravity on the accelerometers; in a flight file also rates on the gyros."""
    stated = mission.constraints.rest
    assert stated is not None
    if isinstance(stated, FromTelemetryConfig):
        if telemetry.landing is None:
            raise InputError(f"{mission.source}: constraints.rest: the telemetry has no landing.")
        start, end = telemetry.landing.time, float(samples.time[-1])
    else:
        start, end = stated.start_s, stated.end_s
    part = window(samples, start, end, "rest")
    end = float(part.time[-1])
    force_sigma = stated.velocity_sigma / (end - start)
    velocity_sigma = float(np.hypot(stated.velocity_sigma, _velocity_sigma_at_stop(telemetry.driving, start)))
    constraints: list[models.Constraint] = [models.RestVelocity(start, velocity_sigma, planet)]
    if isinstance(stated, FromTelemetryConfig):
        assert telemetry.landing is not None
        drift = _drift_covariance(telemetry.rest_force_sigma, end, telemetry.landing.position, planet)
        constraints.append(models.RestGravity(end, end - start, force_sigma, planet, drift))
        rate = part.interval @ part.mean_rate / part.interval.sum()
        rate_sigma = _sigma_of_mean(part.interval, part.rate_noise, part.rate_fill_sigma)
        constraints.append(models.RestRate(start, rate, rate_sigma, planet))
    elif stated.gravity_direction_sigma is not None:
        sigma = float(np.hypot(force_sigma, np.linalg.norm(mean(part)) * stated.gravity_direction_sigma))
        constraints.append(models.RestGravity(end, end - start, sigma, planet))
    return constraints


def _drift_covariance(sigma: tuple[float, float], time: float, position: Array, planet: Planet) -> Array:
    """Covariance (3, 3), m²/s⁴, inertial axes, of errors with a sigma along gravity and one across it.

    `position` is planet-fixed (m), `time` that of the inertial axes' vertical (s).
    """
    gravity = planet.rotation.to_inertial(time, planet.apparent_gravity(position))
    vertical = np.outer(gravity, gravity) / (gravity @ gravity)
    return sigma[0] ** 2 * vertical + sigma[1] ** 2 * (np.eye(3) - vertical)


def _velocity_sigma_at_stop(record: ImuRecord, time: float) -> float:
    """One sigma per axis (m/s) of the velocity of the centre of mass where the vehicle comes to rest at `time` (s).

    The specific force is moved to the centre of mass with rates at the samples' edges, which are interpolated between
    samples before and after the stop. The rate is the planet's there, which is below any instrument's noise. The
    interpolated rate times the lever arm is therefore an error of the propagated velocity, up to the fourth edge at
    rest (`EDGE_REACH`), behind which the interpolation contains samples at rest only.
    """
    edge = min(int(np.searchsorted(record.edges, time - SAME_TIME)), len(record) - 1)
    rate = edge_values(record.interval, record.angular_rate, np.diff(record.unit) != 0)[edge]
    return float(np.linalg.norm(rotations.cross(rate, record.position[edge])) / np.sqrt(3.0))


def _sigma_of_mean(interval: Array, noise: Array, fill_sigma: Array) -> float:
    """One sigma of the mean over samples with an interval (N,), s, and the noise (N, 3): largest axis.

    Some were filled in (N, 3).
    """
    increments = interval[:, None] ** 2 * (noise**2 + fill_sigma**2)
    return float(np.sqrt(np.max(np.sum(increments, axis=0))) / interval.sum())


def _altimeter(mission: Mission, telemetry: Telemetry) -> list[models.Constraint]:
    """Every reading up to the landing."""
    stated, record = mission.constraints.altimeter, telemetry.altimeter
    assert stated is not None
    if record is None:
        raise InputError(f"{mission.source}: constraints.altimeter: the telemetry has no altimeter.")
    end = telemetry.landing.time if telemetry.landing is not None else np.inf
    sigma = stated.sigma if stated.sigma is not None else record.sigma
    return [
        models.Altimeter(float(t), float(h), sigma, record.surface_radius)
        for t, h in zip(record.time, record.height, strict=True)
        if t <= end
    ]
