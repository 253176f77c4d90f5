"""Air-relative state along a trajectory, with sigmas from the covariance of the navigation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edl_filter import rotations
from edl_filter.aero.conventions import attack_and_sideslip, total_angle
from edl_filter.effects.adapters import AtmosphereWithEffects, atmosphere_with_effects
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.forward_model import compose_air_rotation
from edl_filter.navigation.trajectory import Trajectory
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.types import Array

#: Upper bounds of the sigma of an angle, rad: that of a uniform distribution over a full and over half a turn.
_FULL_TURN, _HALF_TURN = 2.0 * np.pi / np.sqrt(12.0), np.pi / np.sqrt(12.0)
#: Lower bound of the air-relative speed (m/s), or of its fraction, in the derivatives of angles.
_LEAST = 1e-9
#: Half the step of the central difference for the slope of an effect's wind, m.
_STEP = 5.0


@dataclass(frozen=True)
class AirData:
    """Position and air-relative state, ``(N,)`` each unless stated otherwise.

    Attributes
    ----------
    time : (N,) array
        s since the epoch.
    latitude, longitude, altitude : arrays
        Areodetic, rad and m.
    areocentric_latitude : array
        rad.
    radius : array
        Distance from the planet's centre, m.
    velocity_body : (N, 3) array
        Velocity u, v, w relative to the air, which rotates with the planet and has winds; body axes, m/s.
    speed : array
        Air-relative, m/s.
    flight_path_angle, azimuth : array
        Of the air-relative velocity, rad: above the local areodetic horizontal, and from north towards east.
    alpha, beta, alpha_total : arrays
        ``atan2(w, u)``, ``asin(v/V)`` and ``acos(u/V)``, rad.
    density, mach, dynamic_pressure : arrays
        With the preflight atmosphere: kg/m³, 1, Pa.
    altitude_sigma, speed_sigma, flight_path_angle_sigma, alpha_sigma, beta_sigma, alpha_total_sigma : arrays
        One sigma due to the trajectory's covariance alone, without the errors of winds and density.
    """

    time: Array
    latitude: Array
    longitude: Array
    altitude: Array
    areocentric_latitude: Array
    radius: Array
    velocity_body: Array
    speed: Array
    flight_path_angle: Array
    azimuth: Array
    alpha: Array
    beta: Array
    alpha_total: Array
    density: Array
    mach: Array
    dynamic_pressure: Array
    altitude_sigma: Array
    speed_sigma: Array
    flight_path_angle_sigma: Array
    alpha_sigma: Array
    beta_sigma: Array
    alpha_total_sigma: Array


def air_data(
    trajectory: Trajectory, planet: Planet, atmosphere: Atmosphere, effects: Sequence[EffectInstance] = ()
) -> AirData:
    """Air-relative state along a trajectory (design section 2 for the angles).

    Parameters
    ----------
    trajectory : Trajectory
        Of N samples.
    planet : Planet
        Shape and rotation.
    atmosphere : Atmosphere
        Winds, preflight density and speed of sound.
    effects : sequence of EffectInstance
        Their winds, densities and rotation of the air are added.

    Returns
    -------
    AirData
    """
    time, position = trajectory.time, trajectory.position
    atmosphere, air_planet = atmosphere_with_effects(atmosphere, effects), compose_air_rotation(planet, effects)
    latitude, longitude, altitude = planet.geodetic(time, position)
    enu = planet.enu_at(time, latitude, longitude)
    without_wind = air_planet.velocity_relative(position, trajectory.velocity)
    local = np.einsum("nij,nj->ni", enu, without_wind)
    local[:, :2] -= atmosphere.wind_at(altitude)
    air = np.einsum("nji,nj->ni", enu, local)
    body = rotations.rotate(rotations.conjugate(trajectory.inertial_from_body), air)
    speed = np.linalg.norm(local, axis=1)
    alpha, beta = attack_and_sideslip(body)
    density = atmosphere.density(altitude)
    radius = np.linalg.norm(position, axis=1)
    sigma = _sigmas(trajectory, air_planet, atmosphere, enu, altitude, air, body)
    return AirData(
        time=time,
        latitude=latitude,
        longitude=longitude,
        altitude=altitude,
        areocentric_latitude=np.arcsin(position[:, 2] / radius),
        radius=radius,
        velocity_body=body,
        speed=speed,
        flight_path_angle=np.arctan2(local[:, 2], np.hypot(local[:, 0], local[:, 1])),
        azimuth=np.arctan2(local[:, 0], local[:, 1]),
        alpha=alpha,
        beta=beta,
        alpha_total=total_angle(body),
        density=density,
        mach=speed / atmosphere.speed_of_sound(altitude),
        dynamic_pressure=0.5 * density * speed**2,
        altitude_sigma=sigma[:, 0],
        speed_sigma=sigma[:, 1],
        flight_path_angle_sigma=np.minimum(sigma[:, 2], _HALF_TURN),
        alpha_sigma=np.minimum(sigma[:, 3], _FULL_TURN),
        beta_sigma=np.minimum(sigma[:, 4], _HALF_TURN),
        alpha_total_sigma=np.minimum(sigma[:, 5], _HALF_TURN),
    )


def wind_shear(atmosphere: Atmosphere, altitude: Array) -> Array:
    """Derivative of the wind by altitude, of the table and of effects.

    Parameters
    ----------
    atmosphere : Atmosphere
        With or without effects.
    altitude : (N,) array
        Areodetic, m.

    Returns
    -------
    (N, 2) array
        Towards east and north, 1/s.
    """
    step = np.diff(atmosphere.wind, axis=0) / np.diff(atmosphere.altitude)[:, None]
    k = np.searchsorted(atmosphere.altitude, altitude, side="right") - 1
    inside = (k >= 0) & (k < len(step))
    slope = np.where(inside[:, None], step[np.clip(k, 0, len(step) - 1)], 0.0)
    if isinstance(atmosphere, AtmosphereWithEffects):
        above, below = atmosphere.added_wind(altitude + _STEP), atmosphere.added_wind(altitude - _STEP)
        slope = slope + (above - below) / (2.0 * _STEP)
    return slope


def _sigmas(
    trajectory: Trajectory,
    planet: Planet,
    atmosphere: Atmosphere,
    enu: Array,
    altitude: Array,
    air: Array,
    body: Array,
) -> Array:
    """One sigma of altitude, speed, flight-path angle, alpha, beta and alpha_total: ``(N, 6)``.

    Linear in the error (position, velocity, inertial rotation vector φ of the attitude): the air-relative velocity a
    changes by ``δv - ω × δr`` minus the change of the wind with altitude, its body components by ``Cᵀ (δa + a × φ)``.
    The rotation of the local axes by a position error is included in the flight-path angle and neglected in the wind
    (wind / radius: 1e-5 1/s).
    """
    up = enu[:, 2]
    shear = np.einsum("nij,ni->nj", enu[:, :2], wind_shear(atmosphere, altitude))
    spin = rotations.cross_matrix(np.array([0.0, 0.0, planet.rotation_rate]))
    # gradients of the air-relative velocity, inertial axes, by position and velocity: (N, 3, 6)
    by_state = np.concatenate(
        (-spin - shear[:, :, None] * up[:, None, :], np.broadcast_to(np.eye(3), (len(up), 3, 3))), axis=2
    )
    speed = np.maximum(np.linalg.norm(air, axis=1), _LEAST)
    gradient = np.zeros((len(up), 6, 9))
    gradient[:, 0, :3] = up
    gradient[:, 1, :6] = np.einsum("ni,nij->nj", air / speed[:, None], by_state)
    gradient[:, 2, :6] = _flight_path_gradient(trajectory, up, air, speed, by_state, gradient[:, 1, :6])
    body_from_inertial = np.swapaxes(rotations.to_matrix(trajectory.inertial_from_body), 1, 2)
    by_all = np.concatenate((by_state, rotations.cross_matrix(air)), axis=2)
    gradient[:, 3:] = _angle_gradients(body, speed) @ (body_from_inertial @ by_all)
    variance = np.sum((gradient @ trajectory.covariance) * gradient, axis=2)
    return np.sqrt(np.maximum(variance, 0.0))


def _flight_path_gradient(
    trajectory: Trajectory, up: Array, air: Array, speed: Array, by_state: Array, by_speed: Array
) -> Array:
    """Gradient of the flight-path angle ``asin(a·up / V)`` by position and velocity, ``(N, 6)``."""
    climb = np.einsum("ni,ni->n", air, up)
    level = air - climb[:, None] * up
    cosine = np.maximum(np.linalg.norm(level, axis=1), _LEAST * speed)
    gradient = np.einsum("ni,nij->nj", up, by_state)
    gradient[:, :3] += level / np.linalg.norm(trajectory.position, axis=1)[:, None]
    return (gradient - (climb / speed)[:, None] * by_speed) / cosine[:, None]


def _angle_gradients(body: Array, speed: Array) -> Array:
    """Gradients of alpha, beta and alpha_total by u, v and w: ``(N, 3, 3)``."""
    u, v, w = body.T
    pitch = np.maximum(u * u + w * w, (_LEAST * speed) ** 2)
    lateral = np.maximum(np.hypot(v, w), _LEAST * speed)
    square = speed**2
    zero = np.zeros_like(u)
    alpha = np.stack((-w / pitch, zero, u / pitch), axis=-1)
    beta = np.stack((-u * v, pitch, -v * w), axis=-1) / (square * np.sqrt(pitch))[:, None]
    total = np.stack((-lateral, u * v / lateral, u * w / lateral), axis=-1) / square[:, None]
    return np.stack((alpha, beta, total), axis=1)
