"""Faults of one IMU, with a complete second one or alone, and of the other measurements: is the answer right?

Each fault is put into a simulated flight at a random time, or over the whole flight, and the flight is reconstructed
as ``edl-filter run`` does it. The answer is right where position and velocity at the parachute's deployment are within
the ellipsoid that holds 99.73 % (three sigmas), against the simulator's truth. An outcome that is wrong is silent if
the result counts as trustworthy and nothing names the fault. Any exception but a refusal, and any RuntimeWarning, is a
crash. ``python faults.py -o faults.jsonl`` goes on where it stopped. With ``--diagnose`` the flights, in which no
effect is hidden, are diagnosed too (half a minute each).
"""

from __future__ import annotations

import tempfile
import time
import traceback
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.stats import chi2
from study_lines import append_missing, read_lines, study_parser

from edl_filter import Mission
from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.effects.registry import catalogue
from edl_filter.errors import InputError
from edl_filter.pipeline.reconstruct import FlightInputs, Reconstruction, reconstruct
from edl_filter.pipeline.trust import checked_telemetry, judge
from edl_filter.simulation import Scenario, simulate

FORCE, RATE = "specific_force", "angular_rate"
#: Limit of the squared error in units of its covariance, six degrees of freedom: three sigmas.
THREE_SIGMAS = float(chi2.ppf(0.9973, 6))

Samples = dict[str, np.ndarray]
Fault = Callable[[Samples, int, np.random.Generator], Samples | None]
#: Changes an open flight file, at a time (s).
FileFault = Callable[[h5py.File, float, np.random.Generator], None]


def removed(count: int) -> Fault:
    """Samples that are missing."""
    return lambda data, i, _: {key: np.delete(v, slice(i, i + count), axis=0) for key, v in data.items()}


def spike(key: str, size: float, count: int = 1) -> Fault:
    """Added values of random sign in one axis."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        data[key][i : i + count, rng.integers(3)] += size * rng.choice([-1.0, 1.0], count) * rng.uniform(0.5, 1, count)

    return change


def constant(count: int, value: float) -> Fault:
    """Packets whose values are all the same."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        for key in (FORCE, RATE):
            data[key][i : i + count] = value

    return change


def stuck(key: str, count: int) -> Fault:
    """An axis repeats its last value."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        axis = rng.integers(3)
        data[key][i : i + count, axis] = data[key][i, axis]

    return change


def saturated(share: float) -> Fault:
    """The accelerometers' largest axis is limited to a share of its peak before the parachute."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        before = data[FORCE][: len(data["time"]) * 2 // 3]
        axis = int(np.argmax(np.abs(before).max(axis=0)))
        limit = share * np.abs(before[:, axis]).max()
        data[FORCE][:, axis] = np.clip(data[FORCE][:, axis], -limit, limit)

    return change


def without_rates(count: int) -> Fault:
    """The gyros have no readings for a number of samples."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        data[RATE][i : i + count] = np.nan

    return change


def ended(data: Samples, i: int, _: np.random.Generator) -> Samples:
    """The IMU is dead from then on."""
    return {key: values[:i] for key, values in data.items()}


def exchanged(data: Samples, i: int, _: np.random.Generator) -> Samples:
    """Packets out of order."""
    order = np.arange(len(data["time"]))
    order[i : i + 4] = [i + 2, i + 3, i, i + 1]
    return {key: values[order] for key, values in data.items()}


def sent_twice(data: Samples, i: int, _: np.random.Generator) -> Samples:
    """Packets twice with their times."""
    return {key: np.insert(v, i + 4, v[i : i + 4], axis=0) for key, v in data.items()}


def repeated(data: Samples, i: int, _: np.random.Generator) -> None:
    """Packets twice with new times."""
    for key in (FORCE, RATE):
        data[key][i + 4 : i + 8] = data[key][i : i + 4]


def jump(step: float, count: int | None = None) -> Fault:
    """The clock jumps, for `count` packets or for ever."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        data["time"][i : None if count is None else i + count] += step

    return change


def drift(rate: float) -> Fault:
    """The clock runs fast by a constant ratio from the first sample on."""

    def change(data: Samples, _i: int, _: np.random.Generator) -> None:
        data["time"] += rate * (data["time"] - data["time"][0])

    return change


