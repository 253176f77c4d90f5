"""Comparison of coefficients by three methods: averages over windows, magnitudes, growth of the oscillation."""

from __future__ import annotations

import numpy as np

from edl_filter.types import BoolArray
from thesis_claims.claim import SIGMAS
from thesis_claims.flight import ClaimFlight

PROXY = "the database here is Phoenix's, a proxy for MER's own"
#: Methods of the thesis's tables 7.1 to 7.6, by coefficient: IMU is the database at the reconstructed angles.
FORCE_PAIRS = {"CN": ("IMU-accels", "IMU-Cm", "accels-Cm"), "CY": ("IMU-accels", "IMU-Cn", "accels-Cn")}
MOMENT_PAIRS = {"Cm": ("IMU-gyros", "IMU-CN", "gyros-CN"), "Cn": ("IMU-gyros", "IMU-CY", "gyros-CY")}


def mean_differences(f: ClaimFlight, pairs: dict[str, tuple[str, ...]], window: int) -> list:
    """Averages over one window (its index) of all methods and coefficients of a table."""
    name = f.post.windows[window].name
    return [d for c, p in pairs.items() for d in f.differences(p, (c,)) if d.window == name]


def largest_mean(f: ClaimFlight, pairs: dict[str, tuple[str, ...]], relative: bool = False) -> tuple[float, float, str]:
    """Largest average over all windows with its sigma, as a number or in percent of 3 sigma, and where it is."""
    rows = [d for w in range(len(f.post.windows)) for d in mean_differences(f, pairs, w) if d.samples]
    k = int(np.argmax([abs(d.percent if relative else d.mean) for d in rows]))
    scale = 100.0 / rows[k].three_sigma if relative else 1.0
    return (
        abs(rows[k].mean) * scale,
        rows[k].mean_sigma * scale,
        f"{rows[k].coefficient}, {rows[k].pair}, {rows[k].window}",
    )


def excess(f: ClaimFlight, first: str, second: str, names: tuple[str, str], inside: BoolArray) -> tuple[float, float]:
    """Mean of the difference of two methods' magnitudes, and its sigma: those of the flight's two coefficients."""
    c = f.post.flight.coefficients
    noise, common = (np.hypot(v[names[0]], v[names[1]]) / np.sqrt(2.0) for v in (c.noise, c.systematic))
    angle = np.hypot(*(f.post.flight.database.angle_sigma[n] for n in names)) / np.sqrt(2.0)
    return f.mean(f.amplitude(first, *names) - f.amplitude(second, *names), inside, noise, np.hypot(common, angle))


def growth(f: ClaimFlight, start: float, end: float) -> tuple[float, float, float]:
    """Largest significant growth rate of the oscillation between two times, its sigma, and its time."""
    o = f.post.oscillation
    use = np.flatnonzero((o.time > start) & (o.time < end) & (o.growth > SIGMAS * o.growth_sigma))
    k = use[int(np.argmax(o.growth[use]))]
    return float(o.growth[k]), float(o.growth_sigma[k]), float(o.time[k])


def amplitude_ratio(f: ClaimFlight, names: tuple[str, str]) -> float:
    """Slope of the flight's coefficients on the database's from Mach 5 to the parachute, mean of two coefficients."""
    inside, slopes = f.between(f.mach_5, f.end), []
    for name in names:
        database = f.post.flight.database_measured.value[name][inside]
        flight = f.post.flight.coefficients.value[name][inside]
        both = np.isfinite(database) & np.isfinite(flight)
        database, flight = database[both] - database[both].mean(), flight[both] - flight[both].mean()
        slopes.append(float(flight @ database / (database @ database)))
    return float(np.mean(slopes))
