"""Small result folders with the files that runs write, by hand."""

import json

import contents
import numpy as np
from contents import cell, hypothesis, ledger_end, ledger_step

from edl_filter.results.files import LEDGER, write_json
from edl_filter.results.groups import Group
from edl_filter.results.netcdf import FORMAT_VERSION, write

TIME = np.linspace(0.0, 300.0, 601)


def result(folder, title="A flight", postflight=True):
    """Write ``result.nc`` with a trajectory and, maybe, an atmosphere and coefficients."""
    about = {"format": "edl-result", "format_version": FORMAT_VERSION, "title": title, "mission": "toy",
             "planet": "mars", "edl_filter_version": "0.1.0", "epoch_utc": "2004-01-04T04:19:52",
             "created_utc": "2026-01-01T00:00:00",
             "input_sha256": json.dumps({"flight.h5": "ab" * 32}), "versions": json.dumps({"numpy": "2.0"}),
             "mission_yaml": "name: toy\n", "trust": json.dumps({"trustworthy": True, "headline": None})}  # fmt: skip
    trajectory = Group()
    trajectory.add("time", ("time",), TIME, "s", "time")
    for name, values in {
        "altitude": 1.2e5 * np.exp(-TIME / 90.0), "speed": 5400.0 * np.exp(-TIME / 120.0), "mach": 30.0 - 0.09 * TIME,
        "dynamic_pressure": 5e3 * np.exp(-(((TIME - 128.0) / 30.0) ** 2)), "altitude_sigma": 30.0 + 0.0 * TIME,
        "speed_sigma": 0.2 + 0.0 * TIME,
    }.items():  # fmt: skip
        trajectory.add(name, ("time",), values, "1", name)
    groups = {"/": Group(attrs=about), "/trajectory": trajectory, "/constraints/landing": landing()}
    if postflight:
        groups |= aftermath()
    write(groups, folder / "result.nc")


def landing():
    group = Group()
    group.add("time", ("time",), np.array([300.0]), "s", "time")
    group.label("component", ["east (m)", "north (m)"], "component")
    group.add("innovation", ("time", "component"), np.array([[30.0, -60.0]]), "m", "innovation")
    group.add("innovation_sigma", ("time", "component"), np.array([[30.0, 30.0]]), "m", "sigma")
    return group


def aftermath():
    groups = {"/postflight": Group(attrs={"domain_start": 20.0, "domain_useful": 60.0, "domain_end": 250.0})}
    density = 1e-2 * np.exp(-(300.0 - TIME) / 40.0)
    for which, factor in (("flight", 1.1), ("preflight", 1.0)):
        group = groups[f"/postflight/atmosphere/{which}"] = Group()
        group.add("time", ("time",), TIME, "s", "time")
        group.add("altitude", ("time",), 1.2e5 * np.exp(-TIME / 90.0), "m", "altitude")
        for name, scale in (("density", 1.0), ("pressure", 3e4), ("temperature", 2e4)):
            values = 150.0 + 0.2 * TIME if name == "temperature" else scale * factor * density
            group.add(name, ("time",), values, "1", name)
            group.add(f"{name}_sigma", ("time",), 0.02 * values, "1", name)
    for which in ("flight", "preflight_density", "database", "database_measured", "database_preflight"):
        group = groups[f"/postflight/coefficients/{which}"] = Group()
        group.add("time", ("time",), TIME, "s", "time")
        for name in ("CA", "CN", "CY", "Cl", "Cm", "Cn"):
            group.add(name, ("time",), 0.01 * np.sin(TIME), "1", name)
            more = "three_sigma" if which.startswith("database") else "sigma"
            group.add(f"{name}_{more}", ("time",), 0.004 + 0.0 * TIME, "1", name)
    return groups


def summary(folder, title="A flight", **changes):
    """Write ``summary.json``."""
    event = {"utc": "2004-01-04T04:19:52.000", "altitude_m": 1.2e5, "altitude_sigma_m": 30.0, "velocity_m_s": 5400.0,
             "velocity_sigma_m_s": 0.2, "mach": 28.0, "dynamic_pressure_pa": 0.05, "flight_path_deg": -12.0,
             "alpha_total_deg": 2.4, "alpha_total_sigma_deg": 0.1}  # fmt: skip
    constraint = {"source": "landing site", "components": ["east (m)", "north (m)"], "uses": 1, "accepted_uses": 1,
                  "accepted": True, "time_s": 300.0, "innovation": [30.0, -60.0], "innovation_sigma": [30.0, 30.0],
                  "nis": 5.0, "dof": 2, "nis_interval_99_9": [0.001, 15.2], "consistent": True, "left_out": [1.0, None],
                  "left_out_sigma": [2.0, None], "left_out_nis": 0.25, "left_out_dof": 1,
                  "information_nats": 12.34, "left_out_information_nats": 0.056}  # fmt: skip
    vector = [0.0, 3.0, 4.0]
    entry = {"rotation_deg": 0.1, "rotation_j2000_deg": None, "states": {}} | dict.fromkeys(
        ("position_change_m", "position_sigma_m", "velocity_change_m_s", "velocity_sigma_m_s", "attitude_change_deg",
         "attitude_sigma_deg", "rotation_inertial_deg", "rotation_leaves_m", "rotation_leaves_m_s"), vector,
    )  # fmt: skip
    place = {
        "landed": True,
        "time_s": 299.0,
        "lat_deg": -14.5,
        "lon_deg": 175.4,
        "radius_m": 3.39e6,
        "miss_m": None,
        "sigma_m": 40.0,
    }
    content = {"trustworthy": True, "headline": None, "causes": [], "recovery": None, "mission": "toy",
               "title": title, "edl_filter_version": "0.1.0", "epoch_utc": "2004-01-04T04:19:52",
               "events": {"entry_interface": event | {"time_s": 0.0}, "parachute_deploy": event | {"time_s": 250.0},
                          "landing": event | {"time_s": 299.0}},
               "landing": place, "constraints": {"landing": constraint}, "entry_state": entry, "imu_comparison": {},
               "imu_calibration": {}, "pre_entry_bias_m_s2": None, "residuals": {}, "innovation_rms": {},
               "postflight": None, "effects": {}, "notes": [], "timing_s": {"filter": 0.3}}  # fmt: skip
    write_json(content | changes, folder / "summary.json")