def coarse(force: float, rate: float, carried: bool) -> Fault:
    """Increments of velocity (m/s) and angle (rad) in coarse steps, with or without carrying the remainder."""

    def change(data: Samples, _i: int, _: np.random.Generator) -> None:
        interval = float(np.median(np.diff(data["time"])))
        for key, quantum in ((FORCE, force), (RATE, rate)):
            increments = data[key] * interval
            if carried:
                counts = np.diff(np.round(np.cumsum(increments, axis=0) / quantum), axis=0, prepend=0.0)
            else:
                counts = np.round(increments / quantum)
            data[key][:] = counts * quantum / interval

    return change


def stepped(key: str, change: Callable[[np.ndarray, np.random.Generator], None]) -> Fault:
    """All readings of a triad are changed from then on."""

    def apply(data: Samples, i: int, rng: np.random.Generator) -> None:
        change(data[key][i:], rng)

    return apply


def sign_of_an_axis(values: np.ndarray, rng: np.random.Generator) -> None:
    """Another sign of one axis."""
    values[:, rng.integers(3)] *= -1.0


def scaled(ratio: float) -> Callable[[np.ndarray, np.random.Generator], None]:
    """A scale error of all axes."""

    def change(values: np.ndarray, _: np.random.Generator) -> None:
        values *= 1.0 + ratio

    return change


def drifting_scale(ratio: float) -> Callable[[np.ndarray, np.random.Generator], None]:
    """A scale error that grows linearly to `ratio` at the end."""

    def change(values: np.ndarray, _: np.random.Generator) -> None:
        values *= 1.0 + np.linspace(0.0, ratio, len(values))[:, None]

    return change


def biased(size: float) -> Callable[[np.ndarray, np.random.Generator], None]:
    """A bias in one axis."""

    def change(values: np.ndarray, rng: np.random.Generator) -> None:
        values[:, rng.integers(3)] += size

    return change


def ramp(size: float) -> Callable[[np.ndarray, np.random.Generator], None]:
    """A bias of one axis that grows linearly to `size` at the end."""

    def change(values: np.ndarray, rng: np.random.Generator) -> None:
        values[:, rng.integers(3)] += np.linspace(0.0, size, len(values))

    return change


def permuted(data: Samples, i: int, rng: np.random.Generator) -> None:
    """Two axes are exchanged in both triads from then on."""
    order = [[1, 0, 2], [2, 1, 0], [0, 2, 1]][rng.integers(3)]
    for key in (FORCE, RATE):
        data[key][i:] = data[key][i:][:, order]


