"""The post-flight layer in a result: groups below ``/postflight``, part of ``summary.json``, and tables as CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from typing import Any

import numpy as np

from edl_filter.postflight.atmosphere import AtmosphereProfile
from edl_filter.postflight.averages import Difference, Verdict
from edl_filter.postflight.coefficients import NAMES, FlightCoefficients
from edl_filter.postflight.comparison import Combination, DatabaseCoefficients
from edl_filter.postflight.derive import PostflightResult
from edl_filter.postflight.oscillation import Oscillation
from edl_filter.postflight.two_atmospheres import AtmosphereDifferences, Change
from edl_filter.results.files import POSTFLIGHT_TABLES
from edl_filter.results.groups import Group, Groups
from edl_filter.types import AXES, Array

ATMOSPHERE = {
    "altitude": ("m", "areodetic altitude"),
    "density": ("kg/m^3", "density"),
    "pressure": ("Pa", "pressure"),
    "temperature": ("K", "temperature"),
    "mach": ("1", "Mach number"),
    "knudsen": ("1", "Knudsen number on the diameter"),
    "ca": ("1", "axial-force coefficient of the database"),
    "density_sigma": ("kg/m^3", "one sigma of the density"),
    "pressure_sigma": ("Pa", "one sigma of the pressure"),
    "temperature_sigma": ("K", "one sigma of the temperature"),
}
COEFFICIENT = {
    "CA": "axial-force coefficient, along -x",
    "CN": "normal-force coefficient, along -z",
    "CY": "side-force coefficient, along +y",
    "Cl": "rolling-moment coefficient, about x",
    "Cm": "pitching-moment coefficient, about y at the centre of mass",
    "Cn": "yawing-moment coefficient, about z at the centre of mass",
}
OSCILLATION = {
    "stiffness": ("1/rad", "slope of the moment coefficients over the angles, Cm_alpha; negative: stable"),
    "damping": ("1", "moment coefficient over rate D / 2V, Cmq; positive: amplifies the oscillation"),
    "growth": ("1/s", "relative growth rate of the oscillation due to the damping"),
}
ANGLE = {
    "alpha_forces": "angle of attack: reconstructed minus that from forces",
    "alpha_moments": "angle of attack: reconstructed minus that from moments",
    "alpha_between": "angle of attack: from forces minus from moments",
    "beta_forces": "sideslip: reconstructed minus that from forces",
    "beta_moments": "sideslip: reconstructed minus that from moments",
    "beta_between": "sideslip: from forces minus from moments",
}


def add_postflight(groups: Groups, postflight: PostflightResult) -> None:
    """Add all groups of the post-flight layer to `groups` (path → `Group`)."""
    time, flight, preflight = postflight.time, postflight.flight, postflight.preflight
    groups["/postflight"] = Group(attrs=_root(postflight))
    for path, group in (
        ("atmosphere/flight", _atmosphere(time, flight.atmosphere)),
        ("atmosphere/preflight", _atmosphere(time, preflight.atmosphere)),
        ("coefficients/flight", _flight(time, flight.coefficients)),
        ("coefficients/preflight_density", _flight(time, preflight.coefficients)),
        ("coefficients/database", _database(time, flight.database)),
        ("coefficients/database_preflight", _database(time, preflight.database)),
        ("coefficients/database_measured", _database(time, flight.database_measured)),
        ("combination/forces", _combination(time, flight.forces)),
        ("combination/moments", _combination(time, flight.moments)),
        ("combination/forces_preflight", _combination(time, preflight.forces)),
        ("combination/moments_preflight", _combination(time, preflight.moments)),
        ("angles", _angles(postflight)),
        ("motion", _motion(postflight)),
        ("atmosphere_differences", _between(time, postflight.between_atmospheres)),
        ("atmosphere_averages", _changes(postflight.changes)),
        ("oscillation", _oscillation(postflight.oscillation)),
        ("verdicts", _verdicts(postflight.verdicts)),
        ("averages", _averages(flight.differences)),
        ("averages_preflight", _averages(preflight.differences)),
    ):
        groups[f"/postflight/{path}"] = group


def summary(postflight: PostflightResult) -> dict[str, Any]:
    """The part of ``summary.json`` under ``postflight``."""
    rolling, angles = postflight.flight.coefficients.value["Cl"], postflight.flight.angles
    part = (postflight.time > 110.0) & (postflight.time < 140.0)
    last = postflight.time > postflight.domain.end - 20.0
    return {
        "domain_s": {f.name: getattr(postflight.domain, f.name) for f in fields(postflight.domain)},
        "smoothing": _smoothing(postflight),
        "mach_times_s": {f"{k:g}": v for k, v in postflight.regimes.mach_times.items()},
        "instabilities_s": _instabilities(postflight),
        "instabilities_found_by": dict(postflight.regimes.identified_by),
        "rolling_moment_coefficient_110_140_s": _mean(rolling[part]),
        "force_less_moment_angle_last_20_s_deg": {
            name: {
                "mean": _mean(np.degrees(values[last])),
                "mean_absolute": _mean(np.abs(np.degrees(values[last]))),
                "rms": float(np.sqrt(_mean(np.degrees(values[last]) ** 2))),
            }
            for name, values in (("alpha", angles.alpha_between), ("beta", angles.beta_between))
        },
        "averages": [asdict(d) for d in postflight.flight.differences],
        "verdicts": [v.sentence for v in postflight.verdicts],
    }


def tables(postflight: PostflightResult) -> dict[str, str]:
    """Tables as CSV text, by file name: the thesis's tables 7.1 to 7.6, and the atmosphere every kilometre."""
    texts = (
        _differences_csv({"flight": postflight.flight.differences, "preflight": postflight.preflight.differences}),
        _csv(_columns(Change), postflight.changes),
        _csv(_columns(Verdict), postflight.verdicts),
        _atmosphere_csv(postflight),
    )
    return dict(zip(POSTFLIGHT_TABLES, texts, strict=True))


