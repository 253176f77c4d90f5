"""Chapters 2 and 3: events, rates, accelerations, entry state, speeds and angles."""

from __future__ import annotations

import numpy as np

from edl_filter import rotations
from edl_filter.pipeline.entry_state import in_j2000
from edl_filter.postflight.windows import _envelope_peak
from edl_filter.telemetry.smoothing import batch_polynomial
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
from thesis_claims.flight import HIGHRATE_START, ClaimFlight

STEP_1, STEP_2, STEP_3 = "Telemetry (section 3.1)", "Rates and accelerations (section 3.2)", "Trajectory (section 3.3)"
ROVERS = (SPIRIT, OPPORTUNITY)
#: Equatorial radius of Mars of the thesis's reference 14, m; the thesis's own digits are lost.
VALLADO_RADIUS = 3397.2e3
#: Mantissas of the axial bias of table 3.5, and the exponents of the z bias that are left of it.
BIAS_MANTISSA, BIAS_Z = {SPIRIT: 1.36, OPPORTUNITY: 5.32}, {SPIRIT: 1e-7, OPPORTUNITY: 1e-5}
#: Sigma of a sample of acceleration, m/s², and length of the thesis's "several seconds" before entry, s.
SAMPLE_SIGMA, SEVERAL_SECONDS = 3.0e-3, 10.0


def of(flight: ClaimFlight) -> str:
    """The rover of a flight."""
    return SPIRIT if flight.mission.name == "mer_a" else OPPORTUNITY


@claim(STEP_1, "3.1", "Entry interface is at an altitude of 125 km.", *ROVERS)
def entry_altitude(f: ClaimFlight) -> Finding:
    radius = float(np.linalg.norm(f.mission.initial_state.position))
    return about(
        (radius - VALLADO_RADIUS) / 1e3, 0.0, 125.0, 1.0, "km",
        f"above the equatorial radius of 3397.2 km; above the ellipsoid it is {f.air.altitude[0] / 1e3:.1f} km",
    )  # fmt: skip


@claim(STEP_1, "3.1", "Raw telemetry begins 90 s after entry interface.", *ROVERS)
def first_increment(f: ClaimFlight) -> Finding:
    interval = f.reconstruction.telemetry.driving.interval
    time = f.reconstruction.telemetry.driving.time
    short = (np.abs(interval - 0.125) < 0.01) & (time > HIGHRATE_START - 20.0)
    return about(float(time[short][0]), f.epoch_sigma, HIGHRATE_START, 1.0, "s")


@claim(STEP_1, "3.1", "The parachute opens near 250 s.", *ROVERS)
def parachute_time(f: ClaimFlight) -> Finding:
    return about(f.parachute, f.epoch_sigma, 250.0, NEAR, "s")


@claim(STEP_1, "3.1", "The parachute is the largest peak of the acceleration; an abrupt jump precedes it.", *ROVERS)
def opening_load(f: ClaimFlight) -> Finding:
    time, force = f.trajectory.time, np.linalg.norm(f.trajectory.specific_force, axis=1)
    entry, opening = force[time < f.parachute].max(), force[(time > f.parachute) & (time < f.parachute + 5.0)].max()
    return judged(f"{opening:.0f} m/s² at opening, {entry:.0f} m/s² before", opening > entry)


@claim(STEP_1, "3.1", "The drag exceeds the accelerometers' threshold from about 10 s on.", *ROVERS)
def threshold_time(f: ClaimFlight) -> Finding:
    return about(f.post.domain.start, f.epoch_sigma, 10.0, NEAR, "s", "smoothed force permanently above 3 sigma")


@claim(STEP_2, "3.2", "Angular rates do not change significantly before 90 s.", *ROVERS)
def quiet_rates(f: ClaimFlight) -> Finding:
    time, roll = f.roll
    change = 100.0 * np.abs(roll / roll[0] - 1.0)
    early, late = change[time < HIGHRATE_START].max(), change[time > HIGHRATE_START].max()
    return judged(
        f"roll rate changes by {early:.1f} % before, {late:.0f} % after", early < 0.5 * late,
        "judged by the roll rate: less than half of the later change",
    )  # fmt: skip


@claim(STEP_2, "3.2", "The roll rate changes unexpectedly around 120 s.", SPIRIT)
def roll_change_spirit(f: ClaimFlight) -> Finding:
    middle, acceleration = f.mean_roll_acceleration(10.0, HIGHRATE_START, f.end)
    k = int(np.argmax(np.abs(acceleration)))
    return about(
        float(middle[k]), f.epoch_sigma, 120.0, NEAR, "s", "time of the largest roll acceleration over ten seconds"
    )


