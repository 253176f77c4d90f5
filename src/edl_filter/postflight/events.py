"""The state at every event of the flight, and the peak deceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.navigation.trajectory import Trajectory
from edl_filter.pipeline.load import event_time_sigma
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.postflight.airdata import AirData
from edl_filter.telemetry.clock import SclkClock
from edl_filter.telemetry.record import SAME_TIME, ImuRecord
from edl_filter.types import Array

#: Samples longer than this many median intervals are gaps, not measurements.
_GAP = 1.5


@dataclass(frozen=True)
class Event:
    """State at one event. Velocities are air-relative; the names carry the units, as tables for people do.

    Attributes
    ----------
    name : str
    time_s : float
        Since the epoch.
    sclk : float or None
        Spacecraft clock, s, where there is one.
    utc : str
    altitude_m, altitude_sigma_m : float
        Areodetic. This sigma and that of the velocity contain that of the event's time.
    height_above_site_m : float or None
        Distance from the planet's centre minus the landing site's.
    velocity_m_s, velocity_sigma_m_s : float
    mach, dynamic_pressure_pa : float
        With the preflight atmosphere.
    flight_path_deg, alpha_total_deg, alpha_total_sigma_deg : float
    acceleration_m_s2, acceleration_single_m_s2 : float or None
        Axial deceleration at the centre of mass, for the peak only: mean of two successive samples, and the largest
        single sample.
    """

    name: str
    time_s: float
    sclk: float | None
    utc: str
    altitude_m: float
    altitude_sigma_m: float
    height_above_site_m: float | None
    velocity_m_s: float
    velocity_sigma_m_s: float
    mach: float
    dynamic_pressure_pa: float
    flight_path_deg: float
    alpha_total_deg: float
    alpha_total_sigma_deg: float
    acceleration_m_s2: float | None = None
    acceleration_single_m_s2: float | None = None


@dataclass(frozen=True)
class Peak:
    """Largest axial deceleration before the parachute.

    Attributes
    ----------
    time : float
        Middle of the two samples, s.
    acceleration, single : float
        Mean of two successive samples, and the largest single one, m/s².
    """

    time: float
    acceleration: float
    single: float


def events(reconstruction: Reconstruction, air: AirData) -> dict[str, Event]:
    """All events within the trajectory, in order of time.

    ``entry_interface`` (time 0) and ``peak_deceleration`` are added to those of mission and telemetry.

    Parameters
    ----------
    reconstruction : Reconstruction
        With the times of mission and telemetry.
    air : AirData
        Along its trajectory.

    Returns
    -------
    dict
        Name → `Event`.
    """
    trajectory, telemetry = reconstruction.trajectory, reconstruction.telemetry
    times = {"entry_interface": 0.0} | reconstruction.event_times
    end = next((times[n] for n in ("parachute_deploy", "landing") if n in times), float(trajectory.time[-1]))
    peak = peak_deceleration(trajectory, telemetry.driving, end)
    if peak is not None:
        times["peak_deceleration"] = peak.time
    return {
        name: _event(name, time, reconstruction, air, peak if name == "peak_deceleration" else None)
        for name, time in sorted(times.items(), key=lambda item: item[1])
        if trajectory.time[0] - SAME_TIME <= time <= trajectory.time[-1] + SAME_TIME
    }


def peak_deceleration(trajectory: Trajectory, record: ImuRecord, end: float) -> Peak | None:
    """Largest axial deceleration at the centre of mass before `end` (s).

    The mean of two successive samples, because a single one has the noise and the oscillation of 0.125 s; gaps are not
    counted. None where there are no two adjoining samples.
    """
    inside = (record.time > trajectory.time[0] + SAME_TIME) & (record.time <= end + SAME_TIME)
    inside &= record.interval < _GAP * np.median(record.interval)
    # the trajectory's samples are the record's, some split in two: both parts have the mean of the whole sample
    index = np.searchsorted(trajectory.time, record.time[inside] - SAME_TIME)
    force = -trajectory.specific_force[np.minimum(index, len(trajectory.time) - 1), 0]
    time, interval = record.time[inside], record.interval[inside]
    adjoin = np.abs(np.diff(time) - interval[1:]) < SAME_TIME
    if not adjoin.any():
        return None
    mean = (force[:-1] * interval[:-1] + force[1:] * interval[1:]) / (interval[:-1] + interval[1:])
    k = int(np.argmax(np.where(adjoin, mean, -np.inf)))
    middle = time[k] + 0.5 * (interval[k + 1] - interval[k])
    return Peak(float(middle), float(mean[k]), float(force.max()))


def _event(name: str, time: float, reconstruction: Reconstruction, air: AirData, peak: Peak | None) -> Event:
    """State at `time`, s."""
    telemetry, site = reconstruction.telemetry, reconstruction.site_radius
    time_sigma = event_time_sigma(reconstruction.mission, telemetry, name)

    def at(values: Array) -> float:
        return float(np.interp(time, air.time, values))

    def sigma(values: Array, sigmas: Array) -> float:
        """One sigma of a value at the event, with that of the event's time, along the motion before the event."""
        step = at(values) - float(np.interp(time - time_sigma, air.time, values))
        return float(np.hypot(at(sigmas), step))

    return Event(
        name=name,
        time_s=time,
        sclk=None if telemetry.epoch_sclk is None else telemetry.epoch_sclk + time,
        utc=SclkClock(0.0, telemetry.epoch_utc).to_utc(time),
        altitude_m=at(air.altitude),
        altitude_sigma_m=sigma(air.altitude, air.altitude_sigma),
        height_above_site_m=None if site is None else at(air.radius) - site,
        velocity_m_s=at(air.speed),
        velocity_sigma_m_s=sigma(air.speed, air.speed_sigma),
        mach=at(air.mach),
        dynamic_pressure_pa=at(air.dynamic_pressure),
        flight_path_deg=float(np.rad2deg(at(air.flight_path_angle))),
        alpha_total_deg=float(np.rad2deg(at(air.alpha_total))),
        alpha_total_sigma_deg=float(np.rad2deg(at(air.alpha_total_sigma))),
        acceleration_m_s2=None if peak is None else peak.acceleration,
        acceleration_single_m_s2=None if peak is None else peak.single,
    )
