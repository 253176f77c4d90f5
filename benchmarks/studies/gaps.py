"""Calibration of filled gaps: the error of integrated velocity and angle over a gap divided by its predicted sigma.

Samples are removed from the driving record of a flight at random times and filled, with the second IMU and without it.
The truth is what was removed, with the sensor's noise, which is therefore added to the sigma. ``python gaps.py
SOURCE…`` takes flight files and missions (``builtin:mer_a``).
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_telemetry
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.record import SampleFinding, Telemetry
from edl_filter.telemetry.sample_repair import repaired

LENGTHS_S = (0.125, 0.5, 1.0, 3.0, 10.0, 20.0)


def with_gap(telemetry: Telemetry, first: int, count: int, two: bool, rates_alone: bool = False) -> Telemetry:
    """Telemetry with `count` samples of the driving IMU, or their rates alone, lost from the index `first` on."""
    record = telemetry.driving
    force, rate = record.specific_force.copy(), record.angular_rate.copy()
    rate[first : first + count] = np.nan
    if not rates_alone:
        force[first : first + count] = np.nan
    driving = replace(record, specific_force=force, angular_rate=rate)
    last = first + count - 1
    start, end = float(record.time[first] - record.interval[first]), float(record.time[last])
    finding = SampleFinding(record.name, "rate" if rates_alone else "all", start, end, count, "not_finite")
    checking = telemetry.checking if two else ()
    return replace(telemetry, driving=driving, checking=checking, findings=(*telemetry.findings, finding))


def ratios(telemetry: Telemetry, first: int, count: int, two: bool) -> np.ndarray:
    """Errors of the integrals of force and rate over the gap divided by their sigmas, (6,)."""
    record = telemetry.driving
    parachute = telemetry.events.get("parachute_deploy", np.inf)
    driving = repaired(with_gap(telemetry, first, count, two), parachute=parachute).driving
    rows, dt = slice(first, first + count), record.interval[first : first + count, None]
    out = []
    for name, fill, noise in (
        ("specific_force", driving.force_fill_sigma, driving.force_noise),
        ("angular_rate", driving.rate_fill_sigma, driving.rate_noise),
    ):
        sigma = np.hypot(fill, noise[:, None])
        error = np.sum((getattr(driving, name)[rows] - getattr(record, name)[rows]) * dt, axis=0)
        out.append(error / np.sqrt(np.sum((sigma[rows] * dt) ** 2, axis=0)))
    return np.concatenate(out)


def main() -> None:
    """Print one line per source, length and number of IMUs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sources", nargs="+")
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--lengths", type=float, nargs="*", default=LENGTHS_S)
    args = parser.parse_args()
    for source in args.sources:
        flight = source.endswith(".h5")
        telemetry = read_flight_file(source) if flight else read_telemetry(Mission.load(source))
        record = telemetry.driving
        interval = float(np.median(record.interval))
        for length in args.lengths:
            for two in (True, False):
                rng = np.random.default_rng(1)
                count = max(1, round(length / interval))
                start, end = (record.start + 20.0, record.time[-1] - 20.0) if flight else (95.0, 275.0)
                values = np.array([
                    ratios(telemetry, int(record.index_at(rng.uniform(start, end - length))), count, two)
                    for _ in range(args.count)
                ])  # fmt: skip
                rms = np.sqrt(np.mean(values**2))
                robust = np.median(np.abs(values)) / 0.6745
                beyond = np.mean(np.abs(values) > 3.0)
                print(
                    f"{source[-18:]:>18} {length:6.3f} s, {1 + two} IMU: rms {rms:6.2f}, by the median {robust:5.2f}, "
                    f"beyond 3 sigma {beyond:6.3f}, largest {np.abs(values).max():6.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
