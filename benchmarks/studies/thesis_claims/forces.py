"""Chapter 7 and section 7.1: Mach numbers, the thermal blanket, force coefficients by three methods."""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array
from thesis_claims.claim import (
    AGREES,
    DIFFERS,
    NEAR,
    OPEN,
    OPPORTUNITY,
    SIGMAS,
    SPIRIT,
    Finding,
    about,
    at_most,
    claim,
    judged,
    positive,
    quantity,
    undecided,
)
from thesis_claims.comparison import FORCE_PAIRS, PROXY, amplitude_ratio, excess, growth, largest_mean, mean_differences
from thesis_claims.flight import ClaimFlight

WINDOWS = "Mach numbers and thermal blanket (chapter 7)"
FORCES = "Force coefficients (section 7.1)"
ROVERS = (SPIRIT, OPPORTUNITY)
#: The thesis's uncertainty of the force coefficients (section 5).
FORCE_LIMIT = 0.01


def mach_crossing(f: ClaimFlight, mach: float, stated: float) -> Finding:
    """Time of a Mach number; the reason has the Mach number and the temperature at the stated time."""
    time, sigma = f.mach_time(mach)
    there, temperature = (float(np.interp(stated, f.time, v)) for v in (f.mach, f.post.flight.atmosphere.temperature))
    needed = temperature * (there / mach) ** 2
    return about(
        time, sigma, stated, NEAR, "s",
        {
            DIFFERS: f"Mach {there:.1f} at {stated:.0f} s here, where the air has {temperature:.0f} K; the thesis's "
            f"time needs {needed / temperature:.2f} of that, or its window does not begin at this Mach number"
        },
    )  # fmt: skip


@claim(WINDOWS, "7.2", "Mach 15 is reached at 135 s (beginning of the third window of table 7.4).", SPIRIT)
def mach_15(f: ClaimFlight) -> Finding:
    return mach_crossing(f, 15.0, 135.0)


@claim(WINDOWS, "7.2", "Mach 5 is reached at 195 s (beginning of the fourth window of tables 7.4 and 7.5).", *ROVERS)
def mach_5(f: ClaimFlight) -> Finding:
    return mach_crossing(f, 5.0, 195.0)


@claim(WINDOWS, "7", "The blanket's torque appears between the second instability and the parachute.", *ROVERS)
def blanket(f: ClaimFlight) -> Finding:
    value, sigma, time = growth(f, f.post.regimes.second.end, f.end)
    return judged(
        f"growth of the oscillation {quantity(value, sigma, '1/s')} at {time:.0f} s", value > SIGMAS * sigma,
        "its time; the cause is not shown: a constant torque cannot increase an oscillation",
    )  # fmt: skip


@claim(FORCES, "7.1", "Combined CN and database agree well from 50 to 60 s.", SPIRIT)
def early_combination(f: ClaimFlight) -> Finding:
    p = f.post.flight
    difference = p.database_measured.value["CN"] - p.moments.value["CN"]
    common = np.hypot(p.moments.systematic, p.database.angle_sigma["CN"])
    value, sigma = f.mean(difference, f.between(50.0, 60.0), p.moments.noise, common)
    return judged(
        quantity(value, sigma), abs(value) - SIGMAS * sigma <= FORCE_LIMIT / 3.0, "limit here one sigma of the database"
    )


@claim(FORCES, "7.1", "CN from the accelerometers is unreliable near 50 s: the signal is near their threshold.", SPIRIT)
def unreliable_start(f: ClaimFlight) -> Finding:
    return about(
        f.post.domain.useful,
        f.epoch_sigma,
        50.0,
        NEAR,
        "s",
        "time from which the noise of CN is below a third of the uncertainty",
    )


@claim(FORCES, "7.1", "At the first instability CN of the database lags by 5 to 10 s.", SPIRIT)
def lag(f: ClaimFlight) -> Finding:
    inside = f.between(60.0, 95.0)
    step = 0.25
    time = np.arange(60.0, 95.0, step)

    def envelope(case: str) -> Array:
        values = f.amplitude(case, "CN", "CY")
        use = inside & np.isfinite(values)
        smooth = np.convolve(np.interp(time, f.time[use], values[use]), np.ones(17) / 17.0, "same")
        return (smooth - smooth.mean()) / smooth.std()

    database, flight = envelope("database"), envelope("flight")
    lags = np.arange(-48, 49)
    score = [
        np.mean(database[max(0, n) : len(time) + min(0, n)] * flight[max(0, -n) : len(time) - max(0, n)]) for n in lags
    ]
    value = float(lags[int(np.argmax(score))] * step)
    return judged(
        quantity(value, 0.5, "s"), 5.0 <= value <= 10.0,
        {DIFFERS: "correlation of the magnitudes of CN, CY, 60–95 s; the database here is looked up by speed"},
    )  # fmt: skip


