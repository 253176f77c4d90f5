"""The neutral flight file (HDF5, ``format = "edl-flight"``, version 1): read into records, and written.

SI units, radians, float64. ``/imu/primary`` drives, every other IMU checks; what a simulator puts in
``/truth`` is never opened here.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.telemetry.hdf5_checks import DEGREE_RATES, DEGREES, PARTS, Node, Within
from edl_filter.telemetry.record import (
    AltimeterRecord,
    ImuRecord,
    InitialState,
    LandingFix,
    ParachuteFix,
    SensorErrors,
    Telemetry,
)
from edl_filter.whole_file import replace_with

Array = NDArray[np.float64]

FORMAT, VERSION = "edl-flight", 1
#: A step in time longer than this many sampling intervals is a gap.
GAP = 1.5
#: How far the usual step in time may be from the sampling interval, relative.
STEP_TOLERANCE = 0.1
#: Most turn within one sample, rad: more can be no gyro's reading of a vehicle that is to be tracked.
MOST_TURN = 1.5
#: Attribute, and its size at the most, by field of `SensorErrors`.
_ERROR_ATTRIBUTES = {
    "accelerometer_bias": ("accelerometer_bias_sigma", Within("m/s^2", 0.0, 1.0)),
    "accelerometer_scale": ("accelerometer_scale_sigma", Within("", 0.0, 0.1, PARTS)),
    "accelerometer_misalignment": ("accelerometer_misalignment_sigma", Within("rad", 0.0, 0.1, DEGREES)),
    "gyro_bias": ("gyro_bias_sigma", Within("rad/s", 0.0, 0.1, DEGREE_RATES)),
    "gyro_scale": ("gyro_scale_sigma", Within("", 0.0, 0.1, PARTS)),
}
_TIME = Within("s", -1e5, 1e5, {"ms": 1e-3, "us": 1e-6})
_RADIUS = Within("m", 1e5, 1e8, {"km": 1e3})
_FORCE = Within("m/s^2", 0.0, 5e3, {"mg": 9.80665e-3})
_REST = Within("m/s^2", 0.5, 30.0, {"g": 9.80665, "mg": 9.80665e-3})


def _fill_gaps(time: Array, samples: Array, step: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Insert one long sample in each gap, the mean of its neighbours.

    Parameters
    ----------
    time : (N,) array, s
    samples : (N, K) array
    step : float
        Sampling interval, s.

    Returns
    -------
    time, samples : with the inserted rows
    inserted : boolean array, true at them
    """
    before = np.flatnonzero(np.diff(time) > GAP * step)
    inserted = np.insert(np.zeros(len(time), bool), before + 1, True)
    middle = 0.5 * (samples[before] + samples[before + 1])
    # the sample after a gap still covers one sampling interval of its own
    return (
        np.insert(time, before + 1, time[before + 1] - step),
        np.insert(samples, before + 1, middle, axis=0),
        inserted,
    )


def _noise(sigma: float, samples: Array, inserted: NDArray[np.bool_]) -> Array:
    """Noise of each sample; of an inserted one at least half the difference of its neighbours."""
    noise = np.full(len(samples), sigma)
    at = np.flatnonzero(inserted)
    noise[at] = np.maximum(sigma, 0.5 * np.linalg.norm(samples[at + 1] - samples[at - 1], axis=1))
    return noise


