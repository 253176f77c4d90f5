"""Atmosphere, coefficients and their comparison in a result: groups below ``/postflight``, and tables as CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edl_filter.postflight.atmosphere import FlightAtmosphere
from edl_filter.postflight.averages import Difference, Verdict
from edl_filter.postflight.coefficients import NAMES, FlightCoefficients
from edl_filter.postflight.comparison import Combination, DatabaseCoefficients
from edl_filter.postflight.derive import Derived
from edl_filter.postflight.oscillation import Oscillation
from edl_filter.postflight.two_atmospheres import AtmosphereDifferences, Change
from edl_filter.results.groups import Group, Groups

Array = NDArray[np.float64]
AXES = ("x", "y", "z")

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
    "damping": ("1", "moment coefficient over rate D / 2V, Cmq; positive: feeds the oscillation"),
    "growth": ("1/s", "relative growth of the oscillation by the damping"),
}
ANGLE = {
    "alpha_forces": "angle of attack: reconstructed less that from forces",
    "alpha_moments": "angle of attack: reconstructed less that from moments",
    "alpha_between": "angle of attack: from forces less from moments",
    "beta_forces": "sideslip: reconstructed less that from forces",
    "beta_moments": "sideslip: reconstructed less that from moments",
    "beta_between": "sideslip: from forces less from moments",
}


def add_postflight(groups: Groups, derived: Derived) -> None:
    """Add all groups to `groups` (path → `Group`)."""
    groups["/postflight"] = Group(attrs=_root(derived))
    for name, atmosphere in (("flight", derived.flight), ("preflight", derived.preflight)):
        groups[f"/postflight/atmosphere/{name}"] = _atmosphere(derived.time, atmosphere)
    for name, flown in (("flight", derived.coefficients), ("preflight_density", derived.coefficients_preflight)):
        groups[f"/postflight/coefficients/{name}"] = _flight(derived.time, flown)
    for name, table in (
        ("database", derived.database),
        ("database_preflight", derived.database_preflight),
        ("database_measured", derived.database_measured),
    ):
        groups[f"/postflight/coefficients/{name}"] = _database(derived.time, table)
    for name, way in (
        ("forces", derived.forces),
        ("moments", derived.from_moments),
        ("forces_preflight", derived.forces_preflight),
        ("moments_preflight", derived.from_moments_preflight),
    ):
        groups[f"/postflight/combination/{name}"] = _combination(derived.time, way)
    angles = _timed(derived.time)
    for name in ("alpha", "beta", "alpha_total"):
        angles.add(name, ("time",), getattr(derived, name), "rad", f"reconstructed {name.replace('_', ' ')}")
    for name, meaning in ANGLE.items():
        ways = name.split("_")[1]
        for found, suffix, which in (
            (derived.angles, "", ""),
            (derived.angles_preflight, "_preflight", ", preflight atmosphere"),
        ):
            angles.add(f"{name}{suffix}", ("time",), getattr(found, name), "rad", f"{meaning}{which}")
            sigma = getattr(found, f"{ways}_sigma")
            angles.add(f"{name}_sigma{suffix}", ("time",), sigma, "rad", f"one sigma: {meaning}{which}")
    groups["/postflight/angles"] = angles
    groups["/postflight/motion"] = _motion(derived)
    groups["/postflight/atmosphere_differences"] = _between(derived.time, derived.between_atmospheres)
    groups["/postflight/atmosphere_averages"] = _change_rows(derived.changes)
    groups["/postflight/oscillation"] = _oscillation(derived.oscillation)
    groups["/postflight/verdicts"] = _verdict_rows(derived.verdicts)
    groups["/postflight/averages"] = _averages(derived.differences)
    groups["/postflight/averages_preflight"] = _averages(derived.differences_preflight)


def summary(derived: Derived) -> dict[str, Any]:
    """What of it belongs into ``summary.json``."""
    rolling = derived.coefficients.value["Cl"]
    part = (derived.time > 110.0) & (derived.time < 140.0)
    last = derived.time > derived.domain.end - 20.0
    return {
        "domain_s": {f.name: getattr(derived.domain, f.name) for f in fields(derived.domain)},
        "mach_times_s": {f"{k:g}": v for k, v in derived.marks.mach_times.items()},
        "instabilities_s": _instabilities(derived),
        "instabilities_found_by": dict(derived.marks.found),
        "rolling_moment_coefficient_110_140_s": _mean(rolling[part]),
        "force_less_moment_angle_last_20_s_deg": {
            name: {
                "mean": _mean(np.degrees(values[last])),
                "mean_absolute": _mean(np.abs(np.degrees(values[last]))),
                "rms": float(np.sqrt(_mean(np.degrees(values[last]) ** 2))),
            }
            for name, values in (("alpha", derived.angles.alpha_between), ("beta", derived.angles.beta_between))
        },
        "averages": [asdict(d) for d in derived.differences],
        "verdicts": [v.sentence for v in derived.verdicts],
    }


def tables(derived: Derived) -> dict[str, str]:
    """Tables as CSV text, by file name: the thesis's tables 7.1 to 7.6, and the atmosphere every kilometre."""
    return {
        "average_differences.csv": _differences_csv(
            {"flight": derived.differences, "preflight": derived.differences_preflight}
        ),
        "atmosphere_differences.csv": _rows_csv(Change, derived.changes),
        "verdicts.csv": _rows_csv(Verdict, derived.verdicts),
        "atmosphere.csv": _atmosphere_csv(derived),
    }


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def _instabilities(derived: Derived) -> dict[str, list[float] | None]:
    windows = {"first": derived.marks.first, "second": derived.marks.second}
    return {name: None if w is None else [w.start, w.end] for name, w in windows.items()}


