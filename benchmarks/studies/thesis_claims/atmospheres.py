"""Chapters 4 to 6: Mach and Knudsen numbers, and coefficients, with the flight's atmosphere and the preflight one."""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array
from thesis_claims.claim import (
    AGREES,
    DIFFERS,
    NEAR,
    OPPORTUNITY,
    SPIRIT,
    Finding,
    about,
    claim,
    judged,
    quantity,
    undecided,
)
from thesis_claims.flight import ClaimFlight

INPUTS = "Mach and Knudsen numbers (chapter 4)"
DATABASE = "Database with two atmospheres (chapter 5)"
FLIGHT = "Flight coefficients with two atmospheres (chapter 6)"
ROVERS = (SPIRIT, OPPORTUNITY)
#: The preflight models of the rovers are not public.
SUBSTITUTE = "the preflight atmosphere here is a generic substitute, wrong by up to a factor of two in thin air"
FORCES, MOMENTS = ("CN", "CY"), ("Cm", "Cn")


def mach_difference(f: ClaimFlight) -> Array:
    """Magnitude of the difference of the Mach number by the two atmospheres."""
    return np.abs(f.mach - f.post.preflight.atmosphere.mach)


def largest(f: ClaimFlight, values: Array, start: float, end: float) -> tuple[float, float]:
    """Largest finite value between two times, and its time, s."""
    use = np.flatnonzero(f.between(start, end) & np.isfinite(values))
    k = use[int(np.argmax(values[use]))]
    return float(values[k]), float(f.time[k])


def percent(f: ClaimFlight, kind: str, names: tuple[str, ...]) -> Array:
    """Largest magnitude of a difference by the two atmospheres among some coefficients, percent of 3 sigma."""
    values = getattr(f.post.between_atmospheres, kind)
    return np.max([np.abs(np.where(np.isfinite(values[name]), values[name], 0.0)) for name in names], axis=0)


def at(value: float, time: float, unit: str = "") -> str:
    """Number and the time at which it occurs."""
    return f"{quantity(value, 0.0, unit)} at {time:.0f} s"


def continuum(f: ClaimFlight) -> float:
    """Time from which the database depends on the Mach number, s."""
    return float(f.post.regimes.continuum or f.start)


def mach_limit(f: ClaimFlight, limit: float) -> Finding:
    """Largest difference of the Mach numbers from the beginning of the continuum on."""
    value, time = largest(f, mach_difference(f), continuum(f), f.end)
    return judged(
        at(value, time), value < limit, {DIFFERS: SUBSTITUTE, AGREES: "from the beginning of the continuum on"}
    )


def mach_difference_time(f: ClaimFlight, stated: float) -> Finding:
    """Time of that difference."""
    _, time = largest(f, mach_difference(f), continuum(f), f.end)
    return about(time, f.epoch_sigma, stated, NEAR, "s", {DIFFERS: SUBSTITUTE})


@claim(INPUTS, "4.2", "The Mach numbers by both atmospheres agree, except in the first 30 s.", SPIRIT)
def mach_agrees(f: ClaimFlight) -> Finding:
    relative = mach_difference(f) / f.mach
    value, time = largest(f, relative, 30.0, f.end)
    return judged(at(100.0 * value, time, "%"), value < 0.05, {DIFFERS: f"limit here 5 %; {SUBSTITUTE}"})


@claim(INPUTS, "4.2", "Where the Mach number is used, it differs by less than 1.7.", SPIRIT)
def mach_limit_spirit(f: ClaimFlight) -> Finding:
    return mach_limit(f, 1.7)


@claim(INPUTS, "4.2", "Where the Mach number is used, it differs by less than 1.5.", OPPORTUNITY)
def mach_limit_opportunity(f: ClaimFlight) -> Finding:
    return mach_limit(f, 1.5)


@claim(INPUTS, "4.2", "There it differs most near 95 s.", SPIRIT)
def mach_difference_spirit(f: ClaimFlight) -> Finding:
    return mach_difference_time(f, 95.0)


@claim(INPUTS, "4.2", "There it differs most near 90 s.", OPPORTUNITY)
def mach_difference_opportunity(f: ClaimFlight) -> Finding:
    return mach_difference_time(f, 90.0)


@claim(INPUTS, "4.2", "The Mach numbers differ most before 40 s.", OPPORTUNITY)
def mach_difference_early(f: ClaimFlight) -> Finding:
    value, time = largest(f, mach_difference(f), f.post.domain.start, f.end)
    return judged(
        at(value, time), time < 40.0,
        {DIFFERS: "an assumed temperature of 150 ± 30 K at the top determines the first scale heights here"},
    )  # fmt: skip


