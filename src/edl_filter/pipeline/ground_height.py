"""Height of the vehicle at rest above the surface to which its altimeter's heights refer: it is that surface.

Input: a reconstruction with an altimeter and a landing. An error that all heights have in common, an offset or late
times while the vehicle descends at a constant speed, moves the whole path with it, and no reading is rejected. The
landing site contradicts it only beyond its own sigma, of three axes. But the vehicle comes to rest on the ground that
the altimeter measures, so that the smoothed height at the landing is zero, up to the relief between the place of the
landing and the ground below the readings (`AltimeterFromTelemetryConfig.relief_sigma`). Output: that height with its
sigma.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.navigation.consensus import quantile
from edl_filter.navigation.constraints import Altimeter
from edl_filter.pipeline.reconstruct import Reconstruction


@dataclass(frozen=True)
class HeightAtRest:
    """Height at rest above the surface of the altimeter.

    Attributes
    ----------
    height : float
        m.
    sigma : float
        One sigma of the height and of the relief, m.
    significant : bool
        Whether it is beyond the gate of the mission's filter.
    """

    height: float
    sigma: float
    significant: bool


def height_at_rest(reconstruction: Reconstruction) -> HeightAtRest | None:
    """Height at the landing; None without an altimeter that is used, or without a landing.

    Parameters
    ----------
    reconstruction : Reconstruction
        With its smoothed states.

    Returns
    -------
    HeightAtRest or None
    """
    r = reconstruction
    stated = r.mission.constraints.altimeter
    surface = next((c.surface_radius for c in r.problem.constraints if isinstance(c, Altimeter)), None)
    landing = r.event_times.get("landing", None if r.telemetry.landing is None else r.telemetry.landing.time)
    if stated is None or surface is None or landing is None or not r.smoothed.time[0] <= landing <= r.smoothed.time[-1]:
        return None
    node = int(np.argmin(np.abs(r.smoothed.time - landing)))
    position = r.smoothed.states[node].nav[:3]
    radius = float(np.linalg.norm(position))
    up = position / radius
    variance = float(up @ r.smoothed.covariance[node][:3, :3] @ up) + stated.relief_sigma**2
    height = radius - surface
    gate = quantile(r.problem.settings.gate_probability, 1)
    return HeightAtRest(height, float(np.sqrt(variance)), height**2 > gate * variance)
