"""Writer of the neutral flight file (HDF5, ``format = "edl-flight"``, version 1).

Input: `FlightContents`. Output: a file that `flight_file.read_flight_file` has read back without an error.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.io.atomic import replace_with, write_through_memory
from edl_filter.telemetry.flight_file import ERROR_ATTRIBUTES, FORMAT, VERSION, read_root
from edl_filter.telemetry.hdf5_checks import Node
from edl_filter.telemetry.record import AltimeterRecord, InitialState, LandingFix, ParachuteFix, Telemetry
from edl_filter.telemetry.sample_checks import CheckSettings
from edl_filter.types import Array


@dataclass(frozen=True)
class FlightImu:
    """One IMU as the flight file stores it (group ``/imu/<name>`` of the format): IMU axes, SI units.

    Attributes
    ----------
    time : (N,) array
        End of each sampling interval, s since the epoch.
    specific_force, angular_rate : (N, 3) arrays
        Means over the interval at the IMU, m/s² and rad/s.
    sample_interval : float
        s.
    body_from_imu : (4,) array
    position : (3,) array
        From the centre of mass, m, body axes.
    accelerometer_noise, gyro_noise : float
        One sigma of one sample, m/s² and rad/s.
    errors : SensorErrors
    """

    time: Array
    specific_force: Array
    angular_rate: Array
    sample_interval: float
    body_from_imu: Array
    position: Array
    accelerometer_noise: float
    gyro_noise: float
    errors: SensorErrors = field(default_factory=SensorErrors)


@dataclass(frozen=True)
class FlightContents:
    """Contents of a flight file.

    Attributes
    ----------
    name, planet, epoch_utc : str
    prime_meridian_at_epoch : float
        rad.
    imus : dict
        Name → `FlightImu`; one name is ``primary``.
    initial : InitialState
    events : dict
        Name → (time, sigma of the time), s.
    parachute : ParachuteFix or None
    landing : LandingFix or None
    altimeter : AltimeterRecord or None
    truth : dict or None
        Nested: dicts become groups of ``/truth``, arrays datasets, numbers and strings attributes.
    """

    name: str
    planet: str
    epoch_utc: str
    prime_meridian_at_epoch: float
    imus: dict[str, FlightImu]
    initial: InitialState
    events: dict[str, tuple[float, float]] = field(default_factory=dict)
    parachute: ParachuteFix | None = None
    landing: LandingFix | None = None
    altimeter: AltimeterRecord | None = None
    truth: dict[str, Any] | None = None

    def fill(self, file: h5py.File) -> None:
        """Write the contents to an open, empty file."""
        initial = self.initial
        tree: dict[str, Any] = {
            "format": FORMAT,
            "version": VERSION,
            "name": self.name,
            "planet": self.planet,
            "epoch_utc": self.epoch_utc,
            "prime_meridian_at_epoch": float(self.prime_meridian_at_epoch),
            "initial": {
                "time": float(initial.time),
                "position": initial.position,
                "velocity": initial.velocity,
                "attitude": initial.inertial_from_body,
                "covariance": initial.covariance,
            },
            "events": {key: {"time": float(t), "time_sigma": float(s)} for key, (t, s) in self.events.items()},
        }
        fixes = {"parachute": self.parachute, "landing": self.landing}
        tree["constraints"] = {key: dict(vars(fix)) for key, fix in fixes.items() if fix is not None}
        if self.altimeter is not None:
            tree["altimeter"] = dict(vars(self.altimeter))
        if self.truth is not None:
            tree["truth"] = self.truth
        _write_tree(file, tree)
        for key, imu in self.imus.items():
            _write_imu(file.create_group(f"imu/{key}"), imu)


def _write_tree(group: Any, tree: dict[str, Any]) -> None:
    """Write a nested dict: dicts as groups, arrays as datasets, strings and numbers as attributes."""
    for key, value in tree.items():
        if isinstance(value, dict):
            _write_tree(group.require_group(key), value)
        elif isinstance(value, str | float | int):
            group.attrs[key] = value
        else:
            group[key] = np.asarray(value, np.float64)


def _write_imu(group: Any, imu: FlightImu) -> None:
    """Write one IMU to its group."""
    for key in ("time", "specific_force", "angular_rate"):
        group[key] = np.asarray(getattr(imu, key), np.float64)
    for key in ("sample_interval", "body_from_imu", "position", "accelerometer_noise", "gyro_noise"):
        group.attrs[key] = np.asarray(getattr(imu, key), np.float64)[()]
    for key, (attribute, _) in ERROR_ATTRIBUTES.items():
        group.attrs[attribute] = float(getattr(imu.errors, key))


def write_flight_file(path: str | Path, contents: FlightContents) -> Path:
    """Write a flight file; it appears under its name only after it was read back without an error.

    Parameters
    ----------
    path : path
        File to write or replace.
    contents : FlightContents
        Contents of the file.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    InputError
        The contents violate the format (as in `read_flight_file`), or the folder cannot be written. No file remains in
        that case, and an existing one is unchanged.
    """
    path = Path(path)

    def write(temporary: Path) -> None:
        def fill(file: h5py.File) -> None:
            contents.fill(file)
            read_root(Node(str(path), file["/"]), None)

        write_through_memory(temporary, fill)

    return replace_with(path, write)


def flight_telemetry(contents: FlightContents, settings: CheckSettings | None = None) -> Telemetry:
    """Records that `read_flight_file` would return for the contents, without a file on disk.

    Parameters
    ----------
    contents : FlightContents
        Measurements.
    settings : CheckSettings, optional
        Thresholds of the checks of the samples.

    Raises
    ------
    InputError
        The contents violate the format.
    """
    with h5py.File(f"{contents.name}.h5", "w", driver="core", backing_store=False) as file:
        contents.fill(file)
        return Telemetry(**read_root(Node(contents.name, file["/"]), settings))
