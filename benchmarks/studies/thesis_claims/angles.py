"""Chapters 8 and 9: angles by three methods, and the thesis's conclusions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thesis_claims.claim import (
    AGREES,
    DIFFERS,
    OPEN,
    OPPORTUNITY,
    SPIRIT,
    Finding,
    at_most,
    claim,
    judged,
    positive,
)
from thesis_claims.comparison import FORCE_PAIRS, MOMENT_PAIRS, PROXY, amplitude_ratio, excess, largest_mean
from thesis_claims.flight import ClaimFlight

ANGLES = "Angles (chapter 8)"
SUMMARY = "Conclusions (chapter 9)"
ROVERS = (SPIRIT, OPPORTUNITY)


def angle_miss(f: ClaimFlight) -> tuple[float, float, float, str]:
    """Largest difference of the reconstructed angles to the combined ones, deg, one sigma, time, and which."""
    a, inside = f.post.flight.angles, f.between(f.start, f.end)
    best = (0.0, 0.0, 0.0, "")
    for kind, sigma in (("forces", a.forces_sigma), ("moments", a.moments_sigma)):
        for plane in ("alpha", "beta"):
            values = np.abs(np.degrees(getattr(a, f"{plane}_{kind}")))
            use = np.flatnonzero(inside & np.isfinite(values))
            k = use[int(np.argmax(values[use]))]
            if values[k] > best[0]:
                best = (float(values[k]), float(np.degrees(sigma[k])), float(f.time[k]), f"{plane} from {kind}")
    return best


@claim(ANGLES, "8", "Reconstructed and combined angles differ by less than 2.5°.", *ROVERS)
def angle_limit(f: ClaimFlight) -> Finding:
    value, sigma, time, which = angle_miss(f)
    why = f"largest sample from 50 s on; {PROXY}; sigma with a wind of 20 m/s"
    finding = at_most(value, sigma, 2.5, "°", why)
    return replace(finding, text=f"{finding.text} ({which}, {time:.0f} s)")


@claim(
    ANGLES,
    "8, 9, abstract",
    "In the last 20 s angles from forces and from moments differ by around 2.5° in both planes.",
    *ROVERS,
)
def last_seconds(f: ClaimFlight) -> Finding:
    a, inside = f.post.flight.angles, f.between(f.end - 20.0, f.end)
    rms = [np.degrees(f.rms(v, inside)) for v in (a.alpha_between, a.beta_between)]
    peak = max(np.degrees(np.nanmax(np.abs(v[inside]))) for v in (a.alpha_between, a.beta_between))
    sigma = float(np.degrees(f.rms(a.between_sigma, inside)))
    text = f"alpha {rms[0]:.2f}°, beta {rms[1]:.2f}° rms, peak {peak:.1f}°; one sigma {sigma:.2f}°"
    return judged(
        text, all(abs(v - 2.5) <= 0.5 for v in rms), {DIFFERS: f"an inconsistency exists, but it is smaller; {PROXY}"}
    )


@claim(SUMMARY, "9, abstract", "In the second instability database and flight differ by less than 1° in angle.", SPIRIT)
def instability_angle(f: ClaimFlight) -> Finding:
    second, a = f.post.regimes.second, f.post.flight.angles
    inside = f.between(second.start, second.end)
    value = np.degrees(max(f.rms(v, inside) for v in (a.alpha_forces, a.beta_forces)))
    return at_most(
        float(value), 0.0, 1.0, "°", "reconstructed minus from forces, rms over the instability, larger of both planes"
    )


@claim(
    SUMMARY, "9", "In the second instability the database's CN and CY are slightly higher than the flight's.", SPIRIT
)
def instability_excess(f: ClaimFlight) -> Finding:
    second = f.post.regimes.second
    return positive(
        *excess(f, "database", "flight", ("CN", "CY"), f.between(second.start, second.end)), "",
        {OPEN: "mean difference of the magnitudes", AGREES: "mean difference of the magnitudes", DIFFERS: PROXY},
    )  # fmt: skip


@claim(SUMMARY, "9", "Opportunity has the lowest total angle of attack.", "both")
def lowest_angle(spirit: ClaimFlight, opportunity: ClaimFlight) -> Finding:
    means = [float(np.mean(f.alpha_total[f.between(f.start, f.end)])) for f in (spirit, opportunity)]
    early = [float(np.mean(f.alpha_total[f.between(60.0, 130.0)])) for f in (spirit, opportunity)]
    return judged(
        f"means {means[0]:.1f}° (Spirit) and {means[1]:.1f}°", means[1] < means[0],
        {DIFFERS: f"50 s to the parachute; 60–130 s: {early[0]:.1f}° and {early[1]:.1f}°; Phoenix is not compared"},
    )  # fmt: skip


@claim(SUMMARY, "9", "For Opportunity database and flight agree excellently throughout.", OPPORTUNITY)
def excellent_agreement(f: ClaimFlight) -> Finding:
    forces, moments = largest_mean(f, FORCE_PAIRS, relative=True), largest_mean(f, MOMENT_PAIRS, relative=True)
    ratio = amplitude_ratio(f, ("CN", "CY"))
    return judged(
        f"means up to {forces[0]:.0f} % (forces), {moments[0]:.0f} % (moments) of 3 sigma; amplitude {ratio:.1f} times",
        max(forces[0], moments[0]) < 33.0 and abs(ratio - 1.0) < 0.1,
        {DIFFERS: f"limits here one sigma of the database and 10 % of the amplitude after Mach 5; {PROXY}"},
    )  # fmt: skip


@claim(
    SUMMARY,
    "9, abstract",
    "All differences of the coefficients are equal to or less than the database's uncertainty: it is valid.",
    *ROVERS,
)
def database_valid(f: ClaimFlight) -> Finding:
    values = [largest_mean(f, pairs, relative=True) for pairs in (FORCE_PAIRS, MOMENT_PAIRS)]
    value, sigma, where = max(values)
    return at_most(value, sigma, 100.0, "% of 3 sigma", f"largest mean: {where}; Cl excepted")


@claim(SUMMARY, "abstract", "The differences of the force coefficients are half of the uncertainty or less.", *ROVERS)
def half_uncertainty(f: ClaimFlight) -> Finding:
    value, sigma, where = largest_mean(f, {"CN": ("IMU-accels",), "CY": ("IMU-accels",)}, relative=True)
    return at_most(value, sigma, 50.0, "% of 3 sigma", f"largest mean, database minus accelerometers: {where}")
