"""Reader and writer of the neutral flight file (HDF5, ``format = "edl-flight"``, version 1).

Input of the reader: a flight file; output: records in body axes (`Telemetry`). Input of the writer: `FlightContents`.
SI units, radians, float64. ``/imu/primary`` drives the propagation, every other IMU is for comparison. The reader never
opens ``/truth``, which a simulator writes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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


def _check_rest(imu_node: Node, records: tuple[ImuRecord, ...], landed: float) -> None:
    """Raise if the mean specific force after the time of landing, s, cannot be the gravity of a planet."""
    for record in records:
        at_rest = record.specific_force[record.time > landed]
        if np.isfinite(at_rest).any():
            gravity = float(np.nanmean(np.linalg.norm(at_rest, axis=1)))
            imu_node.within(f"{record.name}/specific_force", np.array(gravity), _REST, "in the mean after the landing ")


def _event_time(node: Node) -> float:
    """Time of an event, s; its sigma is checked but not used."""
    if "time_sigma" in node.group.attrs:
        node.attribute("time_sigma", limits=Limits("s", 0.0, 1e3))
    return float(node.attribute("time", limits=TIME))


def _read_imus(root: Node, settings: CheckSettings | None) -> dict[str, Any]:
    imu_node = root.child("imu")
    names = ["primary", *(name for name in sorted(imu_node.group) if name != "primary")]
    imus = [read_imu(imu_node.child(name), name, settings) for name in names]
    landing = _landing_node(root)
    if landing:
        _check_rest(imu_node, tuple(record for record, _ in imus), landing.attribute("time", limits=TIME))
    return {
        "driving": imus[0][0],
        "checking": tuple(record for record, _ in imus[1:]),
        "findings": tuple(finding for _, findings in imus for finding in findings),
    }


def _read_initial(root: Node) -> dict[str, Any]:
    node = root.child("initial")
    state = InitialState(
        node.attribute("time", limits=TIME),
        node.within("position", node.numbers("position", 3), Limits("m", 1e5, 1e9, {"km": 1e3})),
        node.within("velocity", node.numbers("velocity", 3), Limits("m/s", 100.0, 1e5, {"km/s": 1e3})),
        node.unit("attitude", node.numbers("attitude", 4)),
        node.covariance("covariance"),
    )
    return {"initial": state}


def _landing_node(root: Node) -> Node | None:
    constraints = root.optional("constraints")
    return constraints.optional("landing") if constraints else None


def _read_landing(root: Node) -> dict[str, Any]:
    node = _landing_node(root)
    if not node:
        return {"landing": None}
    sigma = node.positive("position_sigma", node.numbers("position_sigma", 3))
    landing = LandingFix(
        node.attribute("time", limits=TIME),
        node.within("position", node.numbers("position", 3), _RADIUS),
        node.within("position_sigma", sigma, Limits("m", 0.0, 1e6)),
    )
    return {"landing": landing}


def _read_parachute(root: Node) -> dict[str, Any]:
    constraints = root.optional("constraints")
    node = constraints.optional("parachute") if constraints else None
    if not node:
        return {"parachute": None}
    parachute = ParachuteFix(
        node.attribute("time", limits=TIME),
        node.attribute("dynamic_pressure", limits=Limits("Pa", 10.0, 1e6, {"kPa": 1e3})),
        node.attribute("dynamic_pressure_sigma", positive=True, limits=Limits("Pa", 0.0, 1e6)),
    )
    return {"parachute": parachute}


def _read_altimeter(root: Node) -> dict[str, Any]:
    node = root.optional("altimeter")
    if not node:
        return {"altimeter": None}
    time = node.increasing("time", node.numbers("time", None))
    altimeter = AltimeterRecord(
        time,
        node.within("height", node.numbers("height", len(time))[:, None], Limits("m", -1e4, 1e6))[:, 0],
        node.attribute("sigma", positive=True, limits=Limits("m", 0.0, 1e5)),
        node.attribute("surface_radius", limits=_RADIUS),
    )
    return {"altimeter": altimeter}


def _read_events(root: Node) -> dict[str, Any]:
    events = root.optional("events")
    return {"events": {name: _event_time(events.child(name)) for name in events.group} if events else {}}


def _read_epoch(root: Node) -> dict[str, Any]:
    return {"epoch_utc": root.utc("epoch_utc")}


def _read_planet(root: Node) -> dict[str, Any]:
    meridian = root.attribute("prime_meridian_at_epoch", limits=Limits("rad", -6.3, 6.3, DEGREES))
    return {"prime_meridian_at_epoch": meridian, "planet": root.text("planet")}


def _parts(settings: CheckSettings | None) -> tuple[Callable[[Node], dict[str, Any]], ...]:
    """Readers of the parts of a flight file, each of which returns arguments of `Telemetry`; ``/truth`` is not read."""
    return (
        lambda root: _read_imus(root, settings), _read_initial, _read_landing, _read_parachute, _read_altimeter,
        _read_events, _read_epoch, _read_planet,
    )  # fmt: skip


def _read(root: Node, settings: CheckSettings | None) -> dict[str, Any]:
    """Arguments of `Telemetry` from the root of a flight file."""
    contents: dict[str, Any] = {}
    for read_part in _parts(settings):
        contents |= read_part(root)
    return contents


@contextmanager
def _opened(path: Path) -> Iterator[Node]:
    """Root of a flight file; raises InputError where it is none."""
    if not path.is_file():
        raise InputError(f"{path}: no such flight file.")
    with open_hdf5(path, "a flight file (edl-flight)") as file:
        if (file_format := file.attrs.get("format")) != FORMAT:
            raise InputError(f"{path}: attribute format is {file_format!r}; {FORMAT!r} is needed.")
        if (version := file.attrs.get("version")) != VERSION:
            raise InputError(f"{path}: attribute version is {version!r}; version {VERSION} is read.")
        yield Node(str(path), file["/"])


def flight_file_problems(path: str | Path) -> list[str]:
    """Messages of the first problem of every part of a flight file; empty for a valid one.

    Parts are the IMUs, the entry state, each constraint, the altimeter, the events, the epoch and the planet.

    Parameters
    ----------
    path : path
        HDF5 file.
    """
    problems = []
    try:
        with _opened(Path(path)) as root:
            for read_part in _parts(None):
                try:
                    read_part(root)
                except InputError as error:
                    problems.append(str(error))
    except InputError as error:
        return [str(error)]
    return list(dict.fromkeys(problems))


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
    with _opened(path) as root:
        contents = _read(root, settings)
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
            _read(Node(str(path), file["/"]), None)

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
        return Telemetry(**_read(Node(contents.name, file["/"]), settings))