def _mean(values: Array) -> float:
    """Mean of the finite values; NaN if there is none."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else float("nan")


def _instabilities(postflight: PostflightResult) -> dict[str, list[float] | None]:
    windows = {"first": postflight.regimes.first, "second": postflight.regimes.second}
    return {name: None if w is None else [w.start, w.end] for name, w in windows.items()}


def _root(postflight: PostflightResult) -> dict[str, Any]:
    domain, regimes = postflight.domain, postflight.regimes
    continuum = {} if regimes.continuum is None else {"continuum_from": regimes.continuum}
    return {
        "domain_start": domain.start,
        "domain_useful": domain.useful,
        "domain_end": domain.end,
        "threshold": domain.threshold,
        "mach_times": json.dumps({f"{k:g}": v for k, v in regimes.mach_times.items()}),
        "instabilities": json.dumps(_instabilities(postflight)),
        "instabilities_found_by": json.dumps(regimes.identified_by),
        "verdicts": json.dumps([v.sentence for v in postflight.verdicts], ensure_ascii=False),
        "continuum_limit": regimes.continuum_limit,
        **{name: value for name, value in _smoothing(postflight).items() if value is not None},
    } | continuum


def _smoothing(postflight: PostflightResult) -> dict[str, Any]:
    """Smoothing of forces and rates at the end of the domain; a low-pass that there is not is None."""
    smoother = postflight.motion.smoother
    points = int(smoother.points[-1])
    return {
        "batch_points": points,
        "low_pass_hz": smoother.low_pass_hz,
        "bandwidth_hz": smoother.bandwidth[points],
        "acceleration_bandwidth_hz": smoother.acceleration_bandwidth[points],
    }


def _timed(time: Array) -> Group:
    group = Group()
    group.add("time", ("time",), time, "s", "time since the epoch, middle of the sample")
    return group


def _atmosphere(time: Array, atmosphere: AtmosphereProfile) -> Group:
    group = _timed(time)
    group.attrs["iterations"] = atmosphere.iterations
    for name, (unit, meaning) in ATMOSPHERE.items():
        group.add(name, ("time",), getattr(atmosphere, name), unit, meaning)
    group.add("density_noise", ("time",), atmosphere.density_noise, "kg/m^3", "part of density_sigma that is noise")
    group.add("valid", ("time",), atmosphere.valid, "1", "1 where the deceleration is above the threshold for good")
    return group


def _add(group: Group, values: Mapping[str, Array], suffix: str, what: str) -> None:
    for name, value in values.items():
        group.add(f"{name}{suffix}", ("time",), value, "1", f"{what}{COEFFICIENT[name]}")


def _flight(time: Array, coefficients: FlightCoefficients) -> Group:
    group = _timed(time)
    _add(group, coefficients.value, "", "")
    _add(group, {n: coefficients.sigma(n) for n in NAMES}, "_sigma", "one sigma of the ")
    _add(group, coefficients.systematic, "_systematic", "part of the sigma that is common to the flight, of the ")
    group.add("dynamic_pressure", ("time",), coefficients.dynamic_pressure, "Pa", "dynamic pressure")
    return group


def _database(time: Array, table: DatabaseCoefficients) -> Group:
    group = _timed(time)
    _add(group, table.value, "", "")
    _add(group, table.angle_sigma, "_angle_sigma", "one sigma due to that of the angle, of the ")
    _add(group, table.three_sigma, "_three_sigma", "the database's 3 sigma of the ")
    group.add("outside", ("time",), table.outside, "1", "1 where the table is held at its edge")
    return group


def _combination(time: Array, combination: Combination) -> Group:
    group = _timed(time)
    for name in ("alpha", "beta", "alpha_total"):
        values = getattr(combination, name)
        group.add(name, ("time",), values, "rad", f"{name.replace('_', ' ')} by inverse look-up")
    _add(group, combination.value, "", "")
    for kind, values in (("noise", combination.angle_noise), ("systematic", combination.angle_systematic)):
        group.add(f"angle_{kind}", ("time",), values, "rad", f"one sigma, {kind} part, of the angle in a plane")
    meaning = "solutions: 0 none, 1 one, 2 several, -1 no look-up; of the last sample that was looked up"
    group.add("status", ("time",), combination.status, "1", meaning)
    return group


def _angles(postflight: PostflightResult) -> Group:
    group = _timed(postflight.time)
    for name in ("alpha", "beta", "alpha_total"):
        group.add(name, ("time",), getattr(postflight, name), "rad", f"reconstructed {name.replace('_', ' ')}")
    for name, meaning in ANGLE.items():
        kind = name.split("_")[1]
        for case, suffix, which in (
            (postflight.flight, "", ""),
            (postflight.preflight, "_preflight", ", preflight atmosphere"),
        ):
            group.add(f"{name}{suffix}", ("time",), getattr(case.angles, name), "rad", f"{meaning}{which}")
            sigma = getattr(case.angles, f"{kind}_sigma")
            group.add(f"{name}_sigma{suffix}", ("time",), sigma, "rad", f"one sigma: {meaning}{which}")
    return group


def _motion(postflight: PostflightResult) -> Group:
    motion = postflight.motion
    group = _timed(postflight.time)
    group.label("axis", AXES, "body axis")
    both = ("time", "axis")
    group.add("specific_force", both, motion.force, "m/s^2", "smoothed specific force at the centre of mass")
    group.add("angular_rate", both, motion.rate, "rad/s", "smoothed angular rate")
    group.add("angular_acceleration", both, motion.acceleration, "rad/s^2", "smoothed difference of rates")
    for name, values, unit in (
        ("specific_force", motion.force_sigma, "m/s^2"),
        ("angular_rate", motion.rate_sigma, "rad/s"),
        ("angular_acceleration", motion.acceleration_sigma, "rad/s^2"),
    ):
        group.add(
            f"{name}_sigma", ("time",), values, unit, f"one sigma per axis of the {name.replace('_', ' ')}, noise"
        )
    group.add("moment", both, motion.moments.moment, "N m", "moment, Euler's equations with the full tensor")
    group.add("moment_sigma", both, motion.moments.sigma, "N m", "one sigma of the moment, noise")
    group.add("moment_systematic", both, motion.moments.systematic, "N m", "one sigma of the moment, inertia")
    for name, values in motion.moments.rolling.items():
        group.add(f"rolling_{name}", ("time",), values, "N m", f"term of the rolling moment: {name}")
    return group


def _oscillation(oscillation: Oscillation) -> Group:
    group = Group()
    group.add("time", ("time",), oscillation.time, "s", "time since the epoch, middle of the window")
    for name, (unit, meaning) in OSCILLATION.items():
        sigma = getattr(oscillation, f"{name}_sigma")
        group.add(name, ("time",), getattr(oscillation, name), unit, meaning)
        group.add(f"{name}_sigma", ("time",), sigma, unit, f"one sigma of the {name}, from residuals")
    group.add("rate", ("time",), oscillation.rate, "rad/s", "RMS of the oscillating part of the lateral rates")
    return group


def _add_columns(group: Group, rows: Sequence[Any], columns: Sequence[tuple[str, str, str]]) -> None:
    """Add attributes of rows as variables along ``row``: name, unit (empty for text) and meaning of each."""
    for name, unit, meaning in columns:
        values = [getattr(row, name) for row in rows]
        if unit:
            # without rows the type of a count would be lost
            group.add(name, ("row",), np.array(values, np.int64 if name == "samples" else None), unit, meaning)
        else:
            group.text(name, "row", values, meaning)


def _averages(differences: list[Difference]) -> Group:
    group = Group()
    meaning = "{} of the difference, or of the database"
    _add_columns(group, differences, (
        ("window", "", "window"),
        ("coefficient", "", "coefficient"),
        ("pair", "", "what minus what"),
        ("mean", "1", meaning.format("mean")),
        ("mean_sigma", "1", meaning.format("mean sigma")),
        ("rms", "1", meaning.format("rms")),
        ("three_sigma", "1", meaning.format("three sigma")),
        ("percent", "%", meaning.format("percent")),
        ("samples", "1", "samples in the mean"),
    ))  # fmt: skip
    return group


def _between(time: Array, between: AtmosphereDifferences) -> Group:
    group = _timed(time)
    for of, name, values in between.items():
        if of == "atmosphere":
            meaning = f"{ATMOSPHERE[name][1]}: flight's minus preflight, of the preflight value"
            group.add(name, ("time",), values, "%", meaning)
        else:
            what = f"{COEFFICIENT[name]}, {'MEVAD' if of == 'database' else 'flight'}"
            meaning = f"{what}: with the flight's atmosphere minus the preflight one, of MEVAD's 3 sigma"
            group.add(f"{name}_{of}", ("time",), values, "%", meaning)
    return group


def _changes(rows: list[Change]) -> Group:
    group = Group()
    meaning = "{} of the difference, of the preflight value or of MEVAD's 3 sigma"
    _add_columns(group, rows, (
        ("window", "", "window"),
        ("of", "", "kind: atmosphere, database or flight"),
        ("quantity", "", "quantity"),
        *((name, "%", meaning.format(name)) for name in ("mean", "rms", "largest")),
        ("samples", "1", "samples in the mean"),
    ))  # fmt: skip
    return group


def _verdicts(rows: list[Verdict]) -> Group:
    group = Group()
    _add_columns(group, rows, (
        ("window", "", "window"),
        ("coefficient", "", "coefficient"),
        ("density", "", "density from which the flight's coefficient is computed"),
        ("sentence", "", "the verdict as text"),
        ("mean", "1", "mean of database minus flight"),
        ("mean_sigma", "1", "one sigma of the mean"),
        ("rms", "1", "rms of database minus flight"),
        ("three_sigma", "1", "the database's 3 sigma"),
        ("ratio", "1", "the database's 3 sigma over the uncertainty that the flight supports"),
        ("within", "1", "1 where the mean is less than the 3 sigma"),
        ("wide", "1", "1 where the 3 sigma is ten times the uncertainty that the flight supports, or more"),
    ))  # fmt: skip
    return group


def _columns(kind: type) -> list[str]:
    """Names of the fields of a dataclass, which are the columns of its table."""
    return [f.name for f in fields(kind)]


def _csv(columns: Sequence[str], rows: Iterable[Any]) -> str:
    """A table as CSV text; rows are dataclasses, or sequences of values."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        values = asdict(row).values() if is_dataclass(row) and not isinstance(row, type) else row
        writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in values])
    return out.getvalue()


