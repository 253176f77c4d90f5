"""Validation domain and windows, found from the flight (thesis sections 3.3, 6 and 7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from edl_filter.aero.database import Database
from edl_filter.errors import InputError
from edl_filter.postflight.atmosphere import FlightAtmosphere

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

MACH_MARKS = (25.0, 15.0, 5.0)
#: Deceleration counts from this many times its noise on.
_THRESHOLD = 3.0
#: Force coefficients count when their noise is below this share of the database's 3 sigma (the thesis's 50 s).
_USEFUL_SHARE = 1.0 / 3.0
#: Small angle at which the database's stability is judged, rad; Mach numbers that part the two instabilities.
_SMALL = np.deg2rad(0.5)
_FIRST_MACH, _SECOND_MACH = 22.0, 12.0
#: Averaging time of alpha_total where the database shows no instability, and half the width then given to one, s.
_ENVELOPE, _HALF_WIDTH = 6.0, 5.0

#: A peak of the mean angle is this much larger than the mean at both ends of its range.
_PROMINENT = 1.15


@dataclass(frozen=True)
class Window:
    """A stretch of the flight, s."""

    name: str
    start: float
    end: float

    def mask(self, time: Array) -> Bools:
        """Samples within."""
        return (time >= self.start) & (time <= self.end)


@dataclass(frozen=True)
class Domain:
    """What of the flight can be used.

    Attributes
    ----------
    threshold : float
        Deceleration that counts, m/s².
    start : float
        From here on the deceleration stays above it, s.
    useful : float
        From here on the force coefficients' noise stays below a third of the database's 3 sigma, s.
    end : float
        Last time used, s: just before the parachute.
    """

    threshold: float
    start: float
    useful: float
    end: float


@dataclass(frozen=True)
class Marks:
    """Instabilities (None: there is none), with how each was found, and times of Mach numbers and of the continuum.

    ``found`` is ``database`` (the moment's slope at small angles is positive) or ``alpha_total`` (largest mean angle).
    From ``continuum`` (s, None if never) on the Knudsen number is below ``continuum_limit``, the database's.
    """

    first: Window | None
    second: Window | None
    found: dict[str, str]
    mach_times: dict[float, float]
    continuum: float | None
    continuum_limit: float


def sensed(time: Array, deceleration: Array, noise: Array) -> tuple[float, Bools]:
    """Threshold (3 times the noise before entry, the first sample's) and where the deceleration is above it for good.

    Parameters
    ----------
    time, deceleration, noise : (N,) arrays
        s; smoothed axial deceleration, m/s²; its one sigma.

    Raises
    ------
    InputError
        It never rises above for good.
    """
    threshold = _THRESHOLD * float(noise[0])
    # for good: up to the peak, since after it the threshold is of no interest
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


def useful_from(time: Array, noise: Array, three_sigma: Array) -> float:
    """Time from which a force coefficient's noise stays below a third of the database's 3 sigma; NaN if never."""
    good = np.flatnonzero(np.isfinite(noise) & np.isfinite(three_sigma))
    if not good.size:
        return float("nan")
    ratio = noise[good] / three_sigma[good]
    best = int(np.argmin(ratio))
    bad = np.flatnonzero(~(ratio[: best + 1] <= _USEFUL_SHARE))
    start = int(bad[-1]) + 1 if bad.size else 0
    return float(time[good[start]]) if start <= best else float("nan")


def marks(
    time: Array,
    alpha_total: Array,
    speed: Array,
    atmosphere: FlightAtmosphere,
    database: Database,
    x_over_d: float,
    domain: Domain,
) -> Marks:
    """Instabilities and Mach numbers' times.

    An instability is where the database's moment at half a degree turns the nose away, in continuum: the first above
    Mach 22, the second between 22 and 12. Where the database shows none, it is sought where alpha_total, averaged over
    6 s, is largest in that range of Mach numbers, between its ends.
    """
    begin = domain.useful if np.isfinite(domain.useful) else domain.start
    ok = atmosphere.valid & (time >= begin) & (time <= domain.end)
    mach = atmosphere.mach
    found = database.lookup(mach[ok], atmosphere.knudsen[ok], np.full(int(ok.sum()), _SMALL), speed[ok])
    unstable = np.zeros(len(time), bool)
    unstable[ok] = (found.cm_at(x_over_d) > 0.0) & ~found.rarefied
    crossings = {m: crossing(time[ok], mach[ok], m) for m in MACH_MARKS}
    windows: dict[str, Window | None] = {}
    how: dict[str, str] = {}
    for name, inside in (("first", mach > _FIRST_MACH), ("second", (mach <= _FIRST_MACH) & (mach > _SECOND_MACH))):
        here = ok & inside
        runs = _longest_run(here & unstable)
        if runs is not None and time[runs[1]] > time[runs[0]]:
            windows[name], how[name] = (
                Window(f"{name} instability", float(time[runs[0]]), float(time[runs[1]])),
                "database",
            )
            continue
        peak = _envelope_peak(time, alpha_total, here)
        windows[name] = None if peak is None else Window(f"{name} instability", peak - _HALF_WIDTH, peak + _HALF_WIDTH)
        if peak is not None:
            how[name] = "alpha_total"
    felt = atmosphere.valid & (time >= domain.start) & (time <= domain.end)
    limit = database.continuum_limit
    rarefied = np.flatnonzero(atmosphere.knudsen[felt] >= limit)
    falls = crossing(time[felt], atmosphere.knudsen[felt], limit) if rarefied.size else float(time[felt][0])
    continuum = falls if np.isfinite(falls) else None
    return Marks(windows["first"], windows["second"], how, crossings, continuum, limit)


def crossing(time: Array, number: Array, value: float) -> float:
    """Last time at which a number falls through a value, s; NaN if it does not."""
    down = np.flatnonzero((number[:-1] >= value) & (number[1:] < value))
    if not down.size:
        return float("nan")
    i = int(down[-1])
    return float(time[i] + (number[i] - value) / (number[i] - number[i + 1]) * (time[i + 1] - time[i]))


def standard_windows(domain: Domain, found: Marks) -> tuple[Window, ...]:
    """The thesis's four: up to the first instability, between the two, Mach 15 to 5, Mach 5 to the parachute.

    Where the flight shows no first instability, Mach 25 parts the first two windows. A window whose ends the flight
    does not show, or not in this order, is left out.
    """
    first, second = found.first, found.second
    nan = float("nan")
    m25, m15, m5 = (found.mach_times[m] for m in MACH_MARKS)
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
    """Windows that a mission states, checked.

    Raises
    ------
    InputError
        Two have one name, or one does not meet the part of the flight that can be used.
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


def _longest_run(mask: Bools) -> tuple[int, int] | None:
    edge = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    if not edge.size:
        return None
    starts, ends = edge[::2], edge[1::2] - 1
    longest = int(np.argmax(ends - starts))
    return int(starts[longest]), int(ends[longest])


def _envelope_peak(time: Array, alpha_total: Array, here: Bools) -> float | None:
    """Time of the largest running mean, if it stands out against both ends of the range."""
    index = np.flatnonzero(here)
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