@claim(STEP_2, "3.2", "The roll rate changes unexpectedly near 140 s.", OPPORTUNITY)
def roll_change_opportunity(f: ClaimFlight) -> Finding:
    time, roll = f.roll
    part = (time > HIGHRATE_START) & (time < 180.0)
    return about(
        float(time[part][np.argmin(roll[part])]), f.epoch_sigma, 140.0, NEAR, "s",
        "time of the least roll rate before 180 s: the deceleration of the roll ends there",
    )  # fmt: skip


def filtered_difference(f: ClaimFlight) -> tuple[np.ndarray, np.ndarray]:
    """Times, and magnitudes of unfiltered minus filtered rates ``(N, 3)`` of the rover's IMU."""
    time, raw, smooth = f.batch_rates(f.rover_imu, HIGHRATE_START, f.end)
    return time, np.abs(raw - smooth)


@claim(STEP_2, "3.2", "Filtered and unfiltered roll rates differ most in a spike around 170 s.", *ROVERS)
def rate_spike(f: ClaimFlight) -> Finding:
    time, difference = filtered_difference(f)
    return about(
        float(time[int(np.argmax(difference[:, 0]))]), f.epoch_sigma, 170.0, NEAR, "s",
        "rover's IMU, as in the thesis: its sample of 51 increments, with rates over a constant 0.125 s",
    )  # fmt: skip


@claim(STEP_2, "3.2", "This is the largest difference about any axis.", *ROVERS)
def largest_spike(f: ClaimFlight) -> Finding:
    time, difference = filtered_difference(f)
    at, axis = np.unravel_index(int(np.argmax(difference)), difference.shape)
    return judged(
        f"largest about {'xyz'[axis]} at {time[at]:.1f} s", axis == 0,
        {DIFFERS: "the oscillation about y and z is faster than the filter passes"},
    )  # fmt: skip


@claim(STEP_2, "3.2", "Of the batch sizes tested, the sum of the residuals is closest to zero with 7 points.", *ROVERS)
def batch_size(f: ClaimFlight) -> Finding:
    time, raw, _ = f.batch_rates(f.rover_imu, HIGHRATE_START, f.end)
    sums = {n: float(np.abs(np.sum(raw - batch_polynomial(time, raw, n), axis=0)).max()) for n in (5, 7, 9, 11, 13)}
    best = min(sums, key=lambda n: sums[n])
    text = f"least with {best} points of 5, 7, 9, 11 and 13"
    if best == BATCH_OF_THESIS:
        return Finding(text, AGREES, "largest sum of the three axes")
    return undecided(text, "the sum is determined by the ends of the span, which the thesis does not state")


BATCH_OF_THESIS = 7


@claim(STEP_2, "3.2", "A torque about x acts between 110 and 150 s: the angular acceleration is not symmetric.", SPIRIT)
def roll_torque(f: ClaimFlight) -> Finding:
    time, roll = f.roll

    def mean(start: float, end: float) -> float:
        return float(np.diff(np.interp((start, end), time, roll))[0] / (end - start))

    sigma = np.sqrt(2.0) * float(np.max(f.post.motion.rate_sigma[f.between(110.0, 150.0)])) / 40.0
    rest = mean(150.0, f.end)
    finding = positive(
        mean(110.0, 150.0), sigma, "rad/s²", f"mean from 150 s to the parachute: {quantity(rest)} rad/s²"
    )
    return finding if finding.verdict != AGREES or mean(110.0, 150.0) > 3.0 * abs(rest) else judged(finding.text, False)


@claim(STEP_2, "3.2", "The angular acceleration about x is symmetric except for 7 s near 130 s.", OPPORTUNITY)
def roll_torque_opportunity(f: ClaimFlight) -> Finding:
    middle, acceleration = f.mean_roll_acceleration(7.0, HIGHRATE_START, f.end)
    k = int(np.argmax(np.abs(acceleration)))
    return about(float(middle[k]), f.epoch_sigma, 130.0, NEAR, "s", "time of the largest mean over 7 s")


@claim(STEP_2, "3.2", "Angular accelerations are noisier before 90 s, where they are second derivatives.", *ROVERS)
def early_noise(f: ClaimFlight) -> Finding:
    driving = f.reconstruction.telemetry.driving

    def noise(start: float, end: float) -> float:
        part = driving.between(start, end)
        time, step = part.time - 0.5 * part.interval, np.diff(part.time)[:, None]
        acceleration = np.diff(part.angular_rate[:, 1:], axis=0) / step
        middle = 0.5 * (time[1:] + time[:-1])
        return float(np.std(acceleration - batch_polynomial(middle, acceleration, BATCH_OF_THESIS)))

    early, late = noise(10.0, 60.0), noise(HIGHRATE_START + 1.0, 110.0)
    return judged(
        f"{1e3 * early:.1f} and {1e3 * late:.1f} mrad/s²", early > late,
        "unfiltered less filtered, about y and z, 10–60 and 91–110 s; sampling 0.25 s before, 0.125 s after",
    )  # fmt: skip