def bit_flips(data: Samples, i: int, rng: np.random.Generator) -> None:
    """Single values of both triads are wrong by a power of two or have another sign."""
    for key in (FORCE, RATE):
        for row in rng.integers(i // 2, i, 5):
            data[key][row, rng.integers(3)] *= rng.choice([-1.0, 0.25, 0.5, 2.0, 4.0, 8.0])


def noisy(factor: float, duration: float) -> Fault:
    """Noise that is `factor` times the stated one, for a time (s)."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        count = round(duration / float(np.median(np.diff(data["time"]))))
        for key, sigma in ((FORCE, 2.94e-3), (RATE, 2e-5)):
            data[key][i : i + count] += factor * sigma * rng.standard_normal(data[key][i : i + count].shape)

    return change


def several(data: Samples, i: int, rng: np.random.Generator) -> Samples:
    """A spike, an axis that is stuck, rows of NaN and a gap, in this order and 80 samples apart."""
    spike(FORCE, 1000.0)(data, i - 240, rng)
    stuck(RATE, 40)(data, i - 160, rng)
    constant(4, np.nan)(data, i - 80, rng)
    return removed(8)(data, i, rng) or data


def without(start: float, end: float, event: str = "") -> Fault:
    """Samples between two times (s) are missing; from the parachute's deployment or the peak of the force."""

    def change(data: Samples, _: int, _rng: np.random.Generator) -> Samples:
        time = data["time"]
        origin = 0.0
        if event == "peak":
            origin = time[np.argmax(np.linalg.norm(data[FORCE], axis=1) * (time < 200.0))]
        elif event == "end":
            origin = time[-1]
        kept = (time - origin <= start) | (time - origin > end)
        return {key: values[kept] for key, values in data.items()}

    return change


def every(count: int) -> Fault:
    """Every n-th sample is missing."""
    return lambda data, i, _: {key: v[np.arange(len(v)) % count > 0] for key, v in data.items()}


def jittering(share: float) -> Fault:
    """Times are wrong by random parts of a sampling interval."""

    def change(data: Samples, _: int, rng: np.random.Generator) -> None:
        interval = float(np.median(np.diff(data["time"])))
        data["time"] += share * interval * rng.uniform(-1.0, 1.0, len(data["time"]))

    return change


def late_readings(count: int) -> Fault:
    """Readings are late by a number of samples from then on (early, if it is negative), and their times are right."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        for key in (FORCE, RATE):
            moved = np.roll(data[key], count, axis=0)
            if count < 0:  # at rest: other samples of the rest
                moved[count:] = data[key][2 * count : count]
            data[key][i:] = moved[i:]

    return change


def frozen(count: int) -> Fault:
    """One packet is repeated in all channels."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        for key in (FORCE, RATE):
            data[key][i : i + count] = data[key][i]

    return change


def rounded_times(step: float) -> Fault:
    """Times are rounded to a step, s."""

    def change(data: Samples, _: int, _rng: np.random.Generator) -> None:
        data["time"] = step * np.round(data["time"] / step)

    return change


def equal_times(count: int) -> Fault:
    """Several packets in succession have one time."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        data["time"][i : i + count] = data["time"][i]

    return change


def multiplied(factor: float, *keys: str) -> Fault:
    """Other units."""

    def change(data: Samples, _: int, _rng: np.random.Generator) -> None:
        for key in keys:
            data[key] *= factor

    return change


def left_handed(data: Samples, _: int, _rng: np.random.Generator) -> None:
    """The y axis has another sign in both triads."""
    for key in (FORCE, RATE):
        data[key][:, 1] *= -1.0


def swapped(data: Samples, _: int, _rng: np.random.Generator) -> None:
    """The axes y and z are exchanged in both triads."""
    for key in (FORCE, RATE):
        data[key] = data[key][:, [0, 2, 1]]


def randomly_lost(share: float, count: int) -> Fault:
    """Of `count` samples, a share is missing at random."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> Samples:
        lost = np.zeros(len(data["time"]), bool)
        lost[i : i + count] = rng.uniform(size=count) < share
        return {key: values[~lost] for key, values in data.items()}

    return change


def many_gaps(data: Samples, _: int, rng: np.random.Generator) -> Samples:
    """Twenty gaps of up to nine samples."""
    lost = np.zeros(len(data["time"]), bool)
    for first in rng.integers(400, 2000, 20):
        lost[first : first + rng.integers(1, 10)] = True
    return {key: values[~lost] for key, values in data.items()}


def repeated_spikes(size: float, step: int, count: int) -> Fault:
    """Up to `count` spikes in the force, `step` samples apart."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        for row in range(i, len(data["time"]) - 400, step)[:count]:
            data[FORCE][row, rng.integers(3)] += size

    return change


def replayed(count: int) -> Fault:
    """The readings of the last `count` samples come again with new times."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        for key in (FORCE, RATE):
            data[key][i : i + count] = data[key][i - count : i]

    return change


def held(count: int, steps: int) -> Fault:
    """Each reading is repeated for `steps` samples."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        rows = i + np.arange(count) // steps * steps
        for key in (FORCE, RATE):
            data[key][i : i + count] = data[key][rows]

    return change


def scaled_for(key: str, factor: float, axis: int, count: int) -> Fault:
    """An axis is multiplied for `count` samples."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        data[key][i : i + count, axis] *= factor

    return change


def offset_for(key: str, offset: float, axis: int, count: int) -> Fault:
    """An axis has an offset for `count` samples."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        data[key][i : i + count, axis] += offset

    return change


def limited(key: str, share: float) -> Fault:
    """Each sensor is limited to a share of its largest reading before the parachute, on both sides of zero."""

    def change(data: Samples, i: int, _: np.random.Generator) -> None:
        limit = share * np.abs(data[key][data["time"] < 250.0]).max(axis=0)
        data[key] = np.clip(data[key], -limit, limit)

    return change


def always(key: str, axis: int | slice, value: float | None) -> Fault:
    """Axes that read a value in the whole record; None: the first reading of each."""

    def change(data: Samples, _: int, _rng: np.random.Generator) -> None:
        data[key][:, axis] = data[key][0, axis] if value is None else value

    return change


def fractions(count: int, size: float) -> Fault:
    """A clock that jumps by a fraction of a sampling interval, ahead or back."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> None:
        time = data["time"]
        step = size * np.median(np.diff(time))
        for k in [i] if count == 1 else np.sort(rng.integers(100, len(time) - 100, count)):
            time[k:] += step * rng.choice([-1.0, 1.0])

    return change


def additional(count: int, place: float) -> Fault:
    """Packets that are sent again with new noise, at a place between two others, in sampling intervals."""

    def change(data: Samples, i: int, rng: np.random.Generator) -> Samples:
        rows = np.sort(rng.choice(np.arange(i, min(i + 3 * count, len(data["time"]) - 5)), count, replace=False))
        noise = {FORCE: 3e-3, RATE: 3e-5, "time": 0.0}
        shift = {"time": place * np.median(np.diff(data["time"]))}
        again = {
            k: v[rows] + noise[k] * rng.standard_normal(v[rows].shape) + shift.get(k, 0.0) for k, v in data.items()
        }
        return {key: np.insert(v, rows + 1, again[key], axis=0) for key, v in data.items()}

    return change


def wrong_stamps(count: int, size: float) -> Fault:
    """Single packets whose times are wrong by a fraction of a sampling interval."""

    def change(data: Samples, _: int, rng: np.random.Generator) -> None:
        time = data["time"]
        rows = rng.choice(np.arange(100, len(time) - 100), count, replace=False)
        time[rows] += size * np.median(np.diff(time)) * rng.choice([-1.0, 1.0], count)

    return change


def shifted(key: str, count: int) -> Fault:
    """Readings of one triad that are late by a number of samples in the whole record."""

    def change(data: Samples, _: int, _rng: np.random.Generator) -> None:
        data[key] = np.roll(data[key], count, axis=0)

    return change


SAMPLE_FAULTS: dict[str, Fault] = {
    "none": lambda data, i, rng: None,
    "spike in force": spike(FORCE, 1000.0),
    "spike in rate": spike(RATE, 3.0),
    "burst in force": spike(FORCE, 300.0, 6),
    "burst in rate": spike(RATE, 2.0, 6),
    "gap of 1 s": lambda data, i, rng: removed(round(1.0 / np.median(np.diff(data["time"]))))(data, i, rng),
    "gap of 10 s": lambda data, i, rng: removed(round(10.0 / np.median(np.diff(data["time"]))))(data, i, rng),
    "NaN rows": constant(4, np.nan),
    "zeros": constant(16, 0.0),
    "stuck force": stuck(FORCE, 40),
    "stuck rate": stuck(RATE, 40),
    "saturated force": saturated(0.6),
    "dead": ended,
    "reordered": exchanged,
    "sent twice": sent_twice,
    "repeated": repeated,
    "clock ahead": jump(0.5),
    "clock back": jump(-0.5),
    "late times": jump(7.0, 3),
    "drift of 100 ppm": drift(1e-4),
    "drift of 1000 ppm": drift(1e-3),
    "drift of -1 %": drift(-1e-2),
    "coarse, carried": coarse(6.25e-3, 1e-4, True),
    "coarse, rounded": coarse(6.25e-3, 1e-4, False),
    "sign of a force axis": stepped(FORCE, sign_of_an_axis),
    "sign of a rate axis": stepped(RATE, sign_of_an_axis),
    "axes exchanged": permuted,
    "force scale of 1 %": stepped(FORCE, scaled(0.01)),
    "rate scale of 1 %": stepped(RATE, scaled(0.01)),
    "force scale drifts": stepped(FORCE, drifting_scale(0.02)),
    "rate scale drifts": stepped(RATE, drifting_scale(0.02)),
    "force bias": stepped(FORCE, biased(0.1)),
    "rate bias": stepped(RATE, biased(1e-3)),
    "force ramp": stepped(FORCE, ramp(0.2)),
    "rate ramp": stepped(RATE, ramp(2e-3)),
    "bit flips": bit_flips,
    "noise of 10 sigmas": noisy(10.0, 10.0),
    "noise of 300 sigmas": noisy(300.0, 10.0),
    "several": several,
    "gap at peak force": without(-1.0, 1.0, "peak"),
    "first 20 s": without(-np.inf, 20.0),
    "last 30 s": without(-30.0, np.inf, "end"),
    "every 10th": every(10),
    "jitter of 10 %": jittering(0.1),
    "jitter of 40 %": jittering(0.4),
    "late by 3 samples": late_readings(3),
    "early by 3 samples": late_readings(-3),
    "frozen packet": frozen(40),
    "times to 0.1 s": rounded_times(0.1),
    "equal times": equal_times(10),
    "in g": multiplied(1.0 / 9.80665, FORCE),
    "in deg/s": multiplied(180.0 / np.pi, RATE),
    "in ms": multiplied(1e3, "time"),
    "left-handed": left_handed,
    "y and z exchanged": swapped,
}


def imu(fault: Fault, *names: str) -> FileFault:
    """A fault of the samples of IMUs, the same in each."""

    def change(file: h5py.File, at: float, rng: np.random.Generator) -> None:
        seed = rng.integers(2**32) if len(names) > 1 else 0
        for name in names:
            if f"imu/{name}" not in file:
                continue
            group = file[f"imu/{name}"]
            data = {key: group[key][()] for key in ("time", FORCE, RATE)}
            random = np.random.default_rng(seed) if len(names) > 1 else rng
            data = fault(data, int(np.searchsorted(data["time"], at)), random) or data
            for key, values in data.items():
                del group[key]
                group[key] = values

    return change


def altimeter(change: Callable[[np.ndarray, np.ndarray, np.random.Generator], None]) -> FileFault:
    """A fault of the altimeter's times and heights, which `change` changes in place."""

    def apply(file: h5py.File, _: float, rng: np.random.Generator) -> None:
        group = file["altimeter"]
        time, height = group["time"][()], group["height"][()]
        change(time, height, rng)
        for key, values in (("time", time), ("height", height)):
            group[key][...] = values

    return apply


def outliers(share: float) -> Callable[[np.ndarray, np.ndarray, np.random.Generator], None]:
    """Some heights are anything up to twice the largest one."""

    def change(_: np.ndarray, height: np.ndarray, rng: np.random.Generator) -> None:
        selected = rng.random(len(height)) < share
        height[selected] = rng.uniform(0.0, 2.0 * height.max(), int(selected.sum()))

    return change


def moved(values: np.ndarray, offset: float) -> None:
    """Values with an offset, in place."""
    values += offset


def rescaled(values: np.ndarray, factor: float) -> None:
    """Values in another unit, in place."""
    values *= factor


def stuck_height(_: np.ndarray, height: np.ndarray, rng: np.random.Generator) -> None:
    """The altimeter repeats one height for a quarter of its readings."""
    i = int(rng.integers(len(height) // 2))
    height[i : i + len(height) // 4] = height[i]


def multipath(_: np.ndarray, height: np.ndarray, rng: np.random.Generator) -> None:
    """A tenth of the heights are at double range, in succession."""
    i = int(rng.integers(len(height) // 2))
    height[i : i + len(height) // 10] *= 2.0


def replaced(index: int, value: float) -> Callable[[np.ndarray, np.ndarray, np.random.Generator], None]:
    """One height is a given value."""

    def change(_: np.ndarray, height: np.ndarray, _rng: np.random.Generator) -> None:
        height[index] = value

    return change


def another_site(file: h5py.File, _: float, _rng: np.random.Generator) -> None:
    """The landing site is wrong by one degree of longitude."""
    position = file["constraints/landing/position"]
    x, y, z = position[()]
    c, s = np.cos(np.radians(1.0)), np.sin(np.radians(1.0))
    position[...] = [c * x - s * y, s * x + c * y, z]


def scalar_first(file: h5py.File, _: float, _rng: np.random.Generator) -> None:
    """The attitude at entry has its scalar part first."""
    file["initial/attitude"][...] = np.roll(file["initial/attitude"][()], 1)


def conjugated(file: h5py.File, _: float, _rng: np.random.Generator) -> None:
    """The attitude at entry is that of the inertial axes in the body's."""
    file["initial/attitude"][...] = file["initial/attitude"][()] * [-1.0, -1.0, -1.0, 1.0]


def across_parachute(*names: str) -> FileFault:
    """Samples from 1 s before to 1 s after the parachute's deployment are missing."""

    def change(file: h5py.File, at: float, rng: np.random.Generator) -> None:
        deployed = float(file["events/parachute_deploy"].attrs["time"])
        imu(without(deployed - 1.0, deployed + 1.0), *names)(file, at, rng)

    return change


def in_each(primary: Fault, secondary: Fault) -> FileFault:
    """A fault of each IMU, at independent times."""

    def change(file: h5py.File, at: float, rng: np.random.Generator) -> None:
        deployed = float(file["events/parachute_deploy"].attrs["time"])
        imu(primary, "primary")(file, at, rng)
        imu(secondary, "secondary")(file, rng.uniform(60.0, deployed - 15.0), rng)

    return change


#: Faults of the primary and of the second IMU that are put into one flight.
PAIRS = (("gap of 10 s", "spike in force"), ("spike in force", "gap of 10 s"), ("noise of 300 sigmas", "stuck rate"),
         ("sign of a rate axis", "gap of 10 s"), ("dead", "gap of 10 s"), ("rate bias", "drift of 1000 ppm"),
         ("frozen packet", "NaN rows"), ("force scale of 1 %", "coarse, rounded"),
         ("late by 3 samples", "spike in rate"), ("saturated force", "first 20 s"), ("clock ahead", "late times"),
         ("every 10th", "zeros"))  # fmt: skip
#: Faults of the primary IMU that are put into the second one, too.
SECOND = ("spike in force", "gap of 10 s", "stuck rate", "dead", "clock ahead", "late times", "drift of 1000 ppm",
          "coarse, rounded", "sign of a force axis", "sign of a rate axis", "axes exchanged", "force scale of 1 %",
          "force bias", "rate bias", "noise of 300 sigmas", "late by 3 samples", "frozen packet", "first 20 s",
          "every 10th", "in g", "in deg/s", "y and z exchanged")  # fmt: skip
FAULTS: dict[str, FileFault] = {
    **{name: imu(fault, "primary") for name, fault in SAMPLE_FAULTS.items()},
    "gap at parachute": across_parachute("primary"),
    **{f"second: {name}": imu(SAMPLE_FAULTS[name], "secondary") for name in SECOND},
    "both: gap of 1 s": imu(SAMPLE_FAULTS["gap of 1 s"], "primary", "secondary"),
    "both: gap at parachute": across_parachute("primary", "secondary"),
    "both: in g": imu(SAMPLE_FAULTS["in g"], "primary", "secondary"),
    "both: in deg/s": imu(SAMPLE_FAULTS["in deg/s"], "primary", "secondary"),
    "both: left-handed": imu(SAMPLE_FAULTS["left-handed"], "primary", "secondary"),
    "both: y and z exchanged": imu(SAMPLE_FAULTS["y and z exchanged"], "primary", "secondary"),
    "altimeter: outliers": altimeter(outliers(0.1)),
    "altimeter: 40 % outliers": altimeter(outliers(0.4)),
    "altimeter: 100 m high": altimeter(lambda time, height, rng: moved(height, 100.0)),
    "altimeter: 300 m high": altimeter(lambda time, height, rng: moved(height, 300.0)),
    "altimeter: 10 % high": altimeter(lambda time, height, rng: rescaled(height, 1.1)),
    "altimeter: in ft": altimeter(lambda time, height, rng: rescaled(height, 1.0 / 0.3048)),
    "altimeter: stuck": altimeter(stuck_height),
    "altimeter: 1 s late": altimeter(lambda time, height, rng: moved(time, 1.0)),
    "altimeter: multipath": altimeter(multipath),
    "altimeter: first": altimeter(replaced(0, 9000.0)),
    "altimeter: negative": altimeter(replaced(20, -500.0)),
    "altimeter: NaN": altimeter(replaced(20, np.nan)),
    "landing site": another_site,
    "attitude: scalar first": scalar_first,
    "attitude: conjugated": conjugated,
    **{f"{a}; second: {b}": in_each(SAMPLE_FAULTS[a], SAMPLE_FAULTS[b]) for a, b in PAIRS},
    "peak saturated": imu(saturated(0.95), "primary"),
    "gyros lost for 10 s": imu(without_rates(80), "primary"),
    "force stuck for 20 s": imu(stuck(FORCE, 160), "primary"),
    "rate stuck for 20 s": imu(stuck(RATE, 160), "primary"),
    "30 % lost for 240 samples": imu(randomly_lost(0.3, 240), "primary"),
    "20 gaps": imu(many_gaps, "primary"),
    "small spikes": imu(repeated_spikes(0.5, 40, 10), "primary"),
    "spikes to the end": imu(repeated_spikes(50.0, 60, 1000), "primary"),
    "burst of 20 in force": imu(spike(FORCE, 300.0, 20), "primary"),
    "burst of 20 in rate": imu(spike(RATE, 1.0, 20), "primary"),
    "small burst": imu(spike(FORCE, 3.0, 6), "primary"),
    "replayed": imu(replayed(80), "primary"),
    "held": imu(held(80, 4), "primary"),
    "sign of a force for 24 samples": imu(scaled_for(FORCE, -1.0, 0, 24), "primary"),
    "sign of a rate for 24 samples": imu(scaled_for(RATE, -1.0, 1, 24), "primary"),
    "force offset for 8 samples": imu(offset_for(FORCE, 1.0, 2, 8), "primary"),
    "rate offset for 8 samples": imu(offset_for(RATE, 0.05, 1, 8), "primary"),
    "limited rates": imu(limited(RATE, 0.6), "primary"),
    "force axis 0 throughout": imu(always(FORCE, 2, 0.0), "primary"),
    "rate axis 0 throughout": imu(always(RATE, 1, 0.0), "primary"),
    "rate axis at its first value": imu(always(RATE, 0, None), "primary"),
    "rates 0 throughout": imu(always(RATE, slice(None), 0.0), "primary"),
    "force axis NaN throughout": imu(always(FORCE, 1, np.nan), "primary"),
    "clock jumps 0.4 samples": imu(fractions(1, 0.4), "primary"),
    "clock jumps 0.2 samples 20 times": imu(fractions(20, 0.2), "primary"),
    "40 additional packets": imu(additional(40, 0.3), "primary"),
    "10 stamps wrong by 0.4 samples": imu(wrong_stamps(10, 0.4), "primary"),
    "forces early by a sample": imu(shifted(FORCE, -1), "primary"),
    "rates late by a sample": imu(shifted(RATE, 1), "primary"),
    "noise of 300 sigmas for 5 s": imu(noisy(300.0, 5.0), "primary"),
    "noise of 50 sigmas for 30 s": imu(noisy(50.0, 30.0), "primary"),
    "limited forces": imu(limited(FORCE, 0.8), "primary"),
    "both: limited rates": imu(limited(RATE, 0.8), "primary", "secondary"),
}


def outcome(reconstruction: Reconstruction, truth: Any) -> dict[str, Any]:
    """Squared error at the parachute, trust, and the findings."""
    time = truth.deployed
    nodes = np.array([node.time for node in reconstruction.filter_pass.nodes])
    node = int(np.argmin(np.abs(nodes - time)))
    error = reconstruction.smoothed.states[node].nav[:6] - truth.at(nodes[node : node + 1])[0][:6]
    covariance = reconstruction.smoothed.covariance[node][:6, :6]
    recovery, trust = reconstruction.recovery, judge(reconstruction)
    return {
        "square": float(error @ np.linalg.solve(covariance, error)),
        "position_m": float(np.linalg.norm(error[:3])),
        "velocity_m_s": float(np.linalg.norm(error[3:])),
        "sigma_m": float(np.sqrt(np.trace(covariance[:3, :3]))),
        "sigma_m_s": float(np.sqrt(np.trace(covariance[3:, 3:]))),
        "trustworthy": trust.trustworthy,
        "headline": trust.headline,
        "recovery": None if recovery is None else recovery.cause,
        "rejected": sorted(trust.rejected),
        "findings": sorted({f"{f.imu} {f.kind}" for f in reconstruction.telemetry.findings}),
    }


def flown(scenario: Scenario, seed: int, name: str, imus: int, diagnosed: bool = False) -> dict[str, Any]:
    """Simulate a flight, put a fault into it, reconstruct it and, if asked for, diagnose it."""
    flight = simulate(scenario, seed=seed)
    rng = np.random.default_rng([seed, list(FAULTS).index(name)])
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        path = flight.write(Path(folder) / "flight.h5")
        with h5py.File(path, "a") as file:
            if imus == 1:
                del file["imu/secondary"]
            FAULTS[name](file, rng.uniform(60.0, flight.motion.deployed - 15.0), rng)
        try:
            mission = Mission.load(scenario.mission, [f"telemetry.path={path}"])
            inputs = FlightInputs(checked) if (checked := checked_telemetry(mission)) else None
            row = outcome(reconstruct(mission, leave_one_out=False, inputs=inputs), flight.motion)
            if diagnosed:
                decided = diagnose(load_case(mission, ()), catalogue().values()).verdict
                row["diagnosis"] = {"verdict": decided.verdict, "sentence": decided.sentence}
        except InputError as error:
            row = {"refused": str(error).replace(str(path), "FLIGHT")}
        except Exception:  # the study reports every crash
            row = {"crash": traceback.format_exc()}
    return row | {"duration_s": round(time.perf_counter() - begin, 2)}


def verdict(row: dict[str, Any]) -> str:
    """``right``, ``flagged``, ``refused``, ``named`` (wrong, with a finding), ``silent`` (wrong), or ``crash``."""
    if "crash" in row:
        return "crash"
    if "refused" in row:
        return "refused"
    if not row["trustworthy"]:
        return "flagged"
    if row["square"] <= THREE_SIGMAS:
        return "right"
    return "named" if row["findings"] else "silent"


def report(rows: list[dict[str, Any]]) -> None:
    """Print one line for each fault and number of IMUs."""
    groups: dict[tuple[int, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[row["imus"], row["fault"]].append(row)
    for (imus, fault), members in sorted(groups.items(), reverse=True):
        counts = {kind: sum(verdict(r) == kind for r in members)
                  for kind in ("right", "flagged", "refused", "named", "silent", "crash")}  # fmt: skip
        named = sum(bool(r.get("findings")) or "refused" in r for r in members)
        ratio = np.median([np.sqrt(r["square"] / 6.0) for r in members if "square" in r] or [np.nan])
        listed = ", ".join(f"{k} {v}" for k, v in counts.items() if v)
        line = f"{imus} IMU {fault:<20} {len(members):3d}: {listed}; named {named}; median error {ratio:.2f} sigmas"
        diagnoses = Counter(r["diagnosis"]["verdict"] for r in members if "diagnosis" in r)
        print("; ".join([line, *(f"diagnosis {kind} {count}" for kind, count in sorted(diagnoses.items()))]))


def line_of(case: tuple[str, int, str, int], diagnosed: bool = False) -> dict[str, Any]:
    """Line of a scenario, seed, fault and number of IMUs."""
    name, seed, fault, imus = case
    row = {"scenario": name, "seed": seed, "fault": fault, "imus": imus}
    return row | flown(Scenario.load(f"builtin:{name}"), seed, fault, imus, diagnosed)


def diagnosed_line_of(case: tuple[str, int, str, int]) -> dict[str, Any]:
    """The same with the diagnosis."""
    return line_of(case, diagnosed=True)


def case_of(row: dict[str, Any]) -> tuple[str, int, str, int]:
    """Scenario, seed, fault and number of IMUs of a line."""
    return row["scenario"], row["seed"], row["fault"], row["imus"]


def main() -> None:
    """Fly what is missing in the file, then report."""
    parser = study_parser(__doc__, "study-results/faults.jsonl")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--faults", nargs="*", default=list(FAULTS))
    parser.add_argument("--imus", type=int, nargs="*", default=[2])
    parser.add_argument("--scenarios", nargs="*", default=["mer", "phoenix"])
    parser.add_argument("--diagnose", action="store_true", help="diagnose the flights")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    every = product(arguments.scenarios, seeds, arguments.faults, arguments.imus)
    cases = [case for case in every if case[3] == 2 or "second: " not in case[2]]
    append_missing(cases, diagnosed_line_of if arguments.diagnose else line_of, case_of, arguments)
    report(read_lines(arguments.output))


if __name__ == "__main__":
    main()
