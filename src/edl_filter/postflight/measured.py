"""The database's coefficients through the sampling and smoothing of the flight's.

Smoothing and differencing attenuate an oscillation by a few percent. Coefficients that are compared with the flight's
go through the same operations: the sensors' means, smoothing, and for moments the inverse of Euler's equations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.conventions import reference_area
from edl_filter.postflight.atmosphere import AtmosphereProfile
from edl_filter.postflight.comparison import DatabaseCoefficients
from edl_filter.postflight.moments import tensor_product
from edl_filter.postflight.rates import BatchSmoother
from edl_filter.types import Array


def as_measured(
    database: DatabaseCoefficients,
    atmosphere: AtmosphereProfile,
    smoother: BatchSmoother,
    rate: Array,
    speed: Array,
    mass: ArrayLike,
    diameter: float,
    inertia: Array,
) -> DatabaseCoefficients:
    """The six coefficients through the flight's sampling, smoothing and differencing.

    Parameters
    ----------
    database : DatabaseCoefficients
        At the reconstructed angles.
    atmosphere : AtmosphereProfile
        Density along the flight.
    smoother : BatchSmoother
        Of the same samples.
    rate : (N, 3) array
        Smoothed, rad/s: gives the gyroscopic part of the moments, which is not differenced.
    speed : (N,) array
        Air-relative, m/s.
    mass : float or (N,) array
        kg.
    diameter : float
        m.
    inertia : (3, 3) or (N, 3, 3) array
        kg m².

    Returns
    -------
    DatabaseCoefficients
        Sigmas and flags are those of `database`. NaN where the database is NaN within a batch.
    """
    area = reference_area(diameter)
    q = 0.5 * atmosphere.density * speed**2
    per_force, per_moment = q * area / np.asarray(mass, float), q * area * diameter
    v = database.value
    missing = ~np.isfinite(v["CN"])
    force = np.stack([per_force * v[name] for name in ("CA", "CN", "CY")], axis=1)
    moment = np.stack((per_moment * v["Cl"], per_moment * v["Cm"], per_moment * v["Cn"]), axis=1)
    force[missing], moment[missing] = 0.0, 0.0
    gyroscopic = np.cross(rate, tensor_product(inertia, rate))
    acceleration = tensor_product(np.asarray(np.linalg.inv(inertia), np.float64), moment - gyroscopic)
    smoothed_moment = tensor_product(inertia, smoother.as_derived(acceleration)) + gyroscopic
    smoothed_force = smoother.as_smoothed(force)
    reach = 2 * smoother.points
    near = np.convolve(missing, np.ones(int(reach.max()) + 1), mode="same") > 0.0 if missing.any() else missing
    value = {
        "CA": np.where(near, np.nan, smoothed_force[:, 0] / per_force),
        "CN": np.where(near, np.nan, smoothed_force[:, 1] / per_force),
        "CY": np.where(near, np.nan, smoothed_force[:, 2] / per_force),
        "Cl": np.where(near, np.nan, smoothed_moment[:, 0] / per_moment),
        "Cm": np.where(near, np.nan, smoothed_moment[:, 1] / per_moment),
        "Cn": np.where(near, np.nan, smoothed_moment[:, 2] / per_moment),
    }
    return replace(database, value=value)
