"""Statements of other publications on the same entries, from the abstracts and tables that were available."""

from __future__ import annotations

import numpy as np

from edl_filter.types import Array
from thesis_claims.claim import (
    AGREES,
    BOTH,
    DIFFERS,
    OPPORTUNITY,
    SIGMAS,
    SPIRIT,
    Finding,
    about,
    claim,
    judged,
    positive,
    quantity,
    undecided,
)
from thesis_claims.comparison import growth
from thesis_claims.flight import ClaimFlight

AIR = "Atmosphere: Withers & Smith 2006"
TORQUE = "Torque of the blanket: Tolson et al., AAS 06-087"
LANDING = "Parachute and landing: Braun & Manning 2007 (from memory), Desai & Knocke"
ROVERS = (SPIRIT, OPPORTUNITY)
#: Targets of Desai & Knocke, latitude and east longitude, deg.
TARGET = {"mer_a": (-14.59, 175.3), "mer_b": (-1.98, 360.0 - 5.94)}
#: Degrees of longitude between the frames IAU 1991 and IAU 2000 of Mars.
FRAME_SHIFT = 0.24


def profile(f: ClaimFlight, altitudes: Array) -> tuple[Array, Array]:
    """Temperature at altitudes (km), mean over two kilometres, and its sigma, K."""
    atmosphere = f.post.flight.atmosphere
    height = atmosphere.altitude / 1e3
    near = [np.abs(height - h) < 1.0 for h in altitudes]

    def means(values: Array) -> Array:
        return np.array([np.nanmean(values[part]) for part in near])

    return means(atmosphere.temperature), means(atmosphere.temperature_sigma)


def warmth(spirit: ClaimFlight, opportunity: ClaimFlight) -> tuple[float, float, str]:
    """Mean temperature of Spirit's air less Opportunity's from 20 to 80 km, its sigma, and the means of three bands."""
    altitudes = np.arange(20.0, 80.5, 2.0)
    (a, a_sigma), (b, b_sigma) = (profile(f, altitudes) for f in (spirit, opportunity))
    bands = [float(np.mean((a - b)[(altitudes >= low) & (altitudes < low + 20.5)])) for low in (20.0, 40.0, 60.0)]
    text = f"20–40, 40–60 and 60–80 km: {', '.join(f'{band:.0f}' for band in bands)} K"
    return float(np.mean(a - b)), float(np.mean(np.hypot(a_sigma, b_sigma))), text


@claim(AIR, "abstract", "Spirit's air is warmer than Opportunity's, from 20 to 80 km.", BOTH)
def warmer(spirit: ClaimFlight, opportunity: ClaimFlight) -> Finding:
    value, sigma, bands = warmth(spirit, opportunity)
    return positive(value, sigma, "K", f"mean; {bands}")


@claim(AIR, "abstract", "The difference is about 10 K.", BOTH)
def ten_kelvins(spirit: ClaimFlight, opportunity: ClaimFlight) -> Finding:
    value, sigma, bands = warmth(spirit, opportunity)
    return about(
        value, sigma, 10.0, 5.0, "K", f"mean; within half of the number; {bands}; the sigma has no common error of CA"
    )


@claim(AIR, "abstract", "Below 30 km Spirit's temperature is nearly isothermal.", SPIRIT)
def isothermal(f: ClaimFlight) -> Finding:
    altitudes = np.arange(8.0, 30.5, 1.0)
    temperature, sigma = profile(f, altitudes)
    lapse = float(np.polyfit(altitudes, temperature, 1)[0])
    return judged(
        f"{quantity(lapse, float(sigma[0]) / 22.0, 'K/km')}, range {np.ptp(temperature):.0f} K", abs(lapse) < 1.0,
        "slope from 8 to 30 km; nearly isothermal: less than 1 K/km, an adiabatic slope is −4.3 K/km",
    )  # fmt: skip


@claim(AIR, "abstract", "Opportunity has a strong inversion from 8 to 12 km.", OPPORTUNITY)
def inversion(f: ClaimFlight) -> Finding:
    temperature, sigma = profile(f, np.array([8.0, 12.0]))
    rise, rise_sigma = float(np.diff(temperature)[0]), float(abs(np.diff(sigma)[0]))
    return judged(
        f"{quantity(rise, rise_sigma, 'K')} from 8 to 12 km", rise > SIGMAS * rise_sigma,
        "the temperature rises with altitude; the sigma is the part that both altitudes do not have in common",
    )  # fmt: skip


@claim(AIR, "abstract", "The temperature's error is tens of kelvins at 10 km.", *ROVERS)
def temperature_error(f: ClaimFlight) -> Finding:
    sigma = float(profile(f, np.array([10.0]))[1][0])
    return judged(
        f"one sigma {sigma:.1f} K",
        sigma >= 10.0,
        {DIFFERS: "with a wind of 20 m/s; the trajectory here is constrained by the landing"},
    )


@claim(
    TORQUE,
    "abstract",
    "From maximum dynamic pressure to the parachute the total angle was 4 to 9°, expected 1 to 2°.",
    *ROVERS,
)
def torque_angle(f: ClaimFlight) -> Finding:
    late = f.between(200.0, f.end)
    k = np.flatnonzero(late)[int(np.argmax(f.alpha_total[late]))]
    mean = float(np.mean(f.alpha_total[late]))
    sigma = float(np.degrees(f.inputs.angle_sigma[k]))
    text = f"mean {mean:.1f}°, largest {quantity(float(f.alpha_total[k]), sigma, '°')}"
    return judged(text, 4.0 <= f.alpha_total[k] <= 9.0, "from 200 s on; sigma with a wind of 20 m/s")


