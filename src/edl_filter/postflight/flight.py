"""The post-flight layer over a reconstruction: from its trajectory, mission and telemetry to `derive`'s arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from edl_filter.aero.body import SphereCone
from edl_filter.aero.database import Database, load_database
from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.postflight.airdata import AirData
from edl_filter.postflight.derive import Derived, DeriveInputs, at_middles, derive
from edl_filter.postflight.gas import Gas
from edl_filter.postflight.windows import Window
from edl_filter.reconstruction import Reconstruction

#: Components of an air-data record that are taken at the samples' middles.
_ALONG = (
    "altitude",
    "speed",
    "velocity_body",
    "flight_path_angle",
    "altitude_sigma",
    "speed_sigma",
    "flight_path_angle_sigma",
    "alpha_total_sigma",
)


def derive_flight(reconstruction: Reconstruction, air: AirData) -> Derived | None:
    """Atmosphere and coefficients of a reconstructed entry, up to the parachute.

    Parameters
    ----------
    reconstruction : Reconstruction
    air : AirData
        Along its trajectory.

    Returns
    -------
    Derived or None
        None where the mission names no aerodynamic database.

    Raises
    ------
    InputError
        The mission has no inertia, or a table cannot be used.
    """
    mission = reconstruction.mission
    if mission.aerodynamics is None:
        return None
    if mission.vehicle.inertia is None:
        raise InputError(f"{mission.source}: vehicle.inertia: found nothing; aerodynamics needs it for the moments.")
    return derive(inputs(reconstruction, air))


def database(reconstruction: Reconstruction) -> Database:
    """Aerodynamic database of the mission."""
    mission = reconstruction.mission
    aero = mission.aerodynamics
    assert aero is not None
    return load_database(
        mission.aerodynamic_table("continuum"),
        mission.aerodynamic_table("rarefied"),
        continuum_limit=aero.continuum_limit,
        join=aero.join,
        family=aero.family,
        speed_per_mach=aero.velocity_per_mach,
        interpolation=aero.interpolation,
        body=_forebody(mission),
        base_pressure=aero.base_pressure,
        continuum_moment_point=aero.continuum_moment_point,
        rarefied_moment_point=aero.rarefied_moment_point,
    )


def _forebody(mission: Mission) -> SphereCone | None:
    """The forebody that the mission states, if it does."""
    shape = None if mission.aerodynamics is None else mission.aerodynamics.forebody
    if shape is None:
        return None
    try:
        return SphereCone(mission.vehicle.diameter, shape.nose_radius, shape.shoulder_radius, shape.cone_half_angle)
    except InputError as error:
        raise InputError(f"{mission.source}: aerodynamics.forebody: {error}") from None


def inputs(reconstruction: Reconstruction, air: AirData) -> DeriveInputs:
    """All that `derive` needs, at the middles of the samples.

    A sample's force and rate are means over its interval and stand for its middle; the trajectory, which is known at
    the intervals' ends, is brought there by splines.
    """
    mission, planet, trajectory = reconstruction.mission, reconstruction.planet, reconstruction.trajectory
    vehicle, atmosphere, samples = mission.vehicle, reconstruction.atmosphere, reconstruction.problem.samples
    assert vehicle.inertia is not None
    middle = {name: at_middles(air.time, getattr(air, name)) for name in _ALONG}
    u, v, w = middle["velocity_body"].T
    speed = np.sqrt(u * u + v * v + w * w)
    position = at_middles(trajectory.time, trajectory.position)
    parachute = reconstruction.event_times.get("parachute_deploy", float(trajectory.time[-1]))
    sensor = np.sqrt(np.diag(reconstruction.smoothed.covariance[0]))
    layout = reconstruction.forward.layout

    def left(name: str) -> NDArray[np.float64]:
        """One sigma of what is left of the first instrument's error."""
        return sensor[layout[name]] if name in layout else np.zeros(3)

    path, wind = middle["flight_path_angle"], mission.atmosphere.wind_sigma
    stated = mission.postflight.windows
    return DeriveInputs(
        time=samples.time - 0.5 * samples.interval,
        altitude=middle["altitude"],
        speed=speed,
        gravity=np.linalg.norm(planet.gravity(position), axis=1),
        velocity_body=middle["velocity_body"],
        alpha=np.arctan2(w, u),
        beta=np.arcsin(v / speed),
        alpha_total=np.arccos(np.clip(u / speed, -1.0, 1.0)),
        speed_sigma=middle["speed_sigma"],
        angle_sigma=np.hypot(middle["alpha_total_sigma"], wind / speed),
        altitude_sigma=middle["altitude_sigma"],
        sink_sigma=np.hypot(
            np.sin(path) * middle["speed_sigma"], speed * np.cos(path) * middle["flight_path_angle_sigma"]
        ),
        wind_sigma=wind * np.abs(np.cos(path)),
        specific_force=trajectory.specific_force[1:],
        angular_rate=trajectory.angular_rate[1:],
        force_noise=samples.force_noise,
        rate_noise=samples.rate_noise,
        bias_sigma=left("accelerometer_bias"),
        alignment_sigma=float(np.max(left("accelerometer_misalignment"))),
        mass=vehicle.mass,
        mass_sigma=vehicle.mass_sigma,
        diameter=vehicle.diameter,
        x_over_d=vehicle.centre_of_mass,
        offset=vehicle.centre_of_mass_offset,
        inertia=vehicle.inertia.tensor,
        inertia_relative=vehicle.inertia_sigma,
        gas=Gas(
            atmosphere.gas_constant,
            atmosphere.heat_capacity_ratio,
            mission.atmosphere.molecule_diameter,
            mission.atmosphere.molecule_mass,
        ),
        database=database(reconstruction),
        preflight_density=atmosphere.density(middle["altitude"]),
        preflight_temperature=atmosphere.temperature_at(middle["altitude"]),
        preflight_sigma=mission.atmosphere.density_sigma,
        # the batch that reaches the mortar's recoil would smear it over what comes before
        parachute=parachute - mission.postflight.batch_s,
        batch=mission.postflight.batch_s,
        top_temperature=mission.postflight.top_temperature,
        top_temperature_sigma=mission.postflight.top_temperature_sigma,
        windows=None if stated is None else tuple(Window(w.name, w.start_s, w.end_s) for w in stated),
    )