def _root(derived: Derived) -> dict[str, Any]:
    domain, marks, points = derived.domain, derived.marks, int(derived.filters.points[-1])
    continuum = {} if marks.continuum is None else {"continuum_from": marks.continuum}
    return {
        "domain_start": domain.start,
        "domain_useful": domain.useful,
        "domain_end": domain.end,
        "threshold": domain.threshold,
        "mach_times": json.dumps({f"{k:g}": v for k, v in derived.marks.mach_times.items()}),
        "instabilities": json.dumps(_instabilities(derived)),
        "instabilities_found_by": json.dumps(derived.marks.found),
        "verdicts": json.dumps([v.sentence for v in derived.verdicts], ensure_ascii=False),
        "batch_points": points,
        "bandwidth_hz": derived.filters.bandwidth[points],
        "acceleration_bandwidth_hz": derived.filters.acceleration_bandwidth[points],
        "continuum_limit": marks.continuum_limit,
    } | continuum


def _timed(time: Array) -> Group:
    group = Group()
    group.add("time", ("time",), time, "s", "time since the epoch, middle of the sample")
    return group


def _atmosphere(time: Array, atmosphere: FlightAtmosphere) -> Group:
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


def _flight(time: Array, flown: FlightCoefficients) -> Group:
    group = _timed(time)
    _add(group, flown.value, "", "")
    _add(group, {n: flown.sigma(n) for n in NAMES}, "_sigma", "one sigma of the ")
    _add(group, flown.systematic, "_systematic", "part of it that is common to the flight, of the ")
    group.add("dynamic_pressure", ("time",), flown.dynamic_pressure, "Pa", "dynamic pressure")
    return group


def _database(time: Array, table: DatabaseCoefficients) -> Group:
    group = _timed(time)
    _add(group, table.value, "", "")
    _add(group, table.angle_sigma, "_angle_sigma", "one sigma from the angle's, of the ")
    _add(group, table.three_sigma, "_three_sigma", "the database's 3 sigma of the ")
    group.add("outside", ("time",), table.outside, "1", "1 where the table is held at its edge")
    return group