@claim(INPUTS, "4.2", "From 125 s on there is no significant difference in Mach number.", OPPORTUNITY)
def mach_difference_late(f: ClaimFlight) -> Finding:
    value, time = largest(f, mach_difference(f) / f.mach, 125.0, f.end)
    return judged(at(100.0 * value, time, "%"), value < 0.05, {DIFFERS: f"limit here 5 %; {SUBSTITUTE}"})


@claim(INPUTS, "4.2", "The Knudsen numbers differ by less than 50 %, most at entry, and less until 40 s.", SPIRIT)
def knudsen_spirit(f: ClaimFlight) -> Finding:
    knudsen = np.abs(f.post.between_atmospheres.atmosphere["knudsen"])
    value, time = largest(f, knudsen, f.post.domain.start, f.end)
    return judged(at(value, time, "%"), value < 50.0 and time < 40.0, {DIFFERS: SUBSTITUTE})


@claim(INPUTS, "4.2", "The Knudsen numbers agree very well from 40 s on, and before to 50 %.", OPPORTUNITY)
def knudsen_opportunity(f: ClaimFlight) -> Finding:
    knudsen = np.abs(f.post.between_atmospheres.atmosphere["knudsen"])
    early, late = (largest(f, knudsen, *span) for span in ((f.post.domain.start, 40.0), (40.0, f.end)))
    text = f"{at(*early, '%')}, {at(*late, '%')}"
    return judged(text, early[0] < 50.0 and late[0] < 10.0, {DIFFERS: f"limit after 40 s here 10 %; {SUBSTITUTE}"})


@claim(INPUTS, "4.2", "Until 25 s small accelerations make the density fluctuate.", OPPORTUNITY)
def early_density(f: ClaimFlight) -> Finding:
    atmosphere = f.post.flight.atmosphere
    relative = atmosphere.density_noise / atmosphere.density
    early, late = (f.rms(relative, f.between(*span)) for span in ((f.post.domain.start, 25.0), (25.0, 50.0)))
    return judged(
        f"noise {100.0 * early:.0f} % until 25 s, {100.0 * late:.0f} % from 25 to 50 s", early > 2.0 * late,
        "one sigma of a batch; agrees if it is more than twice as large",
    )  # fmt: skip


@claim(DATABASE, "5", "The largest difference of CN, CY is 4 % of the uncertainty, near 125 s.", SPIRIT)
def database_forces_spirit(f: ClaimFlight) -> Finding:
    value, time = largest(f, percent(f, "database", FORCES), continuum(f), f.end)
    return judged(
        at(value, time, "%"), value <= 4.5 and abs(time - 125.0) <= NEAR,
        {
            DIFFERS: f"from the beginning of the continuum on; {SUBSTITUTE}",
            AGREES: "from the beginning of the continuum on",
        },
    )  # fmt: skip


@claim(DATABASE, "5", "The difference of Cm, Cn is less than 3 % of the uncertainty.", SPIRIT)
def database_moments_spirit(f: ClaimFlight) -> Finding:
    value, time = largest(f, percent(f, "database", MOMENTS), continuum(f), f.end)
    return judged(at(value, time, "%"), value < 3.0, {DIFFERS: f"in continuum; {SUBSTITUTE}", AGREES: "in continuum"})


@claim(
    DATABASE, "5", "The difference oscillates from 200 s (Spirit) and 175 s (Opportunity) to the parachute.", *ROVERS
)
def database_oscillation(f: ClaimFlight) -> Finding:
    onset = 200.0 if f.mission.name == "mer_a" else 175.0
    values = f.post.between_atmospheres.database["CN"]
    before, after = (f.rms(values, f.between(*span)) for span in ((onset - 50.0, onset), (onset, f.end)))
    return judged(
        f"CN, rms: {after:.1f} % after, {before:.1f} % in the 50 s before", after > before,
        "percent of the uncertainty; agrees if it is larger after",
    )  # fmt: skip


@claim(DATABASE, "5", "The differences are less than 10 % of the uncertainty.", OPPORTUNITY)
def database_opportunity(f: ClaimFlight) -> Finding:
    value, time = largest(f, percent(f, "database", FORCES + MOMENTS), continuum(f), f.end)
    return judged(at(value, time, "%"), value < 10.0, {DIFFERS: f"in continuum; {SUBSTITUTE}", AGREES: "in continuum"})