def about_sun(f: ClaimFlight) -> tuple[float, float]:
    """Estimated rotation of the entry attitude about the line to the Sun, deg, and its sigma."""
    attitude = f.reconstruction.problem.initial.inertial_from_body
    turn = rotations.rotate(attitude, f.reconstruction.entry.change[6:])
    sun = np.asarray(f.mission.initial_state.sun_direction)
    inertial = rotations.rotate(
        rotations.conjugate(rotations.from_matrix(f.mission.planet.j2000_from_inertial_matrix)), sun
    )
    body = rotations.rotate(rotations.conjugate(attitude), inertial)
    variance = body @ f.reconstruction.smoothed.covariance[0][6:9, 6:9] @ body
    angle = in_j2000(f.mission, turn) @ sun
    return float(np.degrees(angle)), float(np.degrees(np.sqrt(variance)))


@claim(STEP_2, "3.2", "A rotation about the line to the Sun is needed for a reasonable landing.", *ROVERS)
def unturned_landing(f: ClaimFlight) -> Finding:
    end = f.turned(0.0, "retro_rocket_fire")
    miss = np.hypot(end.east, end.north)
    return judged(
        f"without: {miss / 1e3:.1f} km from the site, {end.horizontal:.0f} m/s at the retro-rockets", miss > 3e3,
        {
            AGREES: "something must be rotated: on Spirit the frame of the state explains the miss better than "
            "the attitude, on Opportunity both share it ([validation](validation.md))"
        },
    )  # fmt: skip


@claim(STEP_2, "3.2", "The attitude is turned by −0.5° about the line to the Sun.", SPIRIT)
def sun_rotation(f: ClaimFlight) -> Finding:
    value, sigma = about_sun(f)
    if abs(value) <= SIGMAS * sigma and abs(value + 0.5) <= SIGMAS * sigma:
        return Finding(quantity(value, sigma, "°"), OPEN, "both zero and the stated angle are within two sigma")
    return about(value, sigma, -0.5, 0.05, "°")


@claim(STEP_2, "3.2", "The attitude is turned about the line to the Sun (angle lost).", OPPORTUNITY)
def sun_rotation_opportunity(f: ClaimFlight) -> Finding:
    return undecided(quantity(*about_sun(f), "°"), "the digits are missing in the text")


@claim(
    STEP_2, "3.2", "Turns of more than 2° about the line to the Sun make parachute and landing unrealistic.", *ROVERS
)
def two_degrees(f: ClaimFlight) -> Finding:
    ends = [f.turned(angle, "retro_rocket_fire") for angle in (-2.0, 2.0)]
    speeds = [end.horizontal for end in ends]
    text = " and ".join(f"{s:.0f}" for s in speeds) + " m/s over the ground at the retro-rockets"
    return judged(text, min(speeds) > 50.0, "dead-reckoned with −2° and +2°; limit here 50 m/s, no wind is as strong")


@claim(STEP_2, "3.2", "Small turns about that line have a large effect on the conditions at the parachute.", *ROVERS)
def small_turns(f: ClaimFlight) -> Finding:
    ends = [f.turned(angle, "parachute_deploy") for angle in (-0.5, 0.5)]
    height, speed = abs(ends[1].up - ends[0].up), abs(ends[1].speed - ends[0].speed)
    sigma = float(np.interp(f.parachute, f.air.time, f.air.altitude_sigma))
    return judged(
        f"{height:.0f} m and {speed:.0f} m/s from −0.5° to +0.5°", height > sigma,
        f"one sigma of the altitude there is {sigma:.0f} m",
    )  # fmt: skip


@claim(
    STEP_2,
    "3.2, table 3.5",
    "Accelerometer bias along x: 1.36 (Spirit), 5.32 (Opportunity) times a lost power of ten.",
    *ROVERS,
)
def axial_bias(f: ClaimFlight) -> Finding:
    slope, sigma = f.reconstruction.pre_entry_bias
    window = SAMPLE_SIGMA / np.sqrt(SEVERAL_SECONDS * 4.0)
    candidates = BIAS_MANTISSA[of(f)] * 10.0 ** np.arange(-6.0, 0.0)
    text = quantity(1e3 * slope[0], 1e3 * sigma[0], "mm/s²")
    if np.any(np.abs(candidates - slope[0]) < SIGMAS * window):
        return Finding(text, AGREES, "for one power of ten")
    return Finding(
        text, DIFFERS, "for every power of ten; backshell's IMU over 295 s, the thesis has several seconds, "
        f"which noise alone changes by {1e3 * window:.1f} mm/s²",
    )  # fmt: skip