def _differences_csv(by_atmosphere: Mapping[str, list[Difference]]) -> str:
    names = [name if name != "percent" else "percent_of_three_sigma" for name in _columns(Difference)]
    rows = [[atmosphere, *asdict(d).values()] for atmosphere, rows in by_atmosphere.items() for d in rows]
    return _csv(["atmosphere", *names], rows)


def _atmosphere_csv(postflight: PostflightResult) -> str:
    """Flight-extracted and preflight atmosphere at whole kilometres, from the top downwards."""
    flight, preflight = postflight.flight.atmosphere, postflight.preflight.atmosphere
    valid = flight.valid & np.isfinite(flight.density)
    altitude = flight.altitude[valid][::-1]
    levels = np.arange(np.ceil(altitude[0] / 1e3), np.floor(altitude[-1] / 1e3) + 1.0)[::-1] * 1e3

    def at_levels(values: Array) -> Array:
        return np.interp(levels, altitude, values[valid][::-1])

    columns = {
        "altitude [m]": levels,
        "time [s]": at_levels(postflight.time),
        "density [kg/m^3]": at_levels(flight.density),
        "density_sigma [kg/m^3]": at_levels(flight.density_sigma),
        "pressure [Pa]": at_levels(flight.pressure),
        "pressure_sigma [Pa]": at_levels(flight.pressure_sigma),
        "temperature [K]": at_levels(flight.temperature),
        "temperature_sigma [K]": at_levels(flight.temperature_sigma),
        "mach [1]": at_levels(flight.mach),
        "knudsen [1]": at_levels(flight.knudsen),
        "CA [1]": at_levels(flight.ca),
        "preflight_density [kg/m^3]": at_levels(preflight.density),
        "preflight_temperature [K]": at_levels(preflight.temperature),
    }
    return _csv(list(columns), zip(*columns.values(), strict=True))
