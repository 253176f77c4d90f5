"""Drift of the specific force at rest: on the surface it is constant in body axes, which turn with the planet.

Input: IMU records in body axes, and the time from which the vehicle rests. Method: a straight line through the specific
force of each IMU, by least squares; the slopes are combined with their variances, and tested by chi-square. Constant
errors of an accelerometer do not change them. A record that scatters about its line by more than neighbouring samples
differ is not used: it contains an impact, or the time of rest is wrong, and no sigma may hide that. Output: the slope,
where chance does not explain it.

A vehicle that moves on the surface causes a drift, and so does a record whose force at rest does not turn with the
planet: if its direction is held in inertial axes while the gyros read the planet's rotation ω, the force changes by
``-ω × f`` a second in body axes, as every constant vector does in turning axes. Within 20 s that is 1.4 mrad at the
equator. Either way the mean over the window differs from the force at either end by half of the change, and by as much
the gravity at rest is not known, along and across the force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from edl_filter import rotations
from edl_filter.estimation.series import ROBUST_SIGMA
from edl_filter.telemetry.record import SAME_TIME, ImuRecord, SampleFinding, Telemetry
from edl_filter.types import Array

#: Kind of the finding.
KIND = "rest_drift"
#: Probability by which chance causes a slope that is taken for a drift.
FALSE_ALARM = 1e-4
#: Probability by which a drift that is ``-ω × f`` differs more from it.
_SAME_DRIFT = 0.01
#: Fewest samples at rest of an IMU, and largest variance about the line over that of the noise.
_FEWEST, _LARGEST_SCATTER = 16, 2.0


@dataclass(frozen=True)
class RestDrift:
    """Drift of the specific force at rest.

    Attributes
    ----------
    start, end : float
        Window at rest, s.
    slope : (3,) array
        Change of the specific force, m/s² per s, body axes.
    sigma : (3,) array
        One sigma of it.
    force : (3,) array
        Mean specific force, m/s², body axes.
    held_in_inertial_axes : bool
        Whether the slope agrees with ``-ω × f``.
    """

    start: float
    end: float
    slope: Array
    sigma: Array
    force: Array
    held_in_inertial_axes: bool

    @property
    def change(self) -> float:
        """Size of the change over the window, m/s²."""
        return float(np.linalg.norm(self.slope)) * (self.end - self.start)

    @property
    def change_sigma(self) -> float:
        """One sigma of `change`, m/s²."""
        direction = self.slope / np.linalg.norm(self.slope)
        return float(np.linalg.norm(direction * self.sigma)) * (self.end - self.start)

    @property
    def mean_sigma(self) -> tuple[float, float]:
        """One sigma by which the mean force may differ from that of a vehicle at rest: half of its change, m/s².

        Along the force, and across it. A direction that is held in inertial axes does not change the magnitude.
        """
        direction = self.force / np.linalg.norm(self.force)
        along = float(direction @ self.slope)
        across = float(np.linalg.norm(self.slope - along * direction))
        half = 0.5 * (self.end - self.start)
        return 0.0 if self.held_in_inertial_axes else half * abs(along), half * across


def drift_at_rest(records: Sequence[ImuRecord], start: float) -> RestDrift | None:
    """Drift of the specific force from `start` (s) to the end of the records; None where chance explains it.

    Parameters
    ----------
    records : sequence of ImuRecord
        Of one vehicle. Samples that are lost or were filled in are not used, nor an IMU without a stated noise.
    start : float
        Time from which the vehicle rests, s.
    """
    information, weighted, turning, weighted_force = np.zeros((4, 3))
    end = start
    for record in records:
        read = record.complete & ~record.filled
        at_rest = read & (record.time - record.interval >= start - SAME_TIME)
        if np.count_nonzero(at_rest) < _FEWEST or not np.any(record.force_noise[at_rest]):
            continue
        window = record.select(at_rest)
        force = window.specific_force
        middle = window.middle
        time = middle - middle.mean()
        slope = time @ force / (time @ time)
        residual = force - force.mean(axis=0) - time[:, None] * slope
        scatter = np.sum(residual**2, axis=0) / (len(window) - 2)
        noise = np.maximum(np.mean(window.force_noise**2), _noise_variance(force))
        if np.any(scatter > _LARGEST_SCATTER * noise):
            continue
        variance = np.maximum(noise, scatter) / (time @ time)
        information += 1.0 / variance
        weighted += slope / variance
        weighted_force += force.mean(axis=0) / variance
        turning -= rotations.cross(window.angular_rate.mean(axis=0), force.mean(axis=0)) / variance
        end = max(end, float(window.time[-1]))
    if not information.all():
        return None
    slope, sigma = weighted / information, 1.0 / np.sqrt(information)
    if np.sum((slope / sigma) ** 2) <= chdtri(3, FALSE_ALARM):
        return None
    difference = slope - turning / information
    held = bool(np.sum((difference / sigma) ** 2) <= chdtri(3, _SAME_DRIFT))
    return RestDrift(start, end, slope, sigma, weighted_force / information, held)


def _noise_variance(force: Array) -> Array:
    """Variance of white noise ``(3,)`` from the differences of neighbouring samples, by their median."""
    return (ROBUST_SIGMA * np.median(np.abs(np.diff(force, axis=0)), axis=0)) ** 2 / 2.0


def with_rest_drift(telemetry: Telemetry) -> Telemetry:
    """Telemetry with the drift of its force at rest among its findings, and the sigma that follows from it.

    The same object where there is none.
    """
    if telemetry.landing is None:
        return telemetry
    drift = drift_at_rest((telemetry.driving, *telemetry.checking), telemetry.landing.time)
    if drift is None:
        return telemetry
    count = int(np.count_nonzero(telemetry.driving.time > drift.start + SAME_TIME))
    finding = SampleFinding(telemetry.driving.name, "force", drift.start, drift.end, count, KIND, _phrase(drift))
    return replace(telemetry, findings=(*telemetry.findings, finding), rest_force_sigma=drift.mean_sigma)


def _phrase(drift: RestDrift) -> str:
    """What was found and what is done about it."""
    cause = (
        "its direction is held in inertial axes and does not turn with the planet as the gyros do"
        if drift.held_in_inertial_axes
        else "the vehicle moves, or its accelerometers drift"
    )
    along, across = (f"{1e3 * value:.1f}" for value in drift.mean_sigma)
    vertical = "" if drift.held_in_inertial_axes else f"{along} mm/s² vertically and "
    change, change_sigma = 1e3 * drift.change, 1e3 * drift.change_sigma
    return (
        f"it changes by {change:.1f} ± {change_sigma:.1f} mm/s² ({cause}); kept, and gravity at rest has a sigma of "
        f"{vertical}{across} mm/s² horizontally"
    )