@claim(FORCES, "7.1", "The combined CN does not show the second instability: it is near zero.", SPIRIT)
def combination_in_instability(f: ClaimFlight) -> Finding:
    second = f.post.regimes.second
    inside = f.between(second.start, second.end)
    combined, flight = (float(np.nanmean(f.amplitude(c, "CN", "CY")[inside])) for c in ("combination", "flight"))
    return judged(
        f"{100.0 * combined / flight:.0f} % of the accelerometers'",
        combined < 0.5 * flight,
        "mean magnitude of CN, CY; limit here a half",
    )


@claim(FORCES, "7.1", "From Mach 25 to Mach 15 the database's CN is slightly higher than the accelerometers'.", SPIRIT)
def database_high_spirit(f: ClaimFlight) -> Finding:
    return positive(
        *excess(f, "database", "flight", ("CN", "CY"), f.between(f.mach_25, f.mach_15)), "",
        {OPEN: "mean difference of the magnitudes", AGREES: "mean difference of the magnitudes", DIFFERS: PROXY},
    )  # fmt: skip


@claim(FORCES, "7.1", "From 50 s to Mach 15 the database's CY is higher than the accelerometers'.", OPPORTUNITY)
def database_high_opportunity(f: ClaimFlight) -> Finding:
    return positive(
        *excess(f, "database", "flight", ("CN", "CY"), f.between(f.start, f.mach_15)), "",
        {OPEN: "mean difference of the magnitudes", AGREES: "mean difference of the magnitudes", DIFFERS: PROXY},
    )  # fmt: skip


@claim(FORCES, "7.1", "From Mach 5 to the parachute the three methods are similar.", SPIRIT)
def late_forces(f: ClaimFlight) -> Finding:
    rows = mean_differences(f, FORCE_PAIRS, -1)
    worst = max(rows, key=lambda d: abs(d.mean))
    return judged(
        quantity(abs(worst.mean), worst.mean_sigma), abs(worst.mean) < FORCE_LIMIT,
        f"largest mean; but the flight's amplitude is {amplitude_ratio(f, ('CN', 'CY')):.1f} times the database's",
    )  # fmt: skip


def combined_excess(f: ClaimFlight, name: str, start: float) -> tuple[float, float, float, float]:
    """Mean of combination minus accelerometers, with its sigma, and of combination minus database, with its sigma."""
    p, inside = f.post.flight, f.between(start, f.end)
    combined, c = p.moments.value[name], p.coefficients
    noise, common = np.hypot(p.moments.noise, c.noise[name]), np.hypot(p.moments.systematic, c.systematic[name])
    first = f.mean(combined - c.value[name], inside, noise, common)
    angle = np.hypot(p.moments.systematic, p.database.angle_sigma[name])
    return *first, *f.mean(combined - p.database_measured.value[name], inside, p.moments.noise, angle)


@claim(FORCES, "7.1", "From Mach 5 to the parachute the combined CN is consistently higher by about 0.002.", SPIRIT)
def combined_force_spirit(f: ClaimFlight) -> Finding:
    a, a_sigma, d, d_sigma = combined_excess(f, "CN", f.mach_5)
    text = f"{quantity(a, a_sigma)} above accelerometers, {quantity(d, d_sigma)} above database"
    within = [abs(v - 0.002) <= SIGMAS * s for v, s in ((a, a_sigma), (d, d_sigma))]
    zero = [abs(v) <= SIGMAS * s for v, s in ((a, a_sigma), (d, d_sigma))]
    if all(within) and all(zero):
        return undecided(text, "both zero and the stated number are within two sigma")
    return judged(text, all(within), {DIFFERS: f"{PROXY}; the sign changes with the oscillation"})


