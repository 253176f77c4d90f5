"""What events of the flight change in its telemetry: positions of the IMUs from the centre of mass, and its velocity.

The IMUs are fixed to the structure. Where the centre of mass moves by d, their positions from it change by -d, and the
navigated point, which is the centre of mass, changes from one material point to another: its velocity by ω × d, while
that of every IMU is continuous. Its position changes by d, a few centimetres at most, which no constraint resolves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.imu_model.lever_arm import edge_values
from edl_filter.mission import Mission
from edl_filter.mission.world import VehicleChangeConfig
from edl_filter.navigation.increments import Samples
from edl_filter.telemetry.record import ImuRecord, Telemetry
from edl_filter.types import Array


def changed_position(
    position: Array, name: str, time: Array, events: Iterable[tuple[float, VehicleChangeConfig]]
) -> Array:
    """Position of an IMU from the nominal centre of mass, with what events change in it.

    Parameters
    ----------
    position : (N, 3) array
        At entry, m, body axes.
    name : str
        Name of the IMU.
    time : (N,) array
        Middles of the samples, s.
    events : iterable of (time, event)
        In order of time, s.

    Returns
    -------
    (N, 3) array
        m.
    """
    for event_time, event in events:
        after = (time > event_time)[:, None]
        if event.centre_of_mass_shift is not None:
            position = np.where(after, position - np.array(event.centre_of_mass_shift), position)
        if name in event.imu_positions:
            position = np.where(after, np.array(event.imu_positions[name]), position)
    return position


def moved_by_events(mission: Mission, telemetry: Telemetry) -> Telemetry:
    """Telemetry of a flight file, which states positions at entry, with the positions that events leave.

    Raises
    ------
    InputError
        An event names an IMU that the telemetry does not have.
    """
    changes, records = mission.vehicle_changes(), (telemetry.driving, *telemetry.checking)
    names = [record.name for record in records]
    for name, event in mission.vehicle.events.items():
        for imu in event.imu_positions:
            if imu not in names:
                raise InputError(
                    f"{mission.source or mission.name}: vehicle.events.{name}.imu_positions: found {imu!r}; the flight "
                    f"file has {', '.join(names)}."
                )
    driving, *checking = (
        replace(r, position=changed_position(r.position, r.name, r.time - 0.5 * r.interval, changes)) for r in records
    )
    return replace(telemetry, driving=driving, checking=tuple(checking))


def centre_of_mass_shifts(mission: Mission, driving: ImuRecord) -> dict[float, Array]:
    """Displacement of the centre of mass (3,), m, body axes, by time, s: of events within the driving record.

    A flight file's mission states it; with MER's telemetry it is the change of the driving IMU's position, where the
    same instrument drives before and after the event. At a change of the instrument the navigated point is stated
    otherwise (`mer_flight`).
    """
    shifts, middle = {}, driving.time - 0.5 * driving.interval
    for time, event in mission.vehicle_changes():
        i = int(np.searchsorted(middle, time, side="right"))
        if not 0 < i < len(middle):
            continue
        if event.centre_of_mass_shift is not None:
            shifts[time] = np.array(event.centre_of_mass_shift)
        elif event.position is not None and driving.unit[i] == driving.unit[i - 1]:
            shifts[time] = driving.position[i - 1] - driving.position[i]
    return shifts


def with_velocity_steps(samples: Samples, shifts: Mapping[float, Array]) -> Samples:
    """Samples whose integration gains ``ω × d`` where the centre of mass moves by d.

    Parameters
    ----------
    samples : Samples
        Of the driving IMU.
    shifts : mapping of float to (3,) array
        Time (s) → displacement of the centre of mass, m, body axes.

    Returns
    -------
    Samples
        `force` of the first sample after each event has the step of velocity divided by its interval; `mean_force`,
        which aerodynamics uses, does not.
    """
    if not shifts:
        return samples
    force = samples.force.copy()
    rate = edge_values(samples.interval, samples.mean_rate, np.diff(samples.unit) != 0)
    for time, shift in shifts.items():
        i = int(np.searchsorted(samples.time - 0.5 * samples.interval, time, side="right"))
        # the force of a sample is in axes that half its rotation turned
        turn = rotations.from_rotation_vector(-0.5 * samples.interval[i] * samples.mean_rate[i])
        force[i] += rotations.rotate(turn, np.cross(rate[i], shift)) / samples.interval[i]
    return replace(samples, force=force)