def _read_imu(node: Node, name: str) -> ImuRecord:
    """One IMU, turned to body axes, gaps filled by one long sample each."""
    time = node.increasing("time", node.numbers("time", None))
    if len(time) < 2:
        raise InputError(f"{node.shown}: /imu/{name}/time has {len(time)} samples; at least 2 are needed.")
    node.within("time", time[[0, -1]], _TIME)
    step = node.attribute("sample_interval", positive=True)
    if abs((usual := float(np.median(np.diff(time)))) / step - 1.0) > STEP_TOLERANCE:
        raise node.complain("@sample_interval", f"is {step:g} s, but the usual step of its time is {usual:g} s.")
    body_from_imu = node.unit("@body_from_imu", node.attribute("body_from_imu", 4))
    measured = {key: node.numbers(key, len(time), 3) for key in ("specific_force", "angular_rate")}
    node.within("specific_force", measured["specific_force"], _FORCE)
    node.within(
        "angular_rate", measured["angular_rate"], Within("rad/s", 0.0, min(50.0, MOST_TURN / step), DEGREE_RATES)
    )
    turned = [rotations.rotate(body_from_imu, values) for values in measured.values()]
    time, samples, inserted = _fill_gaps(time, np.hstack(turned), step)
    force, rate = samples[:, :3].copy(), samples[:, 3:].copy()
    noises = [
        node.attribute("accelerometer_noise", positive=True, range=Within("m/s^2", 0.0, 1.0)),
        node.attribute("gyro_noise", positive=True, range=Within("rad/s", 0.0, 0.1, DEGREE_RATES)),
    ]
    errors = SensorErrors(**{
        key: node.attribute(attribute, range=size) for key, (attribute, size) in _ERROR_ATTRIBUTES.items()
    })  # fmt: skip
    position = node.attribute("position", 3, range=Within("m", 0.0, 20.0, {"cm": 1e-2, "mm": 1e-3}))
    return ImuRecord(
        name=name,
        time=time,
        interval=np.diff(time, prepend=time[0] - step),
        specific_force=force,
        angular_rate=rate,
        position=np.tile(position, (len(time), 1)),
        force_noise=_noise(noises[0], force, inserted),
        rate_noise=_noise(noises[1], rate, inserted),
        shared_rate_noise=np.where(inserted, 0.0, noises[1]),
        net_turn=np.zeros(len(time), bool),
        net_gain=np.zeros(len(time), bool),
        unit=np.zeros(len(time), np.int64),
        units=(name,),
        source=inserted.astype(np.int64),
        sources=("flight file", "gap") if inserted.any() else ("flight file",),
        errors=(errors,),
    )


def _check_rest(units: Node, records: tuple[ImuRecord, ...], landing: LandingFix) -> None:
    """See that after the landing accelerometers show the gravity of some planet."""
    for record in records:
        rest = record.specific_force[record.time > landing.time]
        if len(rest):
            gravity = float(np.linalg.norm(rest, axis=1).mean())
            units.within(f"{record.name}/specific_force", np.array(gravity), _REST, "in the mean after the landing ")


def _event_time(node: Node) -> float:
    if "time_sigma" in node.group.attrs:
        node.attribute("time_sigma", range=Within("s", 0.0, 1e3))
    return float(node.attribute("time", range=_TIME))


def _read(file: h5py.File, shown: str) -> dict[str, Any]:
    """All of the open file but the truth, as arguments of `Telemetry`."""
    root = Node(shown, file["/"])
    if (found := file.attrs.get("format")) != FORMAT:
        raise InputError(f"{shown}: attribute format is {found!r}; {FORMAT!r} is needed.")
    if (found := file.attrs.get("version")) != VERSION:
        raise InputError(f"{shown}: attribute version is {found!r}; version {VERSION} is read.")
    units = root.child("imu")
    primary = _read_imu(units.child("primary"), "primary")
    checking = tuple(_read_imu(units.child(name), name) for name in sorted(units.group) if name != "primary")
    start = root.child("initial")
    initial = InitialState(
        start.attribute("time", range=_TIME),
        start.within("position", start.numbers("position", 3), Within("m", 1e5, 1e9, {"km": 1e3})),
        start.within("velocity", start.numbers("velocity", 3), Within("m/s", 100.0, 1e5, {"km/s": 1e3})),
        start.unit("attitude", start.numbers("attitude", 4)),
        start.covariance("covariance"),
    )
    constraints, altimeter, landing, parachute = root.optional("constraints"), None, None, None
    if constraints and (node := constraints.optional("landing")):
        landing = LandingFix(
            node.attribute("time", range=_TIME),
            node.within("position", node.numbers("position", 3), _RADIUS),
            node.within("position_sigma", node.positive("position_sigma", node.numbers("position_sigma", 3)),
                        Within("m", 0.0, 1e6)),
        )  # fmt: skip
        _check_rest(units, (primary, *checking), landing)
    if constraints and (node := constraints.optional("parachute")):
        parachute = ParachuteFix(
            node.attribute("time", range=_TIME),
            node.attribute("dynamic_pressure", range=Within("Pa", 10.0, 1e6, {"kPa": 1e3})),
            node.attribute("dynamic_pressure_sigma", positive=True, range=Within("Pa", 0.0, 1e6)),
        )
    if node := root.optional("altimeter"):
        time = node.increasing("time", node.numbers("time", None))
        height = node.within("height", node.numbers("height", len(time))[:, None], Within("m", -1e4, 1e6))[:, 0]
        altimeter = AltimeterRecord(
            time,
            height,
            node.attribute("sigma", positive=True, range=Within("m", 0.0, 1e5)),
            node.attribute("surface_radius", range=_RADIUS),
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
        "prime_meridian_at_epoch": root.attribute("prime_meridian_at_epoch", range=Within("rad", -6.3, 6.3, DEGREES)),
        "planet": root.text("planet"),
        "notes": tuple(
            f"/imu/{imu.name}: {count} gap{'s' * (count != 1)} in time, each filled by one long sample "
            "between its neighbours."
            for imu in (primary, *checking)
            if (count := int(np.count_nonzero(imu.source)))
        ),
    }


