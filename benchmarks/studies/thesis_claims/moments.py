"""Sections 7.2 and 7.3: moment coefficients by three methods, and the rolling moment."""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array
from thesis_claims.claim import (
    AGREES,
    DIFFERS,
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
from thesis_claims.comparison import (
    MOMENT_PAIRS,
    PROXY,
    amplitude_ratio,
    excess,
    growth,
    largest_mean,
    mean_differences,
)
from thesis_claims.flight import ClaimFlight

MOMENTS = "Moment coefficients (section 7.2)"
ROLL = "Rolling moment (section 7.3)"
ROVERS = (SPIRIT, OPPORTUNITY)


@claim(MOMENTS, "7.2", "The three methods for Cm agree well throughout.", SPIRIT)
def moments_agree(f: ClaimFlight) -> Finding:
    value, sigma, where = largest_mean(f, {"Cm": MOMENT_PAIRS["Cm"]}, relative=True)
    return judged(
        f"{quantity(value, sigma, '%')} of 3 sigma",
        value < 100.0,
        f"largest mean: {where}; 3 sigma is remembered, not printed in the text",
    )


@claim(MOMENTS, "7.2", "The torque of the remnants is clearly visible from Mach 5 to the parachute.", SPIRIT)
def blanket_at_mach_5(f: ClaimFlight) -> Finding:
    value, sigma, time = growth(f, f.post.regimes.second.end, f.end)
    mach = float(np.interp(time, f.time, f.mach))
    return judged(
        f"growth {quantity(value, sigma, '1/s')} at Mach {mach:.1f}",
        4.0 <= mach <= 6.0,
        "time of the fastest growth of the oscillation; limits here Mach 4 and 6",
    )


def gyro_excess(
    f: ClaimFlight, start: float, why: str = "mean difference of the magnitudes of Cm, Cn, gyros minus database"
) -> Finding:
    value, sigma = excess(f, "flight", "database", ("Cm", "Cn"), f.between(start, f.end))
    return positive(
        value,
        sigma,
        "",
        f"{why}; amplitudes are {amplitude_ratio(f, ('Cm', 'Cn')):.2f} times the database's from Mach 5 on",
    )


@claim(
    MOMENTS,
    "7.2",
    "From Mach 5 to the parachute the gyros have higher values of Cm than database and combination.",
    SPIRIT,
)
def gyros_high_spirit(f: ClaimFlight) -> Finding:
    return gyro_excess(f, f.mach_5)


@claim(
    MOMENTS,
    "7.2",
    "From Mach 15 to the parachute the gyros have higher values of Cn than database and combination.",
    OPPORTUNITY,
)
def gyros_high_opportunity(f: ClaimFlight) -> Finding:
    return gyro_excess(f, f.mach_15)


def in_e4(means: list[float]) -> str:
    """Numbers as multiples of 1e-4."""
    return ", ".join(f"{1e4 * mean:.1f}" for mean in means) + " times 1e-4"


def by_window(f: ClaimFlight, pair: str) -> list[float]:
    """Mean over Cm and Cn of the magnitude of the average difference of two methods, in each window."""
    out = []
    for window in range(len(f.post.windows)):
        rows = [d for d in mean_differences(f, MOMENT_PAIRS, window) if d.pair == pair or pair == ""]
        out.append(float(np.mean([abs(d.mean) for d in rows if d.samples])))
    return out


@claim(
    MOMENTS,
    "7.2, table 7.4",
    "The average differences of the moments are lowest from 135 to 195 s (Mach 15 to 5).",
    SPIRIT,
)
def lowest_window(f: ClaimFlight) -> Finding:
    means = by_window(f, "")
    k = int(np.argmin(means))
    return judged(
        f"lowest: {f.post.windows[k].name}",
        f.post.windows[k].name.startswith("Mach 15"),
        f"mean of Cm, Cn and all methods by window: {in_e4(means)}",
    )


@claim(
    MOMENTS,
    "7.2, tables 7.4, 7.5",
    "The differences to the gyros are largest from 195 to 250 s (Mach 5 to the parachute).",
    *ROVERS,
)
def gyro_window(f: ClaimFlight) -> Finding:
    means = by_window(f, "IMU-gyros")
    k = int(np.argmax(means))
    return judged(
        f"largest: {f.post.windows[k].name}", k == len(means) - 1,
        f"database minus gyros, mean of Cm and Cn by window: {in_e4(means)}; averages over an oscillation",
    )  # fmt: skip


@claim(
    MOMENTS, "7.2", "From 50 s to Mach 15 the database's Cn is higher than the other two (number lost).", OPPORTUNITY
)
def database_moment_high(f: ClaimFlight) -> Finding:
    value, sigma = excess(f, "database", "flight", ("Cm", "Cn"), f.between(f.start, f.mach_15))
    return positive(
        value,
        sigma,
        "",
        {OPEN: "mean difference of the magnitudes", AGREES: "mean difference of the magnitudes", DIFFERS: PROXY},
    )


@claim(MOMENTS, "7.2", "From 50 s to Mach 15 gyros and combined Cn agree well.", OPPORTUNITY)
def gyros_combination(f: ClaimFlight) -> Finding:
    p = f.post.flight
    value, sigma = f.mean(
        p.coefficients.value["Cn"] - p.forces.value["Cn"], f.between(f.start, f.mach_15),
        np.hypot(p.coefficients.noise["Cn"], p.forces.noise),
        np.hypot(p.coefficients.systematic["Cn"], p.forces.systematic),
    )  # fmt: skip
    three = float(np.nanmean(p.database.three_sigma["Cn"][f.between(f.start, f.mach_15)]))
    return judged(
        quantity(value, sigma), abs(value) < three / 3.0, "mean difference; limit here one sigma of the database"
    )


@claim(
    MOMENTS,
    "7.2, tables 7.4, 7.5",
    "All average differences of Cm and Cn are within the uncertainty (digits lost).",
    *ROVERS,
)
def moment_tables(f: ClaimFlight) -> Finding:
    value, sigma, where = largest_mean(f, MOMENT_PAIRS, relative=True)
    return at_most(value, sigma, 100.0, "% of 3 sigma", f"largest: {where}; 3 sigma of 0.003 to 0.005 is remembered")


@claim(
    MOMENTS,
    "7.2, 9",
    "The differences of the moments are of the same order as the uncertainty: no conservatism.",
    *ROVERS,
)
def no_conservatism(f: ClaimFlight) -> Finding:
    value, sigma, where = largest_mean(f, {"Cm": ("IMU-gyros",), "Cn": ("IMU-gyros",)}, relative=True)
    return judged(
        f"up to {quantity(value, sigma, '%')} of 3 sigma",
        value > 10.0,
        f"largest mean: {where}; same order: more than a tenth",
    )


@claim(ROLL, "7.3", "The roll rate increases during entry.", *ROVERS)
def roll_increases(f: ClaimFlight) -> Finding:
    time, roll = f.roll
    change = 100.0 * (abs(roll[np.searchsorted(time, f.end) - 5]) / abs(roll[0]) - 1.0)
    return judged(
        f"{change:+.0f} % at the parachute".replace("-", "−"),
        change > 0.0,
        {DIFFERS: "the sign of the axis does not matter: the magnitude falls"},
    )


def coupling(f: ClaimFlight, start: float, end: float) -> tuple[Array, Array, Array]:
    """Measured torque about x, and its factors of the products Ixy and Ixz in Euler's equation (6.6), per kg m²."""
    inside = f.between(start, end)
    m = f.post.motion
    (p, q, r), (roll, pitch, yaw) = m.rate[inside].T, m.acceleration[inside].T
    inertia = f.inputs.inertia
    torque = inertia[0, 0] * roll + (inertia[2, 2] - inertia[1, 1]) * q * r
    return torque, -(pitch - p * r), -(yaw + p * q)


@claim(ROLL, "7.3", "The products of inertia have a torque one to two orders of magnitude below that about x.", SPIRIT)
def small_products(f: ClaimFlight) -> Finding:
    torque, xy, xz = coupling(f, 110.0, 150.0)
    ratio = 0.1 * float(np.hypot(np.std(xy), np.std(xz))) / float(np.sqrt(np.mean(torque**2)))
    return judged(
        f"{100.0 * ratio:.1f} %", ratio <= 0.1,
        "rms, 110–150 s; products of 0.1 kg m², from the tilt of the spin axis before entry, as table 6.1 is lost",
    )  # fmt: skip


@claim(
    ROLL, "7.3", "From 150 s on the product Ixy dominates the torque about x and completely explains it.", OPPORTUNITY
)
def dominating_product(f: ClaimFlight) -> Finding:
    torque, xy, xz = coupling(f, 150.0, f.end)
    columns = np.column_stack((xy, xz, np.ones(len(xy))))
    solution, *_ = np.linalg.lstsq(columns, torque, rcond=None)
    residual = torque - columns @ solution
    explained = 1.0 - residual.var() / torque.var()
    text = f"Ixy {solution[0]:+.2f}, Ixz {solution[1]:+.2f} kg m² explain {100.0 * explained:.0f} %".replace("-", "−")
    return judged(
        text, explained > 0.9,
        {DIFFERS: "least squares, 150 s to the parachute, I_xx assumed; completely: more than 90 % of the variance"},
    )  # fmt: skip


@claim(ROLL, "7.3", "The torque of Ixy is of the same order as the torque about x.", OPPORTUNITY)
def large_product(f: ClaimFlight) -> Finding:
    torque, xy, _ = coupling(f, 150.0, f.end)
    ratio = abs(np.polyfit(xy, torque, 1)[0]) * float(np.std(xy) / np.std(torque))
    return judged(f"{100.0 * ratio:.0f} %", 0.3 < ratio < 3.0, "rms of the fitted part of Ixy, 150 s to the parachute")


@claim(ROLL, "7.3", "From 50 s on Cl rises from negative values to near zero at Mach 25.", SPIRIT)
def early_roll(f: ClaimFlight) -> Finding:
    first, last = f.mean_coefficient("Cl", 50.0, 60.0), f.mean_coefficient("Cl", f.mach_25 - 5.0, f.mach_25 + 5.0)
    text = f"{quantity(*first)} at 50–60 s, {quantity(*last)} at Mach 25"
    if abs(last[0] - first[0]) <= SIGMAS * np.hypot(first[1], last[1]):
        return undecided(text, "the change is within two sigma")
    return judged(text, last[0] > first[0] and abs(last[0]) < 5e-6)


@claim(ROLL, "7.3", "From 50 s on Cl decreases to near zero at Mach 25.", OPPORTUNITY)
def early_roll_opportunity(f: ClaimFlight) -> Finding:
    first, last = f.mean_coefficient("Cl", 50.0, 60.0), f.mean_coefficient("Cl", f.mach_25 - 5.0, f.mach_25 + 5.0)
    text = f"{quantity(*first)} at 50–60 s, {quantity(*last)} at Mach 25"
    if abs(last[0] - first[0]) <= SIGMAS * np.hypot(first[1], last[1]):
        return undecided(text, "the change is within two sigma")
    return judged(text, last[0] < first[0] and abs(last[0]) < 5e-6)


@claim(ROLL, "7.3", "In continuum, between Mach 25 and Mach 5, Cl is approximately 5e-6.", SPIRIT)
def roll_positive(f: ClaimFlight) -> Finding:
    return about(*f.mean_coefficient("Cl", 110.0, 140.0), 5e-6, 0.5e-6, "", "mean, 110–140 s")


@claim(ROLL, "7.3", "Cl is −5e-6 near 160 s.", SPIRIT)
def roll_negative(f: ClaimFlight) -> Finding:
    return about(*f.mean_coefficient("Cl", 155.0, 165.0), -5e-6, 0.5e-6, "", "mean, 155–165 s")


@claim(ROLL, "7.3", "From Mach 25 to Mach 15 Cl is around 1e-6.", OPPORTUNITY)
def roll_opportunity(f: ClaimFlight) -> Finding:
    value, sigma = f.mean_coefficient("Cl", f.mach_25, f.mach_15)
    return about(
        abs(value),
        sigma,
        1e-6,
        0.5e-6,
        "",
        {AGREES: f"magnitude; the mean is {quantity(value)}", DIFFERS: f"the mean is {quantity(value)}"},
    )


@claim(ROLL, "abstract", "A rolling moment exists, although the vehicle should be axisymmetric.", SPIRIT)
def roll_exists(f: ClaimFlight) -> Finding:
    return positive(*f.mean_coefficient("Cl", 110.0, 140.0), "", "mean, 110–140 s")


@claim(ROLL, "7.3", "After Mach 5 the remnant may change Cl.", SPIRIT)
def late_roll(f: ClaimFlight) -> Finding:
    value, sigma = f.mean_coefficient("Cl", f.mach_5, f.end)
    return undecided(quantity(value, sigma), "mean, Mach 5 to the parachute; the thesis has no number")
