"""Delay of the rates of an IMU against its forces, by the dynamics of a rigid vehicle.

The aerodynamic moment about a transverse axis is the transverse force times the distance of the centre of pressure from
the centre of mass; both follow the angle of attack without delay. By Euler's equation the rates have the moment
``M = I dω/dt + ω × I ω`` (Etkin 1972, Dynamics of Atmospheric Flight, section 5.8). If they are late by τ, it is, with
the specific force a at the centre of mass::

    M_y(t) = -k a_z(t - τ),    M_z(t) = k a_y(t - τ),    a(t - τ) = a(t) - τ da/dt

Input: a record in body axes and the inertia. Method: k and k τ are regressed in windows of some oscillations, in which
k, the slope of moment against force, is constant; it is negative, since the vehicle is stable. A quadratic in time
removes trim moments and constant errors. Rates that are corrected by the delay are regressed again. Pitch damping
resembles a delay of less than a millisecond at hypersonic speed. Output: the delay, with a sigma from the scatter of
the windows, or a finding.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from edl_filter.estimation.interpolating_spline import InterpolatingSpline, integral_spline
from edl_filter.estimation.series import runs
from edl_filter.telemetry.record import ImuRecord, SampleFinding, Telemetry
from edl_filter.types import Array

#: Length of a window, s, fewest samples in it, and least length of the means that are compared, s: of shorter ones the
#: derivatives are noisy.
_WINDOW, _FEWEST, _MEAN = 10.0, 40, 0.1
#: Share of the moment's variance that the force must explain in a window, and fewest such windows.
_EXPLAINED, _WINDOWS = 0.9, 4
#: Most iterations of the delay, the change (s) that ends them, and where they start, s. With the noise of the force's
#: derivative each finds a part of a delay; one of a quarter of an oscillation leaves the lever arm's force where it is
#: not.
_ITERATIONS, _CONVERGED, _STARTS = 40, 5e-4, (0.0, 0.25, -0.25)
#: Least delay that is named: in sampling intervals, in s, and in sigmas. On the rovers the delay is 0.010 and 0.005 s,
#: of which damping at low speed is a part, and on 16 practice flights at most 0.005 s.
_LEAST_INTERVALS, _LEAST, _SIGMAS = 0.3, 0.03, 6.0


def delay_of_rates(record: ImuRecord, inertia: Array, end: float) -> tuple[float, float] | None:
    """Delay of the rates against the forces, and one sigma, s; None if the flight does not determine it.

    Parameters
    ----------
    record : ImuRecord
        Body axes, positions relative to the centre of mass; filled samples are not used.
    inertia : (3, 3) array
        kg m², about the centre of mass, or in proportion to it.
    end : float
        Time up to which the vehicle is rigid and without a parachute, s.
    """
    windows = _windows(record, end)
    for start in _STARTS:
        estimate = _iterated(windows, inertia, start)
        if estimate is not None:
            return estimate
    return None


def with_triad_delay(telemetry: Telemetry, inertia: Array, end: float) -> Telemetry:
    """Telemetry with a finding where the rates of the driving IMU are late or early against its forces.

    Parameters
    ----------
    telemetry : Telemetry
        Repaired. With a finding of this kind it is returned as it is.
    inertia : (3, 3) array
        kg m².
    end : float
        As in `delay_of_rates`, s.
    """
    record = telemetry.driving
    if any(f.kind == "delay" for f in telemetry.findings) or not np.isfinite(end):
        return telemetry
    estimate = delay_of_rates(record, inertia, end)
    least = max(_LEAST_INTERVALS * float(np.median(record.interval)), _LEAST)
    if estimate is None or abs(estimate[0]) < max(least, _SIGMAS * estimate[1]):
        return telemetry
    words = f"rates are {abs(estimate[0]):.3f} s {'later' if estimate[0] > 0.0 else 'earlier'} than forces"
    reason = f"by the rigid vehicle's dynamics ({estimate[1]:.3f} s, 1 sigma)"
    last = float(min(end, record.time[-1]))
    finding = SampleFinding(record.name, "all", record.start, last, 0, "delay", f"{words} {reason}; kept")
    return replace(telemetry, findings=(*telemetry.findings, finding))


def _iterated(windows: list[ImuRecord], inertia: Array, start: float) -> tuple[float, float] | None:
    """Delay and one sigma, iterated from `start` (s); None where the force explains the moment in too few windows."""
    delay, sigma = start, np.inf
    for _ in range(_ITERATIONS):
        estimates = [e for window in windows if (e := _delay_in(window, inertia, delay)) is not None]
        if len(estimates) < _WINDOWS:
            return None
        value, weight = np.array([e[0] for e in estimates]), np.array([e[1] for e in estimates]) ** -2.0
        mean = float(np.average(value, weights=weight))
        variance = np.average((value - mean) ** 2, weights=weight)
        effective = np.sum(weight) ** 2 / np.sum(weight**2)
        sigma = float(np.sqrt(variance / max(effective - 1.0, 0.5) + 1.0 / np.sum(weight)))
        delay += mean
        if abs(mean) < _CONVERGED:
            break
    return delay, sigma


def _windows(record: ImuRecord, end: float) -> list[ImuRecord]:
    """Parts of a record without filled samples, of one driving instrument, each at most `_WINDOW` long."""
    usable = ~record.filled & record.complete & ~record.coning_corrected & ~record.sculling_corrected
    usable &= (record.time <= end) & (np.abs(record.interval / np.median(record.interval) - 1.0) < 0.01)
    usable[1:] &= record.unit[1:] == record.unit[:-1]
    length = max(_FEWEST, round(_WINDOW / float(np.median(record.interval))))
    parts = [np.arange(k, k + length) for a, b in runs(usable) for k in range(a, b - length + 1, length)]
    return [record.select(np.isin(np.arange(len(record)), part)) for part in parts]


def _delay_in(record: ImuRecord, inertia: Array, delay: float) -> tuple[float, float] | None:
    """Delay that remains of the rates in a window if they are moved by `delay` (s), and one sigma; or None."""
    count = max(1, round(_MEAN / float(np.median(record.interval))))
    edges = record.edges[: len(record) // count * count + 1 : count]

    def integral(means: Array) -> InterpolatingSpline:
        increments = (means * record.interval[:, None])[: len(record) // count * count]
        sums = increments.reshape(-1, count, 3).sum(axis=1)
        return integral_spline(edges, np.diff(edges), sums / np.diff(edges)[:, None])

    force, rate = integral(record.specific_force), integral(record.angular_rate)
    inside = edges[(edges > edges[0] + abs(delay)) & (edges < edges[-1] - abs(delay))]
    middle = 0.5 * (inside[1:] + inside[:-1])
    omega, change = (rate.derivative(order)(middle + delay) for order in (1, 2))
    position = record.position[len(record) // 2]
    at_centre = force.derivative()(middle) - np.cross(change, position) - np.cross(omega, np.cross(omega, position))
    slope = force.derivative(2)(middle)
    moment = change @ inertia.T + np.cross(omega, omega @ inertia.T)
    quadratic = np.vander(np.linspace(-1.0, 1.0, len(middle)), 3)

    def detrended(y: Array, z: Array) -> Array:
        return np.concatenate([v - quadratic @ np.linalg.lstsq(quadratic, v, rcond=None)[0] for v in (y, z)])

    design = np.column_stack((detrended(-at_centre[:, 2], at_centre[:, 1]), detrended(-slope[:, 2], slope[:, 1])))
    measured = detrended(moment[:, 1], moment[:, 2])
    solution, *_ = np.linalg.lstsq(design, measured, rcond=None)
    residual = measured - design @ solution
    unexplained = residual @ residual / (measured @ measured)
    if unexplained > 1.0 - _EXPLAINED or not solution[0] < 0.0:  # the vehicle is stable
        return None
    covariance = residual @ residual / len(measured) * np.linalg.inv(design.T @ design)
    return -float(solution[1] / solution[0]), float(np.sqrt(covariance[1, 1])) / abs(float(solution[0]))
