"""Landing of a reconstructed entry, and states of the flight, relative to the landing site."""

from __future__ import annotations

from typing import Any

import numpy as np

from edl_filter.estimation.series import interpolate_columns
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.planet import ellipsoid
from edl_filter.telemetry.record import SAME_TIME
from edl_filter.types import Array


def _enu(site: Array) -> Array:
    """East, north, up of a planet-fixed position, ``(3, 3)``; up is away from the planet's centre."""
    latitude, longitude, _ = ellipsoid.areocentric_from_fixed(site)
    return ellipsoid.enu_from_fixed(latitude, longitude)


def from_site(reconstruction: Reconstruction, time: float) -> dict[str, float]:
    """Position relative to the site and velocity relative to the ground at `time` (s), along the axes of the site."""
    site = reconstruction.site
    if site is None:
        return {}
    trajectory, rotation, enu = reconstruction.trajectory, reconstruction.planet.rotation, _enu(site)

    position = interpolate_columns(time, trajectory.time, trajectory.position)
    inertial = interpolate_columns(time, trajectory.time, trajectory.velocity)
    velocity = rotation.velocity_relative(position, inertial)
    local_position = enu @ (rotation.to_fixed(time, position) - site)
    local_velocity = enu @ rotation.to_fixed(time, velocity)
    axes = ("east", "north", "up")
    return {f"{axis}_m": float(value) for axis, value in zip(axes, local_position, strict=True)} | {
        f"velocity_{axis}_m_s": float(value) for axis, value in zip(axes, local_velocity, strict=True)
    }


def _miss(miss: Array, covariance: Array) -> dict[str, float]:
    """Horizontal distance and components (east, north, up), with sigmas.

    ``sigma_m`` is the root of the sum of the horizontal variances.
    """
    content = {
        "miss_m": float(np.hypot(miss[0], miss[1])),
        "sigma_m": float(np.sqrt(covariance[0, 0] + covariance[1, 1])),
    }
    for k, axis in enumerate(("east", "north", "up")):
        content |= {f"miss_{axis}_m": float(miss[k]), f"sigma_{axis}_m": float(np.sqrt(covariance[k, k]))}
    return content


def landing_sample(reconstruction: Reconstruction) -> tuple[int, bool]:
    """Index of the trajectory's state at the landing, and whether the vehicle landed within the record.

    The landing is that of the constraint, or the event. If there is neither, it is the end of the trajectory, where the
    vehicle has landed if a constraint states that it is at rest.
    """
    times = reconstruction.trajectory.time
    fused = {f.constraint.name: f.constraint.time for f in reconstruction.filter_pass.fused}
    time = fused.get("landing", reconstruction.event_times.get("landing", np.inf))
    landed = bool(time <= times[-1] + SAME_TIME)
    k = int(np.argmin(np.abs(times - time))) if landed else len(times) - 1
    return k, landed or "rest_velocity" in fused


def landing(reconstruction: Reconstruction) -> dict[str, Any]:
    """Landing position of the trajectory, its distance from the site, and that of the leave-one-out prediction.

    ``miss_m`` and ``sigma_m`` are horizontal. Sigmas are those of the trajectory, and in ``left_out`` those of
    prediction and site together. Without a known site there is no miss, nor if the record ends before the landing: the
    position is that at its end then.
    """
    trajectory, (k, landed) = reconstruction.trajectory, landing_sample(reconstruction)
    site = reconstruction.site if landed else None
    rotation = reconstruction.planet.rotation
    position = rotation.to_fixed(trajectory.time[k], trajectory.position[k])
    latitude, longitude, radius = ellipsoid.areocentric_from_fixed(position)
    enu = _enu(position if site is None else site)
    enu_from_inertial = rotation.to_inertial(trajectory.time[k], enu)
    covariance = (
        enu_from_inertial @ trajectory.covariance_at(trajectory.time[k : k + 1])[0, :3, :3] @ enu_from_inertial.T
    )
    content: dict[str, Any] = {
        "landed": landed,
        "time_s": float(trajectory.time[k]),
        "lat_deg": float(np.rad2deg(latitude)),
        "lon_deg": float(np.rad2deg(longitude)) % 360.0,
        "radius_m": float(radius),
        "miss_m": None,
        "sigma_m": float(np.sqrt(covariance[0, 0] + covariance[1, 1])),
    }
    if site is None:
        return content
    site_latitude, site_longitude, site_radius = ellipsoid.areocentric_from_fixed(site)
    content |= _miss(enu @ (position - site), covariance) | {
        "site_lat_deg": float(np.rad2deg(site_latitude)),
        "site_lon_deg": float(np.rad2deg(site_longitude)) % 360.0,
        "site_radius_m": float(site_radius),
    }
    for statement in (s for s in reconstruction.constraint_checks if s.name == "landing"):
        # left_out is measured minus predicted; a miss is predicted minus measured
        miss = _miss(-(enu @ statement.left_out), enu @ statement.left_out_covariance @ enu.T)
        content["left_out"] = miss | {"nis": statement.left_out_nis, "dof": statement.left_out_dof}
    return content
