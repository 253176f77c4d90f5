"""Contents of a result: every group, every variable, its dimensions, unit and meaning."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from edl_filter._version import __version__
from edl_filter.mission.measurements import MerImuConfig
from edl_filter.pipeline.entry_state import in_j2000
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.pipeline.trust import Trust
from edl_filter.postflight.airdata import AirData
from edl_filter.postflight.events import Event
from edl_filter.postflight.flight import DerivedQuantities
from edl_filter.results.estimates import (
    add_comparison,
    add_constraints,
    add_entry,
    add_nodes,
    add_sensor_errors,
)
from edl_filter.results.files import finite
from edl_filter.results.groups import Attributes, Group, Groups
from edl_filter.results.netcdf import FORMAT, FORMAT_VERSION
from edl_filter.results.postflight import add_postflight
from edl_filter.results.summary import RefitSummary, effects_content
from edl_filter.telemetry.clock import SclkClock
from edl_filter.telemetry.record import SAME_TIME, ImuRecord
from edl_filter.types import AXES, QUATERNION, Array, IntArray

_LIBRARIES = ("numpy", "scipy", "numba", "filterpy", "xarray", "h5netcdf")
#: NAIF's numbers of the spacecraft, by the numbers of the MER project.
_NAIF_MER = {1: -253, 2: -254}
STATE = tuple(f"{what}_{a}" for what in ("position", "velocity", "attitude") for a in AXES)

#: Air data: field → unit, meaning. The names are those of `AirData`.
AIR = {
    "latitude": ("rad", "areodetic latitude, north"),
    "longitude": ("rad", "longitude, east"),
    "altitude": ("m", "areodetic altitude"),
    "areocentric_latitude": ("rad", "areocentric latitude, north"),
    "radius": ("m", "distance from the planet's centre"),
    "speed": ("m/s", "air-relative speed"),
    "flight_path_angle": ("rad", "air-relative flight-path angle, positive up"),
    "azimuth": ("rad", "air-relative azimuth, from north towards east"),
    "alpha": ("rad", "angle of attack, atan2(w, u)"),
    "beta": ("rad", "sideslip angle, asin(v / V)"),
    "alpha_total": ("rad", "total angle of attack, acos(u / V)"),
    "density": ("kg/m^3", "density of the preflight atmosphere"),
    "mach": ("1", "Mach number, preflight atmosphere"),
    "dynamic_pressure": ("Pa", "dynamic pressure, preflight density"),
    "altitude_sigma": ("m", "one sigma of the altitude"),
    "speed_sigma": ("m/s", "one sigma of the air-relative speed"),
    "flight_path_angle_sigma": ("rad", "one sigma of the flight-path angle"),
    "alpha_sigma": ("rad", "one sigma of the angle of attack"),
    "beta_sigma": ("rad", "one sigma of the sideslip angle"),
    "alpha_total_sigma": ("rad", "one sigma of the total angle of attack"),
}
#: Events: field of `Event` → unit, meaning.
EVENT = {
    "time_s": ("s", "time since the epoch"),
    "sclk": ("s", "spacecraft clock"),
    "altitude_m": ("m", "areodetic altitude"),
    "altitude_sigma_m": ("m", "one sigma of the altitude"),
    "height_above_site_m": ("m", "distance from the planet's centre minus the landing site's"),
    "velocity_m_s": ("m/s", "air-relative speed"),
    "velocity_sigma_m_s": ("m/s", "one sigma of the air-relative speed"),
    "mach": ("1", "Mach number, preflight atmosphere"),
    "dynamic_pressure_pa": ("Pa", "dynamic pressure, preflight density"),
    "flight_path_deg": ("deg", "air-relative flight-path angle, positive up"),
    "alpha_total_deg": ("deg", "total angle of attack"),
    "alpha_total_sigma_deg": ("deg", "one sigma of the total angle of attack"),
    "acceleration_m_s2": ("m/s^2", "largest axial deceleration, mean of two successive samples"),
    "acceleration_single_m_s2": ("m/s^2", "largest axial deceleration of one sample"),
}


def content(reconstruction: Reconstruction, derived: DerivedQuantities, refit: RefitSummary, trust: Trust) -> Groups:
    """All groups of a result: path → `Group`."""
    telemetry = reconstruction.telemetry
    groups: Groups = {"/": Group(attrs=_root(reconstruction, refit, trust))}
    groups["/trajectory"] = _trajectory(reconstruction, derived.air)
    groups["/imu/driving"] = _imu(reconstruction, telemetry.driving)
    _add_corrected(groups["/imu/driving"], reconstruction)
    for record in telemetry.checking:
        groups[f"/imu/{record.name}"] = _imu(reconstruction, record)
    if telemetry.attitude is not None:
        groups["/attitude"] = _attitude(reconstruction)
    add_sensor_errors(groups, reconstruction)
    add_constraints(groups, reconstruction.constraint_checks, reconstruction.filter_pass.fused)
    add_entry(groups, reconstruction.entry, in_j2000(reconstruction.mission, reconstruction.entry.rotation))
    add_comparison(groups, reconstruction.comparison)
    groups["/events"] = _events(derived.events)
    add_nodes(groups, reconstruction.filter_pass.layout, reconstruction.smoothed)
    if derived.postflight is not None:
        add_postflight(groups, derived.postflight)
    return groups


def _root(reconstruction: Reconstruction, refit: RefitSummary, trust: Trust) -> Attributes:
    mission, telemetry = reconstruction.mission, reconstruction.telemetry
    j2000 = mission.planet.j2000_from_inertial_matrix
    naif = _NAIF_MER.get(mission.telemetry.spacecraft) if isinstance(mission.telemetry, MerImuConfig) else None
    optional = {
        "epoch_sclk": telemetry.epoch_sclk,
        "site_radius": reconstruction.site_radius,
        "j2000_from_inertial": None if j2000 is None else np.ravel(j2000),
        "naif_spacecraft_id": naif,
        "mission_file": None if mission.source is None else str(mission.source.absolute()),
    }
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "Conventions": "CF-1.11",
        "title": mission.title or mission.name,
        "mission": mission.name,
        "mission_yaml": mission.text,
        "effects": json.dumps(finite(effects_content(reconstruction, refit.sigma))),
        "residuals": json.dumps(finite(refit.residuals)),
        "trust": json.dumps({"trustworthy": trust.trustworthy, "headline": trust.headline}),
        "planet": mission.planet.name,
        "edl_filter_version": __version__,
        "versions": json.dumps({name: _version(name) for name in _LIBRARIES}),
        "input_sha256": json.dumps(telemetry.files),
        "notes": json.dumps(telemetry.notes),
        "epoch_utc": telemetry.epoch_utc,
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
    } | {key: value for key, value in optional.items() if value is not None}


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "unknown"


def _timed(reconstruction: Reconstruction, time: Array) -> Group:
    """Group with the three times."""
    group, telemetry = Group(), reconstruction.telemetry
    group.add("time", ("time",), time, "s", "time since the epoch")
    if telemetry.epoch_sclk is not None:
        group.add("sclk", ("time",), telemetry.epoch_sclk + time, "s", "spacecraft clock")
    utc = SclkClock(0.0, telemetry.epoch_utc).to_datetime64(time).astype(np.int64)
    group.add("utc", ("time",), utc, "microseconds since 1970-01-01 00:00:00", "UTC", calendar="standard")
    group.label("axis", AXES, "axis")
    return group


def _trajectory(reconstruction: Reconstruction, air: AirData) -> Group:
    t = reconstruction.trajectory
    group, vector = _timed(reconstruction, t.time), ("time", "axis")
    group.label("quaternion", QUATERNION, "part of a quaternion, scalar last")
    group.label("state", STATE, "navigation state: m, m/s, rad; attitude error about inertial axes")
    group.label("state_2", STATE, "navigation state")
    group.add("position", vector, t.position, "m", "position, inertial axes")
    group.add("velocity", vector, t.velocity, "m/s", "velocity, inertial axes")
    group.add("inertial_from_body", ("time", "quaternion"), t.inertial_from_body, "1", "attitude, body to inertial")
    sigma = np.sqrt(np.diagonal(t.covariance, axis1=1, axis2=2))
    group.add("position_sigma", vector, sigma[:, :3], "m", "one sigma of the position, inertial axes")
    group.add("velocity_sigma", vector, sigma[:, 3:6], "m/s", "one sigma of the velocity, inertial axes")
    group.add("attitude_sigma", vector, sigma[:, 6:], "rad", "one sigma of the attitude, inertial axes")
    group.add("covariance", ("time", "state", "state_2"), t.covariance, "1", "covariance of the state")
    group.add(
        "specific_force", vector, t.specific_force, "m/s^2",
        "specific force at the centre of mass, body axes, sensor errors removed, mean over the sample",
    )  # fmt: skip
    group.add(
        "angular_rate", vector, t.angular_rate, "rad/s",
        "angular rate, body axes, sensor errors removed, mean over the sample",
    )  # fmt: skip
    group.add("velocity_body", vector, air.velocity_body, "m/s", "air-relative velocity u, v, w, body axes")
    for name, (unit, meaning) in AIR.items():
        group.add(name, ("time",), getattr(air, name), unit, meaning)
    return group


def _imu(reconstruction: Reconstruction, record: ImuRecord) -> Group:
    group, vector = _timed(reconstruction, record.time), ("time", "axis")
    group.add("interval", ("time",), record.interval, "s", "length of the interval that ends at time")
    group.add("specific_force_measured", vector, record.specific_force, "m/s^2", "as measured, body axes, at position")
    group.add("angular_rate_measured", vector, record.angular_rate, "rad/s", "as measured, body axes")
    group.add("position", vector, record.position, "m", "accelerometers from the centre of mass, body axes")
    for name, index, names in (("unit", record.unit, record.units), ("source", record.source, record.sources)):
        meaning = {"unit": "instrument", "source": "product that the sample came from"}[name]
        _flags(group, name, index, names, meaning)
    return group


def _flags(group: Group, name: str, index: IntArray, names: tuple[str, ...], meaning: str) -> None:
    group.add(
        name, ("time",), index.astype(np.int8), "1", meaning,
        flag_values=np.arange(len(names), dtype=np.int8),
        flag_meanings=" ".join(n.replace(" ", "_") for n in names),
    )  # fmt: skip


def _add_corrected(group: Group, reconstruction: Reconstruction) -> None:
    """Corrected force and rate of the driving record; NaN before and after the trajectory."""
    record, t = reconstruction.telemetry.driving, reconstruction.trajectory
    index = np.clip(np.searchsorted(t.time, record.time - SAME_TIME), 0, len(t.time) - 1)
    inside = (np.abs(t.time[index] - record.time) < 1e-5) & (record.time > t.time[0] + SAME_TIME)
    for name, unit, values, place in (
        ("specific_force", "m/s^2", t.specific_force, " at the centre of mass"),
        ("angular_rate", "rad/s", t.angular_rate, ""),
    ):
        corrected = np.where(inside[:, None], values[index], np.nan)
        meaning = f"{name.replace('_', ' ')}{place}, body axes, sensor errors removed"
        group.add(name, ("time", "axis"), corrected, unit, meaning)


def _attitude(reconstruction: Reconstruction) -> Group:
    record = reconstruction.telemetry.attitude
    assert record is not None
    group = _timed(reconstruction, record.time)
    group.label("quaternion", QUATERNION, "part of a quaternion, scalar last")
    group.add(
        "inertial_from_body", ("time", "quaternion"), record.inertial_from_body, "1",
        "attitude computed on board, body to inertial",
    )  # fmt: skip
    group.add("sigma", ("time",), record.sigma, "rad", "one sigma of one sample about each axis")
    _flags(group, "unit", record.unit, record.units, "instrument whose gyros were integrated")
    return group


def _events(events: dict[str, Event]) -> Group:
    group = Group()
    group.label("event", list(events), "event")
    for name, (unit, meaning) in EVENT.items():
        values = [getattr(event, name) for event in events.values()]
        if any(value is not None for value in values):
            numbers = [np.nan if value is None else value for value in values]
            group.add(name, ("event",), numbers, unit, meaning)
    group.text("utc", "event", [event.utc for event in events.values()], "UTC")
    return group