def _combination(time: Array, way: Combination) -> Group:
    group = _timed(time)
    for name in ("alpha", "beta", "alpha_total"):
        group.add(name, ("time",), getattr(way, name), "rad", f"{name.replace('_', ' ')} by inverse look-up")
    _add(group, way.value, "", "")
    for name, column in zip(way.value, range(2), strict=True):
        for kind, values in (("noise", way.noise), ("systematic", way.systematic)):
            part = np.asarray(values)
            if part.ndim == 2:
                group.add(f"{name}_{kind}", ("time",), part[:, column], "1", f"one sigma, {kind} part, of {name}")
    group.add("angle_noise", ("time",), way.angle_noise, "rad", "one sigma, noise part, of the angle in a plane")
    group.add("angle_systematic", ("time",), way.angle_systematic, "rad", "one sigma, systematic part, of the same")
    meaning = "solutions: 0 none, 1 one, 2 several, -1 not asked; of the last sample that was asked"
    group.add("status", ("time",), way.status, "1", meaning)
    return group


def _motion(derived: Derived) -> Group:
    group = _timed(derived.time)
    group.label("axis", AXES, "body axis")
    both = ("time", "axis")
    group.add("specific_force", both, derived.force, "m/s^2", "smoothed specific force at the centre of mass")
    group.add("angular_rate", both, derived.rate, "rad/s", "smoothed angular rate")
    group.add("angular_acceleration", both, derived.acceleration, "rad/s^2", "smoothed difference of rates")
    for name, values, unit in (
        ("specific_force", derived.force_sigma, "m/s^2"),
        ("angular_rate", derived.rate_sigma, "rad/s"),
        ("angular_acceleration", derived.acceleration_sigma, "rad/s^2"),
    ):
        group.add(
            f"{name}_sigma", ("time",), values, unit, f"one sigma per axis of the {name.replace('_', ' ')}, noise"
        )
    group.add("moment", both, derived.moments.moment, "N m", "moment, Euler's equations with the full tensor")
    group.add("moment_sigma", both, derived.moments.sigma, "N m", "one sigma of the moment, noise")
    group.add("moment_systematic", both, derived.moments.systematic, "N m", "one sigma of the moment, inertia")
    for name, values in derived.moments.rolling.items():
        group.add(f"rolling_{name}", ("time",), values, "N m", f"term of the rolling moment: {name}")
    return group


def _oscillation(found: Oscillation) -> Group:
    group = Group()
    group.add("time", ("time",), found.time, "s", "time since the epoch, middle of the window")
    for name, (unit, meaning) in OSCILLATION.items():
        group.add(name, ("time",), getattr(found, name), unit, meaning)
        group.add(
            f"{name}_sigma",
            ("time",),
            getattr(found, f"{name}_sigma"),
            unit,
            f"one sigma of the {name}, from residuals",
        )
    group.add("rate", ("time",), found.rate, "rad/s", "RMS of the swinging lateral rates")
    return group


def _averages(differences: list[Difference]) -> Group:
    group = Group()
    for name, meaning in (("window", "window"), ("coefficient", "coefficient"), ("pair", "what less what")):
        group.text(name, "row", [getattr(d, name) for d in differences], meaning)
    for name, unit in (("mean", "1"), ("mean_sigma", "1"), ("rms", "1"), ("three_sigma", "1"), ("percent", "%")):
        meaning = f"{name.replace('_', ' ')} of the difference, or of the database"
        group.add(name, ("row",), [getattr(d, name) for d in differences], unit, meaning)
    group.add("samples", ("row",), np.array([d.samples for d in differences], np.int64), "1", "samples in the mean")
    return group


def _between(time: Array, between: AtmosphereDifferences) -> Group:
    group = _timed(time)
    for of, name, values in between.items():
        if of == "atmosphere":
            meaning = f"{ATMOSPHERE[name][1]}: flight's less preflight, of the preflight value"
            group.add(name, ("time",), values, "%", meaning)
        else:
            what = f"{COEFFICIENT[name]}, {'MEVAD' if of == 'database' else 'flight'}"
            meaning = f"{what}: with the flight's atmosphere less the preflight one, of MEVAD's 3 sigma"
            group.add(f"{name}_{of}", ("time",), values, "%", meaning)
    return group