@claim(
    FORCES,
    "7.1",
    "From Mach 15 to the parachute the combined CY is higher than the accelerometers' (number lost).",
    OPPORTUNITY,
)
def combined_force_opportunity(f: ClaimFlight) -> Finding:
    value, sigma, *_ = combined_excess(f, "CY", f.mach_15)
    return positive(value, sigma, "", "mean; the digits are missing in the text")


@claim(
    FORCES,
    "7.1, table 7.1",
    "From 50 to 75 s the differences of CY are smaller than those of CN; beta is less than alpha.",
    SPIRIT,
)
def early_lateral(f: ClaimFlight) -> Finding:
    rows = mean_differences(f, FORCE_PAIRS, 0)
    cn, cy = (np.mean([abs(d.mean) for d in rows if d.coefficient == c]) for c in ("CN", "CY"))
    inside = f.between(50.0, 75.0)
    alpha, beta = (np.degrees(f.rms(v, inside)) for v in (f.post.alpha, f.post.beta))
    text = f"CN {cn:.4f}, CY {cy:.4f}; alpha {alpha:.1f}°, beta {beta:.1f}° rms"
    return judged(
        text, bool(cy < cn and beta < alpha),
        {DIFFERS: "a vehicle at 2 rpm turns one angle into the other within 7.5 s; y and z may be interchanged"},
    )  # fmt: skip


@claim(FORCES, "7.1, table 7.1", "In the other windows the differences of CN and CY are about the same.", SPIRIT)
def later_lateral(f: ClaimFlight) -> Finding:
    ratios = []
    for window in range(1, len(f.post.windows)):
        rows = mean_differences(f, FORCE_PAIRS, window)
        cn, cy = (np.mean([abs(d.mean) for d in rows if d.coefficient == c]) for c in ("CN", "CY"))
        ratios.append(float(cy / cn))
    text = "CY/CN " + ", ".join(f"{r:.1f}" for r in ratios)
    return judged(
        text,
        all(0.5 < r < 2.0 for r in ratios),
        {DIFFERS: "limits here 0.5 and 2; all are small against the uncertainty"},
    )


@claim(FORCES, "7.1, table 7.2", "CN and CY have about the same differences throughout.", OPPORTUNITY)
def lateral_opportunity(f: ClaimFlight) -> Finding:
    rows = [d for w in range(len(f.post.windows)) for d in mean_differences(f, FORCE_PAIRS, w)]
    cn, cy = (np.mean([abs(d.mean) for d in rows if d.coefficient == c and d.samples]) for c in ("CN", "CY"))
    return judged(
        f"CN {cn:.4f}, CY {cy:.4f}", bool(0.5 < cy / cn < 2.0), "mean over windows and methods; limits here 0.5 and 2"
    )


@claim(
    FORCES, "7.1, tables 7.1, 7.2", "All average differences of CN and CY are within the uncertainty of 0.01.", *ROVERS
)
def force_tables(f: ClaimFlight) -> Finding:
    value, sigma, where = largest_mean(f, FORCE_PAIRS)
    return at_most(value, sigma, FORCE_LIMIT, "", f"largest: {where}; the tables' digits are missing in the text")


@claim(
    FORCES, "7.1", "The differences are an order of magnitude smaller than the uncertainty: it can be reduced.", *ROVERS
)
def conservative_forces(f: ClaimFlight) -> Finding:
    value, sigma, where = largest_mean(f, {"CN": ("IMU-accels",), "CY": ("IMU-accels",)})
    share, share_sigma = 100.0 * value / FORCE_LIMIT, 100.0 * sigma / FORCE_LIMIT
    why = f"largest mean: {where}; the flight's own sigma, of alignment and wind, does not support a tenth"
    return at_most(share, share_sigma, 10.0, "% of it", why)


@claim(FORCES, "7.1", "Around Mach 15 the aerodynamics changes dramatically.", OPPORTUNITY)
def change_at_mach_15(f: ClaimFlight) -> Finding:
    value, sigma, time = growth(f, 115.0, f.end)
    mach = float(np.interp(time, f.time, f.mach))
    return judged(
        f"growth {quantity(value, sigma, '1/s')} at Mach {mach:.1f}",
        12.0 < mach < 18.0,
        "time of the fastest growth of the oscillation",
    )


@claim(FORCES, "7.1", "Large spikes of the combined coefficients are due to digital derivatives.", *ROVERS)
def spikes(f: ClaimFlight) -> Finding:
    return undecided("", "a property of the thesis's figures, which were not available")
