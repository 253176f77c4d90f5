"""Reader of the neutral flight file (HDF5, ``format = "edl-flight"``, version 1).

Input: a flight file, SI units, radians, float64. Method: checks of shapes and limits (`hdf5_checks`) and of the samples
(`sample_checks`), rotation from IMU axes to body axes. Output: `Telemetry`, whose records have NaN where samples are
missing or bad. ``/imu/primary`` drives the propagation, every other IMU is for comparison. ``/truth``, which a
simulator writes, is never opened.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import constants

from edl_filter import rotations
from edl_filter.errors import InputError
from edl_filter.estimation.series import finite_rows
from edl_filter.imu_model.sensor_errors import SensorErrors
from edl_filter.io.hdf5_guard import open_hdf5
from edl_filter.telemetry.hdf5_checks import DEGREE_RATES, DEGREES, PARTS, TIME, Limits, Node
from edl_filter.telemetry.partial_readings import partial_readings
from edl_filter.telemetry.quantisation import bias_with_rounding, coarse, noise_with_rounding, quantum
from edl_filter.telemetry.record import (
    AltimeterRecord,
    ImuRecord,
    InitialState,
    LandingFix,
    ParachuteFix,
    SampleFinding,
    Telemetry,
)
from edl_filter.telemetry.sample_checks import (
    CheckSettings,
    completed,
    findings_of,
    highest_readings,
    in_body_axes,
    lost_readings,
    stuck_runs,
    with_repair,
)
from edl_filter.telemetry.time_stamps import evened, ordered_packets
from edl_filter.types import Array

FORMAT, VERSION = "edl-flight", 1
_RADIUS = Limits("m", 1e5, 1e8, {"km": 1e3})
_REST = Limits("m/s^2", 0.5, 30.0, {"g": constants.g, "mg": 1e-3 * constants.g})
#: Samples beyond the limits that are bad ones; more of them have a wrong unit.
MOST_OUT_OF_RANGE = 16
#: Largest relative difference between the median step in time and the sampling interval.
STEP_TOLERANCE = 0.1
#: Largest difference between the times of the parachute's constraint and of its event, s.
DEPLOYMENT_TOLERANCE = 0.5
#: Attribute and its limits, by field of `SensorErrors`.
ERROR_ATTRIBUTES = {
    "accelerometer_bias": ("accelerometer_bias_sigma", Limits("m/s^2", 0.0, 1.0)),
    "accelerometer_scale": ("accelerometer_scale_sigma", Limits("", 0.0, 0.1, PARTS)),
    "accelerometer_misalignment": ("accelerometer_misalignment_sigma", Limits("rad", 0.0, 0.1, DEGREES)),
    "gyro_bias": ("gyro_bias_sigma", Limits("rad/s", 0.0, 0.1, DEGREE_RATES)),
    "gyro_scale": ("gyro_scale_sigma", Limits("", 0.0, 0.1, PARTS)),
}
_FORCE_UNITS = {"mg": 1e-3 * constants.g}
#: IMU → quantity → factor from the unit in which its readings may be stored to that of the format.
UnitFactors = Mapping[str, Mapping[str, float]]


def conflicting_median_step(time: Array, interval: float) -> float | None:
    """Median step in time if it differs from the stated sampling interval, otherwise None.

    Parameters
    ----------
    time : (N,) array
        s, N ≥ 2.
    interval : float
        Stated sampling interval, s; a relative difference up to `STEP_TOLERANCE` is accepted.

    Returns
    -------
    float or None
        s.
    """
    median = float(np.median(np.diff(time)))
    return median if abs(median / interval - 1.0) > STEP_TOLERANCE else None


def _read_imu(
    node: Node, name: str, settings: CheckSettings | None = None, factors: Mapping[str, float] | None = None
) -> tuple[ImuRecord, tuple[SampleFinding, ...]]:
    """Record of one IMU in body axes, with NaN where a sample is missing or bad.

    Parameters
    ----------
    node : Node
        Group of the IMU.
    name : str
        Name of the record.
    settings : CheckSettings, optional
        Thresholds of the checks.
    factors : dict, optional
        Of its readings, as in `UnitFactors`.

    Returns
    -------
    record : ImuRecord
    findings : tuple of SampleFinding
        Missing and bad samples.

    Raises
    ------
    InputError
        The group violates the format.
    """
    settings = CheckSettings() if settings is None else settings
    time = node.numbers("time", None, finite=False)
    if np.count_nonzero(np.isfinite(time)) < 2:
        raise InputError(f"{node.file_name}: /imu/{name}/time has {len(time)} samples; at least 2 are needed.")
    interval = node.attribute("sample_interval", positive=True)
    body_from_imu = node.unit("@body_from_imu", node.attribute("body_from_imu", 4))
    measured = {
        key: (factors or {}).get(key, 1.0) * node.numbers(key, len(time), 3, finite=False)
        for key in ("specific_force", "angular_rate")
    }
    highest = highest_readings(interval)
    limits = Limits("m/s^2", 0.0, highest[0], _FORCE_UNITS), Limits("rad/s", 0.0, highest[1], DEGREE_RATES)
    for (key, values), allowed in zip(measured.items(), limits, strict=True):
        _check_unit(node, key, values, allowed)
    if not any(finite_rows(values).any() for values in measured.values()):
        raise node.error("specific_force", "and angular_rate have no finite sample.")
    time, uneven = evened(time, interval, name) if settings.enabled else (time, [])
    time, readings, findings = ordered_packets(time, np.hstack(list(measured.values())), interval, name)
    node.within("time", time[[0, -1]], TIME)
    if median := conflicting_median_step(time, interval):
        raise node.error("@sample_interval", f"is {interval:g} s, but the usual step of its time is {median:g} s.")
    steps = [quantum(readings[:, triad]) if settings.enabled else 0.0 for triad in (slice(0, 3), slice(3, 6))]
    force_sigma = node.attribute("accelerometer_noise", positive=True, limits=Limits("m/s^2", 0.0, 1.0))
    rate_sigma = node.attribute("gyro_noise", positive=True, limits=Limits("rad/s", 0.0, 0.1, DEGREE_RATES))
    readings, bad = lost_readings(time, readings, interval, name, highest, settings, (force_sigma, rate_sigma))
    matrix = rotations.to_matrix(body_from_imu)
    bad = in_body_axes(bad, matrix)
    time, readings, inserted, missing = completed(time, readings, interval, name)
    force, rate = (rotations.rotate(body_from_imu, v) for v in (readings[:, :3].copy(), readings[:, 3:].copy()))
    errors = SensorErrors(**{
        key: node.attribute(attribute, limits=limits) for key, (attribute, limits) in ERROR_ATTRIBUTES.items()
    })  # fmt: skip
    force_sigma, rate_sigma, errors, rounded = _with_rounding(name, time, steps, (force_sigma, rate_sigma), errors)
    position = node.attribute("position", 3, limits=Limits("m", 0.0, 20.0, {"cm": 1e-2, "mm": 1e-3}))
    record = ImuRecord(
        name=name,
        time=time,
        interval=np.diff(time, prepend=time[0] - interval),
        specific_force=force,
        angular_rate=rate,
        position=np.tile(position, (len(time), 1)),
        force_noise=np.full(len(time), force_sigma),
        rate_noise=np.full(len(time), rate_sigma),
        shared_rate_noise=np.where(inserted > 0, 0.0, rate_sigma),
        coning_corrected=np.zeros(len(time), bool),
        sculling_corrected=np.zeros(len(time), bool),
        unit=np.zeros(len(time), np.int64),
        units=(name,),
        source=inserted,
        sources=("flight file", "gap") if inserted.any() else ("flight file",),
        errors=(errors,),
        stated_interval=interval,
        partial_force=partial_readings(readings[:, :3], matrix),
        partial_rate=partial_readings(readings[:, 3:], matrix),
    )
    return record, (*uneven, *findings, *bad, *missing, *rounded)


def _with_rounding(
    name: str, time: Array, steps: Sequence[float], noise: tuple[float, float], errors: SensorErrors
) -> tuple[float, float, SensorErrors, list[SampleFinding]]:
    """Noise and errors of an IMU whose readings have coarse steps (m/s², rad/s), and a finding for each triad."""
    force, rate, findings = *noise, []
    for triad, step, sigma, unit in zip(("force", "rate"), steps, noise, ("m/s²", "rad/s"), strict=True):
        if coarse(step, sigma):
            repair = f"steps of {step:.3g} {unit}, which its noise and bias contain"
            findings.append(SampleFinding(name, triad, float(time[0]), float(time[-1]), len(time), "coarse", repair))
    if coarse(steps[0], force):
        bias = bias_with_rounding(steps[0], errors.accelerometer_bias)
        force, errors = noise_with_rounding(steps[0], force), replace(errors, accelerometer_bias=bias)
    if coarse(steps[1], rate):
        bias = bias_with_rounding(steps[1], errors.gyro_bias)
        rate, errors = noise_with_rounding(steps[1], rate), replace(errors, gyro_bias=bias)
    return force, rate, errors, findings


def _check_unit(node: Node, key: str, values: Array, limits: Limits) -> None:
    """Raise if more than `MOST_OUT_OF_RANGE` samples are beyond the limits: their unit is wrong, they are no spikes."""
    finite = finite_rows(values)
    if np.count_nonzero(np.linalg.norm(values[finite], axis=1) > limits.high) > MOST_OUT_OF_RANGE:
        node.within(key, np.where(finite[:, None], values, 0.0), limits)


def _check_rest(imu_node: Node, records: tuple[ImuRecord, ...], landed: float) -> None:
    """Raise if the median specific force after the time of landing, s, cannot be the gravity of a planet."""
    for record in records:
        at_rest = record.specific_force[record.time > landed]
        if np.isfinite(at_rest).any():
            gravity = float(np.nanmedian(np.linalg.norm(at_rest, axis=1)))
            imu_node.within(
                f"{record.name}/specific_force", np.array(gravity), _REST, "in the median after the landing "
            )


def _read_imus(root: Node, settings: CheckSettings | None, factors: UnitFactors | None = None) -> dict[str, Any]:
    imu_node = root.child("imu")
    names = ["primary", *(name for name in sorted(imu_node.group) if name != "primary")]
    imus = [_read_imu(imu_node.child(name), name, settings, (factors or {}).get(name)) for name in names]
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


def _read_altimeter(root: Node, settings: CheckSettings | None) -> dict[str, Any]:
    """Altimeter without heights that are not finite or that repeat one value, and findings of these."""
    node = root.optional("altimeter")
    if not node:
        return {"altimeter": None}
    settings = CheckSettings() if settings is None else settings
    time = node.increasing("time", node.numbers("time", None))
    height = node.numbers("height", len(time), finite=False)
    lost = {"not_finite": ~np.isfinite(height), "stuck": np.zeros(len(time), bool)}
    if lost["not_finite"].all() and len(time):
        raise node.error("height", "has no finite reading.")
    if settings.enabled:
        for a, b in stuck_runs(height, settings.false_alarm_probability):
            lost["stuck"][a + 1 : b] = True  # the first of them was read
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    findings = [
        with_repair(finding, "not used")
        for kind, rows in lost.items()
        for finding in findings_of("altimeter", "height", kind, rows, time, step)
    ]
    used = ~(lost["not_finite"] | lost["stuck"])
    altimeter = AltimeterRecord(
        time[used],
        node.within("height", height[used][:, None], Limits("m", -1e4, 1e6))[:, 0],
        node.attribute("sigma", positive=True, limits=Limits("m", 1e-3, 1e5)),  # less is singular to working precision
        node.attribute("surface_radius", limits=_RADIUS),
    )
    return {"altimeter": altimeter, "findings": tuple(findings)}


def _read_events(root: Node) -> dict[str, Any]:
    group = root.optional("events")
    nodes = {name: group.child(name) for name in group.group} if group else {}
    return {
        "events": {name: float(node.attribute("time", limits=TIME)) for name, node in nodes.items()},
        "event_sigmas": {
            name: float(node.attribute("time_sigma", limits=Limits("s", 0.0, 1e3)))
            for name, node in nodes.items()
            if "time_sigma" in node.group.attrs
        },
    }


def _read_epoch(root: Node) -> dict[str, Any]:
    return {"epoch_utc": root.utc("epoch_utc")}


def _read_planet(root: Node) -> dict[str, Any]:
    meridian = root.attribute("prime_meridian_at_epoch", limits=Limits("rad", -6.3, 6.3, DEGREES))
    return {"prime_meridian_at_epoch": meridian, "planet": root.text("planet")}


def _parts(
    settings: CheckSettings | None, factors: UnitFactors | None = None
) -> tuple[Callable[[Node], dict[str, Any]], ...]:
    """Readers of the parts of a flight file, each of which returns arguments of `Telemetry`; ``/truth`` is not read."""
    return (
        lambda root: _read_imus(root, settings, factors), _read_initial, _read_landing, _read_parachute,
        lambda root: _read_altimeter(root, settings), _read_events, _read_epoch, _read_planet,
    )  # fmt: skip


def read_root(root: Node, settings: CheckSettings | None, factors: UnitFactors | None = None) -> dict[str, Any]:
    """Arguments of `Telemetry` from the root of a flight file."""
    contents: dict[str, Any] = {}
    for read_part in _parts(settings, factors):
        part = read_part(root)
        findings = (*contents.get("findings", ()), *part.get("findings", ()))
        contents |= part | {"findings": findings}
    parachute, event = contents["parachute"], contents["events"].get("parachute_deploy")
    if parachute is not None and event is not None and abs(parachute.time - event) > DEPLOYMENT_TOLERANCE:
        raise root.error(
            "constraints/parachute/@time",
            f"is {parachute.time:.6g} s, but the event parachute_deploy is at {event:.6g} s; both are the deployment.",
        )
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


def read_flight_file(
    path: str | Path, settings: CheckSettings | None = None, factors: UnitFactors | None = None
) -> Telemetry:
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
    factors : dict, optional
        IMU → quantity (``specific_force``, ``angular_rate``) → factor by which the stored readings are multiplied
        before they are checked.

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
        contents = read_root(root, settings, factors)
    return Telemetry(**contents, files={path.name: hashlib.sha256(path.read_bytes()).hexdigest()})
