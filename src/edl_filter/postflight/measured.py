"""The database's coefficients as the sensors and the smoothing would show them.

Smoothing and differencing take a few percent from an oscillation. What is to be compared with the flight's
coefficients passes through the same: sensors' means, smoothing, and for moments Euler's equations in reverse.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edl_filter.postflight.atmosphere import FlightAtmosphere
from edl_filter.postflight.comparison import DatabaseCoefficients
from edl_filter.postflight.rates import Smoother

Array = NDArray[np.float64]


def as_measured(
    database: DatabaseCoefficients,
    atmosphere: FlightAtmosphere,
    filters: Smoother,
    rate: Array,
    speed: Array,
    mass: ArrayLike,
    diameter: float,
    inertia: Array,
) -> DatabaseCoefficients:
    """CN, CY, Cl, Cm and Cn through the flight's sampling, smoothing and differencing.

    Parameters
    ----------
    database : DatabaseCoefficients
    atmosphere : FlightAtmosphere
    filters : Smoother
        Of the same samples.
    rate : (N, 3) array
        Smoothed, rad/s: gives the gyroscopic part of the moments, which is not differenced.
    speed, mass, diameter, inertia
        As for the flight's coefficients.

    Returns
    -------
    DatabaseCoefficients
        Its CA, sigmas and flags as before. Where the database has no value within a batch, neither has the result.
    """
    area = np.pi / 4.0 * diameter**2
    q = 0.5 * atmosphere.density * speed**2
    per_force, per_moment = q * area / np.asarray(mass, float), q * area * diameter
    v = database.value
    missing = ~np.isfinite(v["CN"])
    lateral = np.stack((per_force * v["CN"], per_force * v["CY"]), axis=1)
    moment = np.stack((per_moment * v["Cl"], per_moment * v["Cm"], per_moment * v["Cn"]), axis=1)
    lateral[missing], moment[missing] = 0.0, 0.0
    gyroscopic = np.cross(rate, rate @ inertia.T)
    turn = (moment - gyroscopic) @ np.linalg.inv(inertia).T
    seen_moment = filters.as_derived(turn) @ inertia.T + gyroscopic
    seen_force = filters.as_smoothed(lateral)
    reach = 2 * filters.points
    near = np.convolve(missing, np.ones(int(reach.max()) + 1), mode="same") > 0.0 if missing.any() else missing
    value = {
        **v,
        "CN": np.where(near, np.nan, seen_force[:, 0] / per_force),
        "CY": np.where(near, np.nan, seen_force[:, 1] / per_force),
        "Cl": np.where(near, np.nan, seen_moment[:, 0] / per_moment),
        "Cm": np.where(near, np.nan, seen_moment[:, 1] / per_moment),
        "Cn": np.where(near, np.nan, seen_moment[:, 2] / per_moment),
    }
    return replace(database, value=value)