def read_flight_file(path: str | Path) -> Telemetry:
    """Read a flight file into records in body axes.

    A gap in an IMU's samples becomes one sample over the missing time: the mean of its two neighbours, with
    half their difference as its noise, marked by the source ``"gap"``. ``/events``, ``/constraints`` and
    ``/altimeter`` may be missing; everything else of the format must be there.

    Parameters
    ----------
    path : path of the file

    Returns
    -------
    Telemetry

    Raises
    ------
    InputError
        Not an HDF5 file, another format or version, a missing or misshapen group, dataset or attribute,
        numbers that are not finite or of a size that only a wrong unit gives, time that does not increase, a
        sampling interval unlike the steps in time, a quaternion off the unit by more than 1e-3, a covariance that
        is not symmetric and positive definite. The message names file, place, row.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such flight file.")
    try:
        file = h5py.File(path, "r")
    except OSError:
        raise InputError(
            f"{path}: this is no HDF5 file, or a damaged one; a flight file (edl-flight) is needed."
        ) from None
    with file:
        contents = _read(file, str(path))
    return Telemetry(**contents, files={path.name: hashlib.sha256(path.read_bytes()).hexdigest()})


@dataclass(frozen=True)
class FlightImu:
    """One IMU as the flight file holds it: arrays in IMU axes, SI (see ``/imu/<name>`` of the format)."""

    time: Array
    specific_force: Array
    angular_rate: Array
    sample_interval: float
    body_from_imu: Array
    position: Array
    accelerometer_noise: float
    gyro_noise: float
    errors: SensorErrors = field(default_factory=SensorErrors)


def _write_imu(group: Any, imu: FlightImu) -> None:
    for key in ("time", "specific_force", "angular_rate"):
        group[key] = np.asarray(getattr(imu, key), np.float64)
    for key in ("sample_interval", "body_from_imu", "position", "accelerometer_noise", "gyro_noise"):
        group.attrs[key] = np.asarray(getattr(imu, key), np.float64)[()]
    for key, (attribute, _) in _ERROR_ATTRIBUTES.items():
        group.attrs[attribute] = float(getattr(imu.errors, key))


def _write_tree(group: Any, tree: dict[str, Any]) -> None:
    """Nested dict as groups, arrays as datasets, strings and numbers as attributes."""
    for key, value in tree.items():
        if isinstance(value, dict):
            _write_tree(group.require_group(key), value)
        elif isinstance(value, str | float | int):
            group.attrs[key] = value
        else:
            group[key] = np.asarray(value, np.float64)


@dataclass(frozen=True)
class FlightContents:
    """All that a flight file holds.

    Attributes
    ----------
    name, planet, epoch_utc : str
    prime_meridian_at_epoch : float
        rad.
    imus : dict
        Name → `FlightImu`; one is called ``primary``.
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
        """Write all into an open file."""
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


def write_flight_file(path: str | Path, contents: FlightContents) -> Path:
    """Write a flight file, read it back as a check, and only then give it its name.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    InputError
        The contents break the format (as `read_flight_file`), or the folder cannot be written; nothing is
        left.
    """
    path = Path(path)

    def make(temporary: Path) -> None:
        with h5py.File(temporary, "w") as file:
            contents.fill(file)
            _read(file, str(path))

    return replace_with(path, make)


def flight_telemetry(contents: FlightContents) -> Telemetry:
    """Records as `read_flight_file` would give them of the contents, without a file on disk.

    Raises
    ------
    InputError
        The contents break the format.
    """
    with h5py.File(f"{contents.name}.h5", "w", driver="core", backing_store=False) as file:
        contents.fill(file)
        return Telemetry(**_read(file, contents.name))
