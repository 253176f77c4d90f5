"""Validation domain, flight regimes and windows, determined from the flight (thesis sections 3.1, 3.3, 6 and 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.database import Database
from edl_filter.aero.regimes import BOUNDARY_MACH
from edl_filter.errors import InputError
from edl_filter.estimation.series import runs
from edl_filter.postflight.atmosphere import AtmosphereProfile
from edl_filter.types import Array, BoolArray

#: Threshold of the deceleration, in sigmas of its noise.
_THRESHOLD = 3.0
#: Largest noise of a force coefficient that is used, as a fraction of the database's 3 sigma (thesis section 6).
_USEFUL_FRACTION = 1.0 / 3.0
#: Small angle at which the database's stability is evaluated, rad.
_SMALL = np.deg2rad(0.5)
#: Mach number between the two instabilities, and below the second.
_FIRST_MACH, _SECOND_MACH = 22.0, 12.0
#: Averaging time of alpha_total where the database has no instability, and half the width of its window then, s.
_ENVELOPE, _HALF_WIDTH = 6.0, 5.0
#: A peak of the mean angle must exceed the mean at both ends of its range by this factor.
_PROMINENT = 1.15


@dataclass(frozen=True)
class Window:
    """An interval of the flight, s."""

    name: str
    start: float
    end: float

    def mask(self, time: Array) -> BoolArray:
        """Mask ``(N,)`` of the times ``(N,)``, s, that are within the window."""
        return (time >= self.start) & (time <= self.end)


@dataclass(frozen=True)
class Domain:
    """The part of the flight in which coefficients are defined.

    Attributes
    ----------
    threshold : float
        Least deceleration, m/s².
    start : float
        Time from which the deceleration stays above the threshold, s.
    useful : float
        Time from which the noise of the force coefficients stays below a third of the database's 3 sigma, s.
    end : float
        Last time that is used, s: just before the parachute.
    """

    threshold: float
    start: float
    useful: float
    end: float


@dataclass(frozen=True)
class FlightRegimes:
    """Times at which the flow regime changes: instabilities, boundary Mach numbers, continuum.

    Attributes
    ----------
    first, second : Window or None
        Intervals of the two static instabilities; None where there is none.
    identified_by : dict
        ``first`` and ``second`` → ``database`` (the slope of the moment at small angles is positive) or ``alpha_total``
        (largest mean angle).
    mach_times : dict
        Boundary Mach number → last time at which the Mach number falls below it, s; NaN if never.
    continuum : float or None
        Time from which the Knudsen number is below `continuum_limit`, s; None if never.
    continuum_limit : float
        The database's largest Knudsen number of continuum flow.
    """

    first: Window | None
    second: Window | None
    identified_by: dict[str, str]
    mach_times: dict[float, float]
    continuum: float | None
    continuum_limit: float


def detect_deceleration(time: Array, deceleration: Array, noise: Array) -> tuple[float, BoolArray]:
    """Threshold of the deceleration, and the samples at which the deceleration is permanently above it.

    The threshold is 3 times the noise before entry, that of the first sample.

    Parameters
    ----------
    time, deceleration, noise : (N,) arrays
        s; smoothed axial deceleration, m/s²; its one sigma, m/s².

    Returns
    -------
    threshold : float
        m/s².
    mask : (N,) array of bool

    Raises
    ------
    InputError
        The deceleration is never permanently above the threshold.
    """
    threshold = _THRESHOLD * float(noise[0])
    # permanently: up to the peak, because the threshold does not matter after it
    peak = int(np.argmax(deceleration))
    below = np.flatnonzero(~(deceleration[: peak + 1] > np.maximum(threshold, _THRESHOLD * noise[: peak + 1])))
    start = int(below[-1]) + 1 if below.size else 0
    if start > peak:
        raise InputError(
            f"The axial deceleration never rises above its threshold of {threshold:.3g} m/s^2; is x the axis of drag?"
        )
    after = np.flatnonzero(~(deceleration[peak:] > 0.0))
    stop = peak + int(after[0]) if after.size else len(time)
    mask = np.zeros(len(time), bool)
    mask[start:stop] = True
    return threshold, mask


def useful_start(time: Array, noise: Array, three_sigma: Array) -> float:
    """Time from which the noise of a force coefficient stays below a third of the database's 3 sigma.

    Parameters
    ----------
    time, noise, three_sigma : (N,) arrays
        s; one sigma of the coefficient's noise; the database's 3 sigma.

    Returns
    -------
    float
        s; NaN if never.
    """
    finite = np.flatnonzero(np.isfinite(noise) & np.isfinite(three_sigma))
    if not finite.size:
        return float("nan")
    ratio = noise[finite] / three_sigma[finite]
    best = int(np.argmin(ratio))
    noisy = np.flatnonzero(~(ratio[: best + 1] <= _USEFUL_FRACTION))
    start = int(noisy[-1]) + 1 if noisy.size else 0
    return float(time[finite[start]]) if start <= best else float("nan")


def flight_regimes(
    time: Array,
    alpha_total: Array,
    speed: Array,
    atmosphere: AtmosphereProfile,
    database: Database,
    x_over_d: ArrayLike,
    domain: Domain,
) -> FlightRegimes:
    """Instabilities, and times of Mach numbers and of the continuum.

    An instability is where the database's moment at half a degree is nose-up, in continuum flow: the first above
    Mach 22, the second between 22 and 12. Where the database has none, it is where alpha_total, averaged over 6 s, has
    its largest value in that range of Mach numbers, between the ends of the range.

    Parameters
    ----------
    time, alpha_total, speed : (N,) arrays
        s, rad, m/s.
    atmosphere : AtmosphereProfile
        Mach and Knudsen numbers.
    database : Database
        Its pitching moment is looked up.
    x_over_d : float or (N,) array
        Centre of mass behind the nose, diameters.
    domain : Domain
        Part of the flight that is considered.

    Returns
    -------
    FlightRegimes
    """
    begin = domain.useful if np.isfinite(domain.useful) else domain.start
    usable = atmosphere.valid & (time >= begin) & (time <= domain.end)
    mach, small = atmosphere.mach, np.full(int(usable.sum()), _SMALL)
    entry = database.lookup(mach[usable], atmosphere.knudsen[usable], small, speed[usable])
    unstable = np.zeros(len(time), bool)
    unstable[usable] = (entry.cm_at(np.broadcast_to(x_over_d, time.shape)[usable]) > 0.0) & ~entry.rarefied
    mach_times = {m: crossing(time[usable], mach[usable], m) for m in BOUNDARY_MACH}
    windows: dict[str, Window | None] = {}
    identified_by: dict[str, str] = {}
    for name, in_range in (("first", mach > _FIRST_MACH), ("second", (mach <= _FIRST_MACH) & (mach > _SECOND_MACH))):
        part, title = usable & in_range, f"{name} instability"
        run = _longest_run(part & unstable)
        if run is not None and time[run[1]] > time[run[0]]:
            windows[name] = Window(title, float(time[run[0]]), float(time[run[1]]))
            identified_by[name] = "database"
            continue
        peak = _envelope_peak(time, alpha_total, part)
        windows[name] = None if peak is None else Window(title, peak - _HALF_WIDTH, peak + _HALF_WIDTH)
        if peak is not None:
            identified_by[name] = "alpha_total"
    sensed = atmosphere.valid & (time >= domain.start) & (time <= domain.end)
    limit = database.continuum_limit
    rarefied = np.flatnonzero(atmosphere.knudsen[sensed] >= limit)
    begins = crossing(time[sensed], atmosphere.knudsen[sensed], limit) if rarefied.size else float(time[sensed][0])
    continuum = begins if np.isfinite(begins) else None
    return FlightRegimes(windows["first"], windows["second"], identified_by, mach_times, continuum, limit)


def crossing(time: Array, number: Array, value: float) -> float:
    """Last time at which a quantity falls through a value, by linear interpolation.

    Parameters
    ----------
    time, number : (N,) arrays
        s; the quantity, in any unit.
    value : float
        In the unit of `number`.

    Returns
    -------
    float
        s; NaN if there is no such time.
    """
    down = np.flatnonzero((number[:-1] >= value) & (number[1:] < value))
    if not down.size:
        return float("nan")
    i = int(down[-1])
    return float(time[i] + (number[i] - value) / (number[i] - number[i + 1]) * (time[i + 1] - time[i]))


def standard_windows(domain: Domain, regimes: FlightRegimes) -> tuple[Window, ...]:
    """The thesis's four windows: to the first instability, between the two, Mach 15 to 5, Mach 5 to the parachute.

    Where the flight has no first instability, Mach 25 separates the first two windows. A window of which an end is
    undefined, or whose ends are not in this order, is omitted.
    """
    first, second = regimes.first, regimes.second
    nan = float("nan")
    m25, m15, m5 = (regimes.mach_times[m] for m in BOUNDARY_MACH)
    before_second = second.start if second else nan
    if first:
        early = (
            Window("before the first instability", domain.useful, first.start),
            Window("between the instabilities", first.end, before_second),
        )
    else:
        early = (
            Window("before Mach 25", domain.useful, m25),
            Window("Mach 25 to the second instability", m25, before_second),
        )
    late = (Window("Mach 15 to Mach 5", m15, m5), Window("Mach 5 to parachute", m5, domain.end))
    return tuple(w for w in early + late if w.end > w.start)


def stated_windows(windows: Sequence[Window], domain: Domain) -> tuple[Window, ...]:
    """Windows that a mission states, after a check.

    Raises
    ------
    InputError
        Two have the same name, or one does not overlap the domain.
    """
    names = [w.name for w in windows]
    for window in windows:
        if names.count(window.name) > 1:
            raise InputError(f"postflight.windows: two windows are called '{window.name}'.")
        if window.start >= domain.end or window.end <= domain.start:
            raise InputError(
                f"postflight.windows: '{window.name}', {window.start:g} to {window.end:g} s, holds no sample; the "
                f"flight can be used from {domain.start:.1f} to {domain.end:.1f} s."
            )
    return tuple(windows)


def _longest_run(mask: BoolArray) -> tuple[int, int] | None:
    """First and last index of the longest run of true values; None if there is none."""
    start, end = max(runs(mask), key=lambda run: run[1] - run[0], default=(0, 0))
    return (start, end - 1) if end else None


def _envelope_peak(time: Array, alpha_total: Array, part: BoolArray) -> float | None:
    """Time of the largest running mean in a part of the flight, if it exceeds both ends of the part; else None."""
    index = np.flatnonzero(part)
    if index.size < 3 or time[index[-1]] - time[index[0]] < 2.0 * _ENVELOPE:
        return None
    t, a = time[index], alpha_total[index]
    area = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(t) * (a[1:] + a[:-1]))))
    centre = t[(t > t[0] + _ENVELOPE / 2) & (t < t[-1] - _ENVELOPE / 2)]
    if centre.size < 3:
        return None
    mean = np.interp(centre + _ENVELOPE / 2, t, area) - np.interp(centre - _ENVELOPE / 2, t, area)
    best = int(np.argmax(mean))
    return float(centre[best]) if mean[best] > _PROMINENT * max(mean[0], mean[-1]) else None
