"""Reader and writer of the neutral flight file (HDF5, ``format = "edl-flight"``, version 1).

Input of the reader: a flight file; output: records in body axes (`Telemetry`). Input of the writer: `FlightContents`.
SI units, radians, float64. ``/imu/primary`` drives the propagation, every other IMU is for comparison. The reader never
opens ``/truth``, which a simulator writes.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from edl_filter.errors import InputError
from edl_filter.io.atomic import replace_with, write_through_memory
from edl_filter.io.hdf5_guard import open_hdf5
from edl_filter.telemetry.flight_imu import FlightImu, read_imu, write_imu
from edl_filter.telemetry.hdf5_checks import DEGREES, TIME, Limits, Node
from edl_filter.telemetry.record import (
    AltimeterRecord,
    ImuRecord,
    InitialState,
    LandingFix,
    ParachuteFix,
    Telemetry,
)
from edl_filter.telemetry.sample_checks import CheckSettings

FORMAT, VERSION = "edl-flight", 1
_RADIUS = Limits("m", 1e5, 1e8, {"km": 1e3})
_REST = Limits("m/s^2", 0.5, 30.0, {"g": 9.80665, "mg": 9.80665e-3})


def _check_rest(imu_node: Node, records: tuple[ImuRecord, ...], landing: LandingFix) -> None:
    """Raise if the mean specific force after the landing cannot be the gravity of a planet."""
    for record in records:
        at_rest = record.specific_force[record.time > landing.time]
        if np.isfinite(at_rest).any():
            gravity = float(np.nanmean(np.linalg.norm(at_rest, axis=1)))
            imu_node.within(f"{record.name}/specific_force", np.array(gravity), _REST, "in the mean after the landing ")


def _event_time(node: Node) -> float:
    """Time of an event, s; its sigma is checked but not used."""
    if "time_sigma" in node.group.attrs:
        node.attribute("time_sigma", limits=Limits("s", 0.0, 1e3))
    return float(node.attribute("time", limits=TIME))


def _read(file: h5py.File, file_name: str, settings: CheckSettings | None = None) -> dict[str, Any]:
    """Arguments of `Telemetry` from an open file; the group ``/truth`` is not read."""
    root = Node(file_name, file["/"])
    if (file_format := file.attrs.get("format")) != FORMAT:
        raise InputError(f"{file_name}: attribute format is {file_format!r}; {FORMAT!r} is needed.")
    if (version := file.attrs.get("version")) != VERSION:
        raise InputError(f"{file_name}: attribute version is {version!r}; version {VERSION} is read.")
    imu_node = root.child("imu")
    names = ["primary", *(name for name in sorted(imu_node.group) if name != "primary")]
    imus = [read_imu(imu_node.child(name), name, settings) for name in names]
    primary, checking = imus[0][0], tuple(record for record, _ in imus[1:])
    initial_node = root.child("initial")
    initial = InitialState(
        initial_node.attribute("time", limits=TIME),
        initial_node.within("position", initial_node.numbers("position", 3), Limits("m", 1e5, 1e9, {"km": 1e3})),
        initial_node.within("velocity", initial_node.numbers("velocity", 3), Limits("m/s", 100.0, 1e5, {"km/s": 1e3})),
        initial_node.unit("attitude", initial_node.numbers("attitude", 4)),
        initial_node.covariance("covariance"),
    )
    constraints, altimeter, landing, parachute = root.optional("constraints"), None, None, None
    if constraints and (node := constraints.optional("landing")):
        landing = LandingFix(
            node.attribute("time", limits=TIME),
            node.within("position", node.numbers("position", 3), _RADIUS),
            node.within("position_sigma", node.positive("position_sigma", node.numbers("position_sigma", 3)),
                        Limits("m", 0.0, 1e6)),
        )  # fmt: skip
        _check_rest(imu_node, (primary, *checking), landing)
    if constraints and (node := constraints.optional("parachute")):
        parachute = ParachuteFix(
            node.attribute("time", limits=TIME),
            node.attribute("dynamic_pressure", limits=Limits("Pa", 10.0, 1e6, {"kPa": 1e3})),
            node.attribute("dynamic_pressure_sigma", positive=True, limits=Limits("Pa", 0.0, 1e6)),
        )
    if node := root.optional("altimeter"):
        time = node.increasing("time", node.numbers("time", None))
        height = node.within("height", node.numbers("height", len(time))[:, None], Limits("m", -1e4, 1e6))[:, 0]
        altimeter = AltimeterRecord(
            time,
            height,
            node.attribute("sigma", positive=True, limits=Limits("m", 0.0, 1e5)),
            node.attribute("surface_radius", limits=_RADIUS),
        )
    events = root.optional("events")
    return {
        "driving": primary,
        "checking": checking,
        "altimeter": altimeter,
        "initial": initial,
        "landing": landing,
        "parachute": parachute,
        "events": {name: _event_time(events.child(name)) for name in events.group} if events else {},
        "epoch_utc": root.utc("epoch_utc"),
        "prime_meridian_at_epoch": root.attribute("prime_meridian_at_epoch", limits=Limits("rad", -6.3, 6.3, DEGREES)),
        "planet": root.text("planet"),
        "findings": tuple(finding for _, findings in imus for finding in findings),
    }


def read_flight_file(path: str | Path, settings: CheckSettings | None = None) -> Telemetry:
    """Read a flight file into records in body axes.

    A sample that is missing or bad is NaN in the record and listed in `Telemetry.findings`; `sample_repair.repaired`
    fills it. A missing sample has the source ``"gap"``. ``/events``, ``/constraints`` and ``/altimeter`` are
    optional; the rest of the format must be present.

    Parameters
    ----------
    path : path
        HDF5 file.
    settings : CheckSettings, optional
        Thresholds of the checks of the samples.

    Returns
    -------
    Telemetry

    Raises
    ------
    InputError
        Not an HDF5 file; one that names other files or states shapes for which it has no data (`hdf5_guard`); another
        format or version; a group, dataset or attribute that is missing or of a wrong shape;
        numbers that are not finite or outside the limits of the right unit, except in an IMU's samples; a sampling
        interval that differs from the steps in time; a quaternion whose norm differs from 1 by more than 1e-3; a
        covariance that is not symmetric and positive definite. The message names the file, the member and the row.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such flight file.")
    with open_hdf5(path, "a flight file (edl-flight)") as file:
        contents = _read(file, str(path), settings)
    return Telemetry(**contents, files={path.name: hashlib.sha256(path.read_bytes()).hexdigest()})


def _write_tree(group: Any, tree: dict[str, Any]) -> None:
    """Write a nested dict: dicts as groups, arrays as datasets, strings and numbers as attributes."""
    for key, value in tree.items():
        if isinstance(value, dict):
            _write_tree(group.require_group(key), value)
        elif isinstance(value, str | float | int):
            group.attrs[key] = value
        else:
            group[key] = np.asarray(value, np.float64)


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
            write_imu(file.create_group(f"imu/{key}"), imu)


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
            _read(file, str(path))

        write_through_memory(temporary, fill)

    return replace_with(path, write)


def flight_telemetry(contents: FlightContents) -> Telemetry:
    """Records that `read_flight_file` would return for the contents, without a file on disk.

    Raises
    ------
    InputError
        The contents violate the format.
    """
    with h5py.File(f"{contents.name}.h5", "w", driver="core", backing_store=False) as file:
        contents.fill(file)
        return Telemetry(**_read(file, contents.name))
