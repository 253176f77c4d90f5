"""Inertial entry state from entry conditions."""

from __future__ import annotations

import numpy as np

from edl_filter import rotations
from edl_filter.planet import Planet, ellipsoid
from edl_filter.types import Array


def inertial_state(
    planet: Planet,
    radius: float,
    latitude: float,
    longitude: float,
    speed: float,
    flight_path_angle: float,
    azimuth: float,
) -> tuple[Array, Array]:
    """Inertial position and velocity at time 0.

    Parameters
    ----------
    planet : Planet
        Rotation at time 0.
    radius : float
        From the planet's centre, m.
    latitude, longitude : float
        Areocentric, rad, planet-fixed.
    speed : float
        Inertial, m/s.
    flight_path_angle : float
        Of the inertial velocity above the local horizontal (of the sphere), rad: negative downwards.
    azimuth : float
        Of the inertial velocity from north towards east, rad.

    Returns
    -------
    position, velocity : (3,) arrays
        m and m/s.
    """
    fixed = ellipsoid.fixed_from_areocentric(latitude, longitude, radius)
    enu = ellipsoid.enu_from_fixed(latitude, longitude + float(planet.rotation.angle(0.0)))
    level = np.cos(flight_path_angle)
    local = speed * np.array([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(flight_path_angle)])
    return planet.rotation.to_inertial(0.0, fixed), local @ enu


def attitude(air_velocity: Array, position: Array, alpha: float, beta: float, bank: float) -> Array:
    """Attitude from the angles of the air-relative velocity and a bank angle.

    Parameters
    ----------
    air_velocity, position : (3,) arrays
        Inertial components, m/s and m.
    alpha, beta : float
        ``alpha = atan2(w, u)``, ``beta = asin(v / V)``, rad.
    bank : float
        Rotation about the velocity, rad: at zero, with both angles zero, body z is in the vertical plane, downwards.

    Returns
    -------
    (4,) array
        ``inertial_from_body``, scalar last and not negative: without a rule rounding, which differs between processors,
        would choose between the two signs of the same attitude.
    """
    forward = air_velocity / np.linalg.norm(air_velocity)
    right = rotations.cross(-position, forward)
    right /= np.linalg.norm(right)
    wind = rotations.from_matrix(np.column_stack((forward, right, rotations.cross(forward, right))))
    turns = [rotations.from_rotation_vector(v) for v in ([bank, 0.0, 0.0], [0.0, 0.0, -beta], [0.0, alpha, 0.0])]
    out = wind
    for turn in turns:
        out = rotations.multiply(out, turn)
    return rotations.normalise(-out if out[3] < 0.0 else out)