@claim(TORQUE, "abstract", "The disturbance begins at about Mach 6.", SPIRIT)
def onset_spirit(f: ClaimFlight) -> Finding:
    value, sigma, time = growth(f, f.post.regimes.second.end, f.end)
    mach = float(np.interp(time, f.time, f.mach))
    return judged(
        f"Mach {mach:.1f} at {time:.0f} s",
        abs(mach - 6.0) <= 1.0,
        f"fastest growth of the oscillation, {quantity(value, sigma, '1/s')}",
    )


@claim(
    TORQUE, "abstract", "The disturbance begins right after maximum dynamic pressure, at about Mach 14.", OPPORTUNITY
)
def onset_opportunity(f: ClaimFlight) -> Finding:
    value, sigma, time = growth(f, 115.0, f.end)
    mach, pressure = float(np.interp(time, f.time, f.mach)), f.post.flight.coefficients.dynamic_pressure
    peak = float(f.time[int(np.nanargmax(pressure))])
    return judged(
        f"Mach {mach:.1f} at {time:.0f} s, maximum pressure at {peak:.0f} s", abs(mach - 14.0) <= 1.0 and time > peak,
        f"fastest growth of the oscillation, {quantity(value, sigma, '1/s')}",
    )  # fmt: skip


@claim(TORQUE, "abstract", "The torque is fixed in the spinning body.", *ROVERS)
def body_fixed(f: ClaimFlight) -> Finding:
    return undecided(
        "", "the oscillation grows, which a constant body-fixed torque cannot do; the residual moments contain a "
        "body-fixed part at all times, which a centre of mass off the axis explains ([validation](validation.md))",
    )  # fmt: skip


@claim(LANDING, "table", "The parachute opens at Mach 1.77.", SPIRIT)
def parachute_mach(f: ClaimFlight) -> Finding:
    a, k = f.post.flight.atmosphere, int(np.flatnonzero(f.post.flight.atmosphere.valid)[-1])
    wind = f.mission.atmosphere.wind_sigma
    relative = np.hypot(
        np.hypot(f.inputs.speed_sigma[k], wind) / f.inputs.speed[k], 0.5 * a.temperature_sigma[k] / a.temperature[k]
    )
    return about(
        float(a.mach[k]), float(a.mach[k] * relative), 1.77, 0.005, "",
        "with the thesis's gas constants; the constants of the publication are not known",
    )  # fmt: skip


@claim(LANDING, "table", "The parachute opens at a dynamic pressure of 725 to 750 Pa.", *ROVERS)
def parachute_pressure(f: ClaimFlight) -> Finding:
    q, a = f.post.flight.coefficients.dynamic_pressure, f.post.flight.atmosphere
    k = int(np.flatnonzero(a.valid)[-1])
    value, sigma = float(q[k]), float(q[k] * a.ca_sigma[k] / a.ca[k])
    close = min(abs(value - limit) for limit in (725.0, 750.0))
    holds = 725.0 <= value <= 750.0 or close <= SIGMAS * sigma
    return judged(
        quantity(value, sigma, "Pa"), holds,
        {
            DIFFERS: "one smoothing batch before the mortar, from the axial force and CA; published is the target",
            AGREES: "one smoothing batch before the mortar, from the axial force and CA",
        },
    )  # fmt: skip


@claim(LANDING, "table", "The parachute opens 7.4 km above the landing site.", SPIRIT)
def parachute_altitude(f: ClaimFlight) -> Finding:
    t = f.trajectory
    k = int(np.searchsorted(t.time, f.parachute - 1e-6))
    arrival = f.arrival(t.time[k], t.position[k], t.velocity[k])
    height = np.linalg.norm(t.position[k]) - f.mission.constraints.landing.radius
    sigma = float(np.interp(f.parachute, f.air.time, f.air.altitude_sigma))
    return about(
        float(height) / 1e3,
        sigma / 1e3,
        7.4,
        0.05,
        "km",
        f"above the site's radius; above its horizontal plane {arrival.up / 1e3:.1f} km",
    )


@claim(LANDING, "abstract", "The rover landed within 15 km of its target.", *ROVERS)
def target_distance(f: ClaimFlight) -> Finding:
    site = f.mission.constraints.landing
    latitude, longitude = TARGET[f.mission.name]
    radius = site.radius * np.pi / 180.0 / 1e3

    def distance(shift: float) -> float:
        east = (np.degrees(site.longitude) % 360.0 - longitude - shift) * np.cos(np.radians(latitude))
        return float(radius * np.hypot(np.degrees(site.latitude) - latitude, east))

    plain, shifted = distance(0.0), distance(FRAME_SHIFT)
    text = f"{plain:.0f} km; {shifted:.0f} km if the target's longitude is in IAU 1991"
    if (plain <= 15.0) == (shifted <= 15.0):
        return judged(text, plain <= 15.0, "site of the archive against the published target")
    return undecided(text, "the frame of the target's coordinates is not known")