def _rows_csv(kind: type, rows: Sequence[Any]) -> str:
    """Rows that are all of one dataclass, a column per field."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([f.name for f in fields(kind)])
    for row in rows:
        writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in asdict(row).values()])
    return out.getvalue()


def _change_rows(rows: list[Change]) -> Group:
    group = Group()
    meanings = {"window": "window", "of": "what: atmosphere, database or flight", "quantity": "quantity"}
    for name, meaning in meanings.items():
        group.text(name, "row", [getattr(r, name) for r in rows], meaning)
    for name in ("mean", "rms", "largest"):
        meaning = f"{name} of the difference, of the preflight value or of MEVAD's 3 sigma"
        group.add(name, ("row",), [getattr(r, name) for r in rows], "%", meaning)
    group.add("samples", ("row",), np.array([r.samples for r in rows], np.int64), "1", "samples in the mean")
    return group


def _verdict_rows(rows: list[Verdict]) -> Group:
    group = Group()
    for name, meaning in (
        ("window", "window"),
        ("coefficient", "coefficient"),
        ("density", "density that the flight's was made with"),
        ("sentence", "what it says"),
    ):
        group.text(name, "row", [getattr(r, name) for r in rows], meaning)
    for name, meaning in (
        ("mean", "mean of database less flight"),
        ("mean_sigma", "one sigma of the mean"),
        ("rms", "rms of database less flight"),
        ("three_sigma", "the database's 3 sigma"),
        ("ratio", "the database's 3 sigma over what the flight supports"),
    ):
        group.add(name, ("row",), [getattr(r, name) for r in rows], "1", meaning)
    for name, meaning in (
        ("within", "1 where the mean is less than the 3 sigma"),
        ("wide", "1 where the 3 sigma is ten times what the flight supports, or more"),
    ):
        group.add(name, ("row",), np.array([getattr(r, name) for r in rows]), "1", meaning)
    return group


def _differences_csv(by_atmosphere: Mapping[str, list[Difference]]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names = [f.name if f.name != "percent" else "percent_of_three_sigma" for f in fields(Difference)]
    writer.writerow(["atmosphere", *names])
    for atmosphere, differences in by_atmosphere.items():
        for d in differences:
            writer.writerow([atmosphere, *(f"{v:.6g}" if isinstance(v, float) else v for v in asdict(d).values())])
    return out.getvalue()


def _atmosphere_csv(derived: Derived) -> str:
    """Flight-extracted and preflight atmosphere at whole kilometres, from above."""
    flight, before = derived.flight, derived.preflight
    known = flight.valid & np.isfinite(flight.density)
    altitude = flight.altitude[known][::-1]
    levels = np.arange(np.ceil(altitude[0] / 1e3), np.floor(altitude[-1] / 1e3) + 1.0)[::-1] * 1e3

    def at(values: Array) -> Array:
        return np.interp(levels, altitude, values[known][::-1])

    columns = {
        "altitude [m]": levels,
        "time [s]": at(derived.time),
        "density [kg/m^3]": at(flight.density),
        "density_sigma [kg/m^3]": at(flight.density_sigma),
        "pressure [Pa]": at(flight.pressure),
        "pressure_sigma [Pa]": at(flight.pressure_sigma),
        "temperature [K]": at(flight.temperature),
        "temperature_sigma [K]": at(flight.temperature_sigma),
        "mach [1]": at(flight.mach),
        "knudsen [1]": at(flight.knudsen),
        "CA [1]": at(flight.ca),
        "preflight_density [kg/m^3]": at(before.density),
        "preflight_temperature [K]": at(before.temperature),
    }
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(f"{v:.6g}" for v in row) for row in rows)]) + "\n"
