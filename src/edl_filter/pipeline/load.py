"""What a mission names: its telemetry, with what events of the flight change in it, and the preflight atmosphere.

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
from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.imu_model.lever_arm import edge_values
from edl_filter.io.csv_table import package_data
from edl_filter.mission import Mission
from edl_filter.mission.measurements import FlightFileConfig, MerImuConfig
from edl_filter.mission.world import GasConstantsConfig, GasMixtureConfig, VehicleChangeConfig
from edl_filter.navigation.increments import Samples
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.planet.gas import NAMED_GASES, Gas, gas_of_constants, mixture
from edl_filter.telemetry.fetch import find_mer_imu
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.mer_archive import read_mer_tables
from edl_filter.telemetry.mer_compact import FILE_NAMES
from edl_filter.telemetry.mer_flight import MerImu, MerSetup, mer_telemetry
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, Telemetry
from edl_filter.telemetry.rest_drift import with_rest_drift
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.telemetry.sample_filling import PARACHUTE_MARGIN
from edl_filter.telemetry.sample_repair import repaired
from edl_filter.telemetry.triad_delay import with_triad_delay
from edl_filter.types import Array


def read_telemetry(mission: Mission) -> Telemetry:
    """Telemetry of a mission, in body axes and seconds since its epoch.

    Raises
    ------
    InputError
        The file is missing or invalid.
    """
    path, checks = mission.telemetry_path(), check_settings(mission)
    if isinstance(mission.telemetry, FlightFileConfig):
        assert path is not None
        return prepare_telemetry(mission, read_flight_file(path, checks), str(path))
    assert isinstance(mission.telemetry, MerImuConfig)  # telemetry_path stops the others
    spacecraft = mission.telemetry.spacecraft
    if path is None:
        path = find_mer_imu(spacecraft) or package_data(FILE_NAMES[spacecraft])
    return _repaired(mission, mer_telemetry(read_mer_tables(path, spacecraft), mer_setup(mission), checks), checks)


def prepare_telemetry(mission: Mission, telemetry: Telemetry, label: str) -> Telemetry:
    """Telemetry of a flight file as a mission uses it: its driving IMU, its vehicle's events, lost samples filled.

    Parameters
    ----------
    mission : Mission
        With telemetry of format flight-file.
    telemetry : Telemetry
        As read from the file, with the thresholds of `check_settings`.
    label : str
        Name of the file in messages.

    Raises
    ------
    InputError
        The flight is of another planet, or has no IMU of the name that the mission states.
    """
    assert isinstance(mission.telemetry, FlightFileConfig)
    if telemetry.planet.lower() != mission.planet.name.lower():
        raise InputError(
            f"{label}: the flight is of {telemetry.planet}, the mission's planet is {mission.planet.name}."
        )
    if mission.telemetry.driving is not None:
        telemetry = driven_by(telemetry, mission.telemetry.driving)
    return _repaired(mission, moved_by_events(mission, telemetry), check_settings(mission))


def event_time_sigma(mission: Mission, telemetry: Telemetry, name: str) -> float:
    """One sigma of the time of an event, s: that of the mission if it states the event, else that of the telemetry."""
    stated = mission.vehicle.events.get(name)
    return telemetry.event_sigmas.get(name, 0.0) if stated is None else stated.sigma_s


def event_times(mission: Mission, telemetry: Telemetry) -> dict[str, float]:
    """Events of a flight and their times, s: those of the telemetry, and of the mission, which replace them.

    Raises
    ------
    InputError
        The landing is not after the deployment of the parachute.
    """
    times = telemetry.events | mission.event_times()
    deployment, landing = times.get("parachute_deploy", -np.inf), times.get("landing", np.inf)
    if landing <= deployment:
        raise InputError(
            f"{mission.source or mission.name}: events: found the landing at {landing:g} s and parachute_deploy at "
            f"{deployment:g} s; expected the landing after the deployment."
        )
    return times


def _repaired(mission: Mission, telemetry: Telemetry, checks: CheckSettings) -> Telemetry:
    if checks.enabled:
        telemetry = with_rest_drift(telemetry)
    with one_blas_thread():  # regressions of a few columns
        parachute = event_times(mission, telemetry).get("parachute_deploy", np.inf)
        telemetry = repaired(telemetry, checks, parachute)
        if not checks.enabled or mission.vehicle.inertia is None:
            return telemetry
        return with_triad_delay(telemetry, mission.vehicle.inertia.tensor, parachute - PARACHUTE_MARGIN)


def check_settings(mission: Mission) -> CheckSettings:
    """Thresholds of the checks of samples, from the mission."""
    stated = mission.sample_checks
    return CheckSettings(
        stated.enabled,
        stated.spike_sigmas,
        stated.disagreement_sigmas,
        stated.false_alarm_probability,
        stated.longest_gap_s,
    )


def driven_by(telemetry: Telemetry, name: str) -> Telemetry:
    """The same telemetry with the IMU called `name` driving and all others checking.

    Raises
    ------
    InputError
        There is no such IMU.
    """
    records = {record.name: record for record in (telemetry.driving, *telemetry.checking)}
    if name not in records:
        raise InputError(f"telemetry.driving: found '{name}'; the flight file has {', '.join(records)}.")
    driving = records.pop(name)
    return replace(telemetry, driving=driving, checking=tuple(records.values()))


def mer_setup(mission: Mission) -> MerSetup:
    """Inputs from the mission for the reader of a rover's tables.

    Raises
    ------
    InputError
        The mission does not state the backshell's separation, or the inertial frame's orientation.
    """
    telemetry = mission.telemetry
    assert isinstance(telemetry, MerImuConfig)
    j2000_from_inertial = mission.planet.j2000_from_inertial_matrix
    separation = mission.vehicle.events.get("backshell_separation")
    if j2000_from_inertial is None:
        raise InputError(f"{mission.source}: planet.j2000_from_inertial: found nothing; mer-imu needs it.")
    if separation is None:
        raise InputError(f"{mission.source}: vehicle.events.backshell_separation: found nothing; mer-imu needs it.")
    imus: dict[str, MerImu] = {
        name: MerImu(
            accelerometer_noise=imu.accelerometer_noise,
            gyro_noise=imu.gyro_noise,
            errors=imu.errors,
            spacecraft_from_imu=imu.spacecraft_from_imu_quaternion,
            position=np.array(imu.position),
            alignment=imu.alignment,
            transformed_alignment=np.array(imu.transformed_alignment),
            onboard_rate_correction=imu.onboard_rate_correction,
        )
        for name, imu in telemetry.imus.items()
    }
    register = telemetry.velocity_register
    imus["register"] = MerImu(register.accelerometer_noise, register.gyro_noise, register.errors)
    onboard = mission.constraints.onboard_attitude
    events = mission.event_times()
    return MerSetup(
        epoch_sclk=telemetry.epoch_sclk,
        epoch_utc=telemetry.epoch_utc,
        start=telemetry.start_s,
        end=telemetry.end_s,
        separation=events["backshell_separation"],
        rover_from=_rover_from(telemetry, events["backshell_separation"]),
        positions={
            events[name]: np.array(event.position)
            for name, event in mission.vehicle.events.items()
            if event.position is not None
        },
        inertial_from_j2000=rotations.from_matrix(j2000_from_inertial.T),
        j2000_from_register=rotations.from_matrix(register.frame_matrix.T),
        imus=imus,
        events=events,
        attitude_sigma=onboard.sigma if onboard else 0.0,
    )


def _rover_from(telemetry: MerImuConfig, separation: float) -> float:
    if telemetry.driving == "backshell":
        return separation
    return -np.inf if telemetry.driving_from_s is None else telemetry.driving_from_s


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
    driving, *checking = (replace(r, position=changed_position(r.position, r.name, r.middle, changes)) for r in records)
    return replace(telemetry, driving=driving, checking=tuple(checking))


def impacts_from(telemetry: Telemetry, events: Mapping[str, float]) -> float:
    """Time from which samples contain impacts on the ground, s; infinity if there is no landing.

    Parameters
    ----------
    telemetry : Telemetry
        If it has a landing, the vehicle is at rest from then on: the sample that contains this time contains motion
        before it only.
    events : mapping of str to float
        Event → time, s (`event_times`).
    """
    landing = events.get("landing", np.inf)
    if telemetry.landing is None or not np.isfinite(landing):
        return landing
    time = telemetry.driving.time
    return float(time[min(int(np.searchsorted(time, landing - SAME_TIME)), len(time) - 1)])


def centre_of_mass_shifts(mission: Mission, driving: ImuRecord) -> dict[float, Array]:
    """Displacement of the centre of mass (3,), m, body axes, by time, s: of events within the driving record.

    A flight file's mission states it; with MER's telemetry it is the change of the driving IMU's position, where the
    same instrument drives before and after the event. At a change of the instrument the navigated point is stated
    otherwise (`mer_flight`).
    """
    shifts, middle = {}, driving.middle
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
        i = int(np.searchsorted(samples.middle, time, side="right"))
        # the force of a sample is in axes that half its rotation turned
        turn = rotations.from_rotation_vector(-0.5 * samples.interval[i] * samples.mean_rate[i])
        force[i] += rotations.rotate(turn, np.cross(rate[i], shift)) / samples.interval[i]
    return replace(samples, force=force)


def read_atmosphere(mission: Mission) -> Atmosphere:
    """Preflight atmosphere of a mission."""
    return Atmosphere.read(mission.atmosphere_path(), gas_of(mission), mission.atmosphere.table_gas_constant)


def gas_of(mission: Mission) -> Gas:
    """The gas of the mission's atmosphere."""
    stated = mission.atmosphere.gas
    if isinstance(stated, GasConstantsConfig):
        return gas_of_constants(
            stated.constant, stated.heat_capacity_ratio, stated.molecule_diameter, stated.molecule_mass
        )
    if isinstance(stated, GasMixtureConfig):
        return mixture(stated.composition.model_dump())
    return NAMED_GASES[stated]