@claim(
    STEP_2,
    "3.2, table 3.5",
    "Accelerometer bias along z: of the order of 1e-7 (Spirit), 1e-5 m/s² (Opportunity).",
    *ROVERS,
)
def lateral_bias(f: ClaimFlight) -> Finding:
    slope, sigma = (v[1:] for v in f.reconstruction.pre_entry_bias)
    text = " and ".join(quantity(1e3 * s, 1e3 * w) for s, w in zip(slope, sigma, strict=True)) + " mm/s² (y, z)"
    large = np.abs(slope) - SIGMAS * sigma > 10.0 * BIAS_Z[of(f)]
    return judged(
        text, not large.all(),
        {
            DIFFERS: "one sample has a noise of 3 mm/s²: a bias of this size cannot be known from several "
            "seconds; a chance value"
        },
    )  # fmt: skip


def misalignment(f: ClaimFlight, window: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Slope of the lateral difference of the IMUs to the axial force, deg, and its sigma, about (y, z)."""
    fit = f.mounting_comparison.windows[window]
    return np.degrees(fit.slope), np.degrees(fit.slope_sigma)


@claim(STEP_2, "3.2", "Rover's and backshell's accelerations disagree: one of the IMUs is misaligned.", *ROVERS)
def imus_disagree(f: ClaimFlight) -> Finding:
    slope, sigma = misalignment(f)
    k = int(np.argmax(np.abs(slope) / sigma))
    return judged(
        f"{quantity(slope[k], sigma[k], '°')} in {'yz'[k]}", abs(slope[k]) > SIGMAS * sigma[k],
        "projection of the axial force, 140–250 s, without the alignment that the mission states",
    )  # fmt: skip


@claim(STEP_2, "3.2, table 3.6", "Misalignment of the rover's IMU in y and z (digits lost).", *ROVERS)
def misalignment_table(f: ClaimFlight) -> Finding:
    slope, sigma = misalignment(f)
    text = " and ".join(quantity(s, w, "°") for s, w in zip(slope, sigma, strict=True))
    return undecided(text, "the second of the thesis's windows; in the first, 0–10 s, no axial force can be projected")


@claim(STEP_2, "3.2", "With the correction both IMUs agree well.", *ROVERS)
def imus_agree(f: ClaimFlight) -> Finding:
    fit = f.mounting_comparison.windows[1]
    slope, residual = np.radians(np.abs(misalignment(f)[0]).max()), float(np.max(fit.residual_rms))
    force = f.inputs.specific_force[f.between(140.0, f.end), 0]
    shift = float(np.abs(slope) * np.std(force))
    return judged(
        f"residual {1e3 * residual:.0f} mm/s² rms", residual < 0.02,
        f"140–250 s; limit here 20 mm/s²; the correction itself varies by {1e3 * shift:.0f} mm/s² there",
    )  # fmt: skip


@claim(STEP_2, "3.2", "The correction of the lateral forces is largest in the instability regions.", SPIRIT)
def largest_correction(f: ClaimFlight) -> Finding:
    k = int(np.argmin(f.inputs.specific_force[:, 0]))
    second = f.post.regimes.second
    time = float(f.time[k])
    return judged(
        f"largest at {time:.1f} s, second instability {second.start:.0f}–{second.end:.0f} s",
        second.start - NEAR <= time <= second.end + NEAR,
        "the correction is in proportion to the axial force; at the first instability it is an eighth of that",
    )  # fmt: skip


@claim(STEP_2, "3.2", "The correction shifts the acceleration along z by less than 0.02 m/s².", SPIRIT)
def z_shift(f: ClaimFlight) -> Finding:
    slope, sigma = (np.radians(v[1]) for v in misalignment(f))
    force = float(np.abs(f.inputs.specific_force[:, 0]).max())
    return at_most(
        abs(slope) * force, sigma * force, 0.02, "m/s²",
        {DIFFERS: "at peak deceleration; below the limit where the axial force is less than half of the peak"},
    )  # fmt: skip


@claim(STEP_2, "3.2", "Along y the correction acts as a bias in the instabilities.", SPIRIT)
def y_shift(f: ClaimFlight) -> Finding:
    slope, sigma = (np.radians(v[0]) for v in misalignment(f))
    force = float(np.abs(f.inputs.specific_force[:, 0]).max())
    return undecided(
        quantity(1e3 * abs(slope) * force, 1e3 * sigma * force, "mm/s²"),
        "at peak deceleration; the thesis has no number",
    )


@claim(
    STEP_2,
    "3.2",
    "The correction shifts the accelerations by less than a lost number in the instabilities.",
    OPPORTUNITY,
)
def opportunity_shift(f: ClaimFlight) -> Finding:
    slope, sigma = (np.radians(v) for v in misalignment(f))
    force = float(np.abs(f.inputs.specific_force[:, 0]).max())
    text = " and ".join(quantity(abs(s) * force, w * force) for s, w in zip(slope, sigma, strict=True))
    return undecided(f"{text} m/s² (y, z)", "at peak deceleration; the digits are missing in the text")


@claim(STEP_3, "3.3", "The speed relative to the atmosphere at entry is around 5.3 km/s.", *ROVERS)
def entry_speed(f: ClaimFlight) -> Finding:
    return about(
        f.air.speed[0] / 1e3, f.air.speed_sigma[0] / 1e3, 5.3, 0.1, "km/s",
        {
            DIFFERS: "the speed of the thesis's own entry state (table 3.7) with its equation 3.6",
            AGREES: "the speed of the thesis's own entry state (table 3.7) with its equation 3.6",
        },
    )  # fmt: skip


@claim(STEP_3, "3.3", "The speed at the parachute is between 0.3 and 0.45 km/s.", *ROVERS)
def parachute_speed(f: ClaimFlight) -> Finding:
    speed, sigma = (float(np.interp(f.parachute, f.air.time, v)) for v in (f.air.speed, f.air.speed_sigma))
    return judged(quantity(speed, sigma, "m/s"), 300.0 <= speed <= 450.0)


def instability_peak(f: ClaimFlight, least: float, most: float) -> float | None:
    """Time of the largest mean angle over six seconds in a range of Mach numbers, s; None where there is no peak."""
    return _envelope_peak(f.time, f.post.alpha_total, (f.mach > least) & (f.mach <= most) & f.between(f.start, f.end))


@claim(STEP_3, "3.3", "The first instability is visible in the total angle near 75 s.", SPIRIT)
def first_instability(f: ClaimFlight) -> Finding:
    peak = instability_peak(f, 22.0, np.inf)
    return about(
        np.nan if peak is None else peak, f.epoch_sigma, 75.0, NEAR, "s", "largest mean angle over six seconds"
    )


@claim(STEP_3, "3.3", "The first instability is not clearly visible in the total angle.", OPPORTUNITY)
def no_first_instability(f: ClaimFlight) -> Finding:
    peak = instability_peak(f, 22.0, np.inf)
    return judged("no peak" if peak is None else f"peak at {peak:.1f} s", peak is None, "mean angle over six seconds")


@claim(STEP_3, "3.3", "The second instability is near 125 s.", *ROVERS)
def second_instability(f: ClaimFlight) -> Finding:
    peak = instability_peak(f, 12.0, 22.0)
    return about(
        np.nan if peak is None else peak, f.epoch_sigma, 125.0, NEAR, "s", "largest mean angle over six seconds"
    )


@claim(STEP_3, "2", "The second instability occurs only at small total angles, below approximately 4°.", *ROVERS)
def second_instability_angle(f: ClaimFlight) -> Finding:
    second = f.post.regimes.second
    inside = f.between(second.start, second.end)
    k = np.flatnonzero(inside)[int(np.argmax(f.alpha_total[inside]))]
    return at_most(float(f.alpha_total[k]), float(np.degrees(f.inputs.angle_sigma[k])), 4.0, "°", "largest angle in it")


@claim(STEP_3, "2", "Below Mach 3.5 the vehicle is dynamically unstable.", *ROVERS)
def dynamic_instability(f: ClaimFlight) -> Finding:
    o = f.post.oscillation
    inside = (np.interp(o.time, f.time, f.mach) < 3.5) & np.isfinite(o.growth)
    weight = 1.0 / o.growth_sigma[inside] ** 2
    mean, sigma = float(o.growth[inside] @ weight / weight.sum()), float(weight.sum() ** -0.5)
    return positive(
        mean, sigma, "1/s",
        {
            DIFFERS: "mean growth rate of the amplitude at constant dynamic pressure: the moments in phase with the "
            "rates do not amplify the oscillation",
            OPEN: "mean growth rate of the amplitude at constant dynamic pressure",
        },
    )  # fmt: skip