def map_cell(channel, regime, t0, t1, rms):
    return cell(channel=channel, regime=regime, t0_s=t0, t1_s=t1, normalised_rms=rms, fails=rms > 1.1,
                sentence=f"{channel} in {regime}: {rms} times its sigma, 0.1 m/s^2 beyond noise.")  # fmt: skip


def diagnosis(folder, **changes):
    """Write ``diagnosis.json``."""
    cells = [map_cell(f"force_{a}", r, t0, t0 + 100.0, rms) for a, by in (("x", (1.0, 9.5)), ("y", (1.0, 0.9)))
             for r, t0, rms in (("Mach above 15", 20.0, by[0]), ("Mach below 15", 120.0, by[1]))]  # fmt: skip
    cells.append(map_cell("landing", "constraints", 300.0, 300.0, 1.6))
    wind = hypothesis(
        effect="wind", label="wind",
        same_as=["mass"], discriminated_by={"mass": "a second probe would part them"}, probability=0.98,
        gain=42.0, score_gain=30.0, error_before=9.5, channel="force_x",
        parameters={"east": {"estimate": -38.07, "sigma": 0.53, "unit": "m/s"}},
    )  # fmt: skip
    size = {"estimate": 1e-6, "sigma": 2e-6, "data_share": 0.5, "plausible": 1e-4, "smallest": 2e-5}
    content = contents.diagnosis(
        sentence="Missing: wind (gain 42 nats).", mission="toy",
        state=["2 of 5 cells of the residual map fail.", "Missing: wind (gain 42 nats).", "With it no cell fails."],
        where=[c for c in cells if c["fails"]], map=cells,
        ranking=[wind], none=0.0, onsets=[{"channel": "force_x", "time_s": 152.4, "gain": 812.0}], noise_floor=1.0,
        screening={"gyro_bias": {"gain": -5.0, "parameters": {"bx": size}}},
    )  # fmt: skip
    write_json(content | changes, folder / "diagnosis.json")


def remainder(description):
    return contents.unknown()["remainder"] | {"description": description}


def latent():
    time = np.arange(0.0, 250.0, 1.0)
    wave = np.stack([np.sin(0.1 * time + k) for k in range(3)], axis=1)
    return {"time_s": time.tolist(), "force_N": (20.0 * wave).tolist(), "force_sigma_N": (2.0 + 0.0 * wave).tolist(),
            "moment_N_m": wave.tolist(), "moment_sigma_N_m": (0.1 + 0.0 * wave).tolist()}  # fmt: skip


def noise(samples, peak=None):
    """Two channels in sigmas; `peak` is one sample of the first."""
    values = np.random.default_rng(1).normal(size=(2, samples))
    if peak is not None:
        values[0, samples // 3] = peak
    return values


def residuals(folder, samples=2000, peak=None):
    """Write ``residuals.nc``; `peak` (sigmas) is put into force x at one sample. Gives times and sigma.

    Sigma is a thousand times as large later on, so that the peak in sigmas is none in m/s².
    """
    time, scaled = np.linspace(20.0, 220.0, samples), noise(samples, peak)
    sigma = np.where(time < 120.0, 0.1, 0.1 if peak is None else 100.0)
    group = Group()
    group.add("time", ("time",), time, "s", "time")
    group.label("channel", ["force_x", "force_y"], "what is compared")
    group.text("unit", "channel", ["m/s^2", "m/s^2"], "unit")
    for name, values in (("residual", sigma * scaled), ("sigma", sigma + 0.0 * scaled), ("normalised", scaled)):
        group.add(name, ("channel", "time"), values, "1", name)
    write({"/": group}, folder / "residuals.nc")
    return time, sigma


def ledger(folder, mission="toy"):
    """Write ``ledger.jsonl``: two effects were added, and a third line says why no more."""
    lines = []
    for k, (added, before, after) in enumerate((("wind", 40.0, 6.0), ("mass", 6.0, 1.0), (None, 1.0, None))):
        common = {"step": k, "mission": mission, "model": ["wind", "mass"][:k]}
        common["errors"] = {"force_x": {"before": before, "after": after}}
        lines.append(json.dumps(ledger_step(added=added, **common) if added else ledger_end(**common)))
    (folder / LEDGER).write_text("\n".join(lines) + "\n", encoding="utf-8")


def complete_run(folder, title="A flight"):
    """Write a run with all that a report can show, but for a ledger."""
    result(folder, title)
    summary(folder, title)
    diagnosis(folder)
    residuals(folder)