@claim(DATABASE, "5, 9", "Throughout the entry the differences are less than 10 % of the uncertainty.", *ROVERS)
def database_all(f: ClaimFlight) -> Finding:
    value, time = largest(f, percent(f, "database", FORCES + MOMENTS), f.post.domain.start, f.end)
    return judged(at(value, time, "%"), value < 10.0, {DIFFERS: f"in rarefied flow; {SUBSTITUTE}"})


@claim(DATABASE, "5", "The differences are larger for Opportunity than for Spirit.", "both")
def database_larger(spirit: ClaimFlight, opportunity: ClaimFlight) -> Finding:
    values = [
        largest(f, percent(f, "database", FORCES + MOMENTS), continuum(f), f.end)[0] for f in (spirit, opportunity)
    ]
    return judged(f"{values[0]:.1f} % and {values[1]:.1f} %", values[1] > values[0], {DIFFERS: SUBSTITUTE})


@claim(FLIGHT, "6", "CN by the two atmospheres agrees from near 50 s on; at most 25 % of the uncertainty.", SPIRIT)
def flight_force_spirit(f: ClaimFlight) -> Finding:
    value, time = largest(f, percent(f, "flight", ("CN",)), f.start, f.end)
    later = largest(f, percent(f, "flight", ("CN",)), 80.0, f.end)
    return judged(f"{at(value, time, '%')}; from 80 s on {at(*later, '%')}", value <= 25.0, {DIFFERS: SUBSTITUTE})


@claim(FLIGHT, "6", "Cm by the two atmospheres differs by less than 18 % of the uncertainty from 50 s on.", OPPORTUNITY)
def flight_moment_opportunity(f: ClaimFlight) -> Finding:
    value, time = largest(f, percent(f, "flight", ("Cm",)), f.start, f.end)
    return judged(at(value, time, "%"), value < 18.0, {DIFFERS: SUBSTITUTE})


@claim(FLIGHT, "6", "The difference of Cm is largest before 50 s.", OPPORTUNITY)
def flight_moment_early(f: ClaimFlight) -> Finding:
    value, time = largest(f, percent(f, "flight", ("Cm",)), f.post.domain.start, f.end)
    return judged(at(value, time, "%"), time < 50.0)


@claim(FLIGHT, "6, 9", "From 50 s on all flight coefficients differ by less than 35 % of the uncertainty.", *ROVERS)
def flight_all(f: ClaimFlight) -> Finding:
    value, time = largest(f, percent(f, "flight", FORCES + MOMENTS), f.start, f.end)
    later = [
        t
        for t in f.time[f.between(f.start, f.end)]
        if largest(f, percent(f, "flight", FORCES + MOMENTS), t, f.end)[0] < 35.0
    ]
    return judged(
        f"{at(value, time, '%')}; below 35 % from {later[0]:.0f} s on", value < 35.0,
        {DIFFERS: f"CN, CY, Cm, Cn; {SUBSTITUTE}", AGREES: "CN, CY, Cm, Cn"},
    )  # fmt: skip


@claim(
    FLIGHT,
    "9",
    "Over most of the time they differ by about 5 %, and by up to 30 % as the parachute approaches.",
    *ROVERS,
)
def flight_typical(f: ClaimFlight) -> Finding:
    values = percent(f, "flight", FORCES + MOMENTS)
    typical = float(np.median(values[f.between(80.0, f.end)]))
    value, time = largest(f, values, f.mach_5, f.end)
    return judged(
        f"median {typical:.1f} %; after Mach 5 up to {at(value, time, '%')}", typical <= 6.0 and value <= 30.0,
        {DIFFERS: f"from 80 s on; {SUBSTITUTE}", AGREES: "median from 80 s on"},
    )  # fmt: skip


@claim(FLIGHT, "4.1, 6.1", "Density converges to a lost number of percent; inertia, mass (table 6.1) lost.", *ROVERS)
def lost_numbers(f: ClaimFlight) -> Finding:
    inertia = f.inputs.inertia
    iterations, mass = f.post.flight.atmosphere.iterations, float(np.max(f.inputs.mass))
    text = f"{iterations} iterations to 1e-8; {mass:.1f} kg, I_xx {inertia[0, 0]:.0f} kg m²"
    return undecided(text, "the digits are missing in the text; mass and I_xx are assumptions of the mission file")
