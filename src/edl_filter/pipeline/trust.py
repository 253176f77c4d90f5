"""Whether a reconstruction may be trusted, and the likeliest cause if not.

A reconstruction is not trustworthy if the landing, the rest on the surface or most readings of the altimeter were
rejected: they are independent of the IMU and none of them is rejected by chance (`filter.gate_probability`). Nor is it
trustworthy if

- its state contradicted its measurements and no lost samples explain that (`navigation.recovery`);
- the attitude after lost samples is not known at all, or the path about which the flight is linearised does not
  converge (`navigation.iterated`);
- most of the parachute's inflation is among lost samples that no other IMU covers: neither side of them shows its
  force;
- the IMU shows no opening shock at the stated deployment of the parachute;
- the clock of a single IMU runs at another rate than its sampling interval states, so that its rotation is not known,
  or its velocity less well than stated;
- force and rate of one IMU are late against each other, and no effect of the model contains it;
- under the parachute the vehicle swings faster than the driving IMU's samples resolve;
- two IMUs disagree and it is not known which one is at fault (`redundancy`);
- by its altimeter the vehicle did not come to rest on the ground (`ground_height`).

A few rejected readings of an altimeter are outliers, and no reason against the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.errors import InputError, enumerated
from edl_filter.mission import Mission
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.recovery import LEAST_GAIN, Recovery, first_pass
from edl_filter.pipeline.causes import Cause, rank_causes
from edl_filter.pipeline.ground_height import ground_height
from edl_filter.pipeline.load import check_settings, event_times, read_atmosphere, read_telemetry
from edl_filter.pipeline.plausibility import find_violation
from edl_filter.pipeline.reconstruct import Reconstruction, assemble, first_run
from edl_filter.pipeline.record_comparison import record_cause
from edl_filter.pipeline.redundancy import Run, contradicting, undecided
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.clock_drift import drift_ratio
from edl_filter.telemetry.disagreement import LATE
from edl_filter.telemetry.record import Telemetry
from edl_filter.telemetry.sample_filling import INFLATION
from edl_filter.telemetry.sample_repair import alone, interpolated_stretches
from edl_filter.types import Array

#: Causes in the summary.
CAUSES = 5
#: Kinds of causes by which the readings of an IMU violate the physics of an entry.
_CAUSES_OF_READINGS = ("units", "axes", "sign")
#: Sigma of an angle of which nothing is known, uniform between -π and π, rad.
UNKNOWN_ANGLE = float(np.pi / np.sqrt(3.0))
#: Least ratio of the force after a parachute's opening to that before it, and least deceleration before it, m/s². The
#: openings of both rovers and of all simulated flights increase it 6 to 10 times.
_OPENING_SHOCK, _LEAST_DECELERATION = 2.0, 1.0
#: Step of the search for the opening shock, s.
_SHOCK_STEP = 0.25
#: Largest attitude error that the linear error model describes, rad.
_LARGEST_ERROR = 0.2
#: Part of a sigma up to which an error that it does not contain is negligible.
_NEGLIGIBLE_PART = 0.5


@dataclass(frozen=True)
class Trust:
    """Whether a reconstruction may be trusted.

    Attributes
    ----------
    trustworthy : bool
    headline : str or None
        Why not, with the likeliest cause: one or two sentences. None for a trustworthy one.
    rejected : dict
        Name of a constraint that contradicts the reconstruction → number of its rejected uses, and of all.
    causes : tuple of Cause
        The likeliest first; empty where a reason other than a contradiction decides.
    """

    trustworthy: bool
    headline: str | None
    rejected: dict[str, tuple[int, int]]
    causes: tuple[Cause, ...]


def judge(reconstruction: Reconstruction) -> Trust:
    """Judge a reconstruction; the causes are ranked only if it is not trustworthy, which takes some seconds.

    Parameters
    ----------
    reconstruction : Reconstruction
        With its filter pass and its recovery.

    Returns
    -------
    Trust
    """
    r = reconstruction
    rejected = contradicting(r.filter_pass)
    diverged = r.recovery is not None and r.recovery.cause != "gap"
    reasons = (
        lost_motion(r), _disagreement(r.telemetry), _two_clocks(r), _no_opening_shock(r), _unknown_clock(r),
        _unresolved_swing(r),
    )  # fmt: skip
    unknown = next((reason for reason in reasons if reason is not None), None)
    if unknown is not None:
        return Trust(False, f"Do not trust this result: {unknown}.", rejected, ())
    if not rejected and not diverged:
        above = _not_on_the_ground(r)
        if above is None:
            return Trust(True, None, {}, ())
        return Trust(False, f"Do not trust this result: {above}.", rejected, ())
    recovered = r.problem, not rejected
    causes = rank_causes(r.mission, r.telemetry, r.planet, r.atmosphere, r.effects, r.recovery, recovered)
    reason = _contradiction(rejected) if rejected else _divergence(r.recovery)
    headline = f"Do not trust this result: {reason}. {cause_sentence(causes)}"
    compared = r.telemetry.checking and r.mission.sample_checks.enabled
    if compared and not (causes and causes[0].consistent and causes[0].kind != "measurement"):
        headline += " The IMUs differ by no more than constant errors, which 'edl-filter diagnose' can name."
    return Trust(False, headline, rejected, tuple(causes[:CAUSES]))


def check_record(
    mission: Mission,
    telemetry: Telemetry,
    planet: Planet,
    atmosphere: Atmosphere,
    problem: Problem,
) -> Telemetry:
    """Refuse a record that violates the physics of an entry (`plausibility`), with the likeliest cause.

    Where two IMUs disagree, the samples of the one at fault are replaced first.

    Parameters
    ----------
    mission : Mission
        Its `filter.sanity_check` turns the check off.
    telemetry : Telemetry
        As it was read.
    planet, atmosphere : Planet, Atmosphere
        The mission's own.
    problem : Problem
        Assembled from them.

    Returns
    -------
    Telemetry
        The given one, or with the samples of an IMU at fault replaced (`redundancy`).

    Raises
    ------
    InputError
        A law is violated; the message names the record, what was found, and the cause.
    """
    if not mission.filter.sanity_check:
        return telemetry
    given = telemetry
    if undecided(telemetry):
        run = first_run(mission, telemetry, planet, atmosphere, mission.active_effects())
        telemetry, problem = run.telemetry, run.problem
    violation = find_violation(mission, telemetry, problem)
    if violation is None:
        return telemetry
    cause = violation.cause or _whole_record(mission, telemetry, planet, atmosphere)
    # wrong axes that both IMUs share make them disagree, and replacing samples of one of them is no repair
    for records in (telemetry, given) if telemetry is not given else (telemetry,):
        if cause is None:
            causes = rank_causes(mission, records, planet, atmosphere, mission.active_effects())
            # a law of the readings is violated, which nothing outside the IMUs explains
            of_readings = (c for c in causes if c.consistent and c.kind in _CAUSES_OF_READINGS and c.gain > LEAST_GAIN)
            cause = next((c.sentence for c in of_readings), None)
    advice = f"Likeliest cause: {cause}." if cause else "'filter.sanity_check: false' turns this check off."
    raise InputError(f"{violation.finding} {advice}")


def _whole_record(mission: Mission, telemetry: Telemetry, planet: Planet, atmosphere: Atmosphere) -> str | None:
    """Wrong axes, signs or units of a whole record, by the readings of an IMU that no measurement contradicts; or None.

    With one IMU alone, its samples are repaired without the other ones and violate no law.
    """
    if not telemetry.checking:
        return None
    deployment = event_times(mission, telemetry).get("parachute_deploy", np.inf)
    for record in (telemetry.driving, *telemetry.checking):
        try:
            with np.errstate(over="raise", invalid="raise"):
                single = alone(telemetry, record.name, check_settings(mission), deployment)
                problem = assemble(mission, single, planet, atmosphere)
                filter_pass = first_pass(problem)
        except (
            InputError,
            np.linalg.LinAlgError,
            FloatingPointError,
        ):  # its gaps are too long for one IMU, or the record is no flight
            continue
        if Run(single, problem, filter_pass).consistent and find_violation(mission, single, problem) is None:
            return record_cause(mission, telemetry, single)
    return None


def checked_telemetry(mission: Mission) -> Telemetry | None:
    """Telemetry of a mission, checked as `check_record` does; None where the mission turns the check off."""
    if not mission.filter.sanity_check:
        return None
    telemetry, atmosphere = read_telemetry(mission), read_atmosphere(mission)
    planet = mission.planet_model(telemetry.prime_meridian_at_epoch)
    return check_record(mission, telemetry, planet, atmosphere, assemble(mission, telemetry, planet, atmosphere))


def lost_motion(reconstruction: Reconstruction) -> str | None:
    """Why the motion in lost samples that no other IMU covers is not known, as words; None if it is.

    Parameters
    ----------
    reconstruction : Reconstruction
        With its telemetry and its filter pass.

    Returns
    -------
    str or None
    """
    r = reconstruction
    deployment = r.event_times.get("parachute_deploy", np.inf)
    for start, end in interpolated_stretches(r.telemetry):
        covered = min(end, deployment + INFLATION) - max(start, deployment)
        if covered > 0.5 * INFLATION:  # a shorter gap has the shock on one of its sides
            return (
                f"the parachute's inflation from {deployment:.1f} s on is among the samples that were lost from "
                f"{start:.1f} to {end:.1f} s, and no other IMU has them"
            )
    samples = r.problem.samples
    if not samples.filled.any():
        return None
    first = float(samples.time[np.argmax(samples.filled)])
    predicted = [(n.time, n.transition.covariance[6:9, 6:9]) for n in r.filter_pass.nodes if n.transition is not None]
    sigmas = [(float(np.sqrt(np.linalg.eigvalsh(block)[-1])), time) for time, block in predicted if time >= first]
    sigma, time = max(sigmas, default=(0.0, first))
    if sigma > UNKNOWN_ANGLE:
        return (
            f"no other IMU covers the samples that were lost from {first:.1f} s on, and with them the attitude: its "
            f"sigma is {np.degrees(sigma):.0f} degrees at {time:.1f} s"
        )
    if not r.filter_pass.converged:
        return f"the path after the samples that were lost from {first:.1f} s on has no stable solution"
    return None


def _two_clocks(reconstruction: Reconstruction) -> str | None:
    """That force and rate of one IMU are late against each other, as words; None without that, or in the model."""
    delays = [f for f in reconstruction.telemetry.findings if f.kind == "delay"]
    least = LATE * float(np.median(reconstruction.telemetry.driving.interval))
    offsets = [e.values["tau"] for e in reconstruction.effects if e.name == "imu_time_offset"]
    if not delays or any(abs(tau) > least for tau in offsets):
        return None
    return (
        f"force and rate of one IMU have different clocks: {delays[0].repair.split(';')[0]}; 'edl-filter diagnose' can "
        "name the IMU (effect imu_time_offset)"
    )


def _no_opening_shock(reconstruction: Reconstruction) -> str | None:
    """That the IMU shows no opening shock at the stated deployment, and where it shows one; None if it shows it."""
    r = reconstruction
    deployment, landing = r.event_times.get("parachute_deploy"), r.event_times.get("landing", np.inf)
    if deployment is None:
        return None
    samples = r.problem.samples
    size = np.linalg.norm(samples.mean_force, axis=1)
    around = np.abs(samples.time - deployment) <= INFLATION
    if samples.filled[around].any() or not _force_increase(samples.time, size, deployment) < _OPENING_SHOCK:
        return None
    text = f"the IMU shows no opening shock at the parachute's stated deployment at {deployment:.1f} s"
    times = np.arange(samples.time[0], min(landing, float(samples.time[-1])) - INFLATION, _SHOCK_STEP)
    increases = np.array([_force_increase(samples.time, size, t) for t in times])
    if np.nanmax(increases, initial=0.0) >= _OPENING_SHOCK:
        k = int(np.nanargmax(increases))
        text += f"; its force increases {increases[k]:.0f} times at {times[k]:.1f} s"
    return text


def _force_increase(time: Array, size: Array, at: float) -> float:
    """Largest force within `INFLATION` after a time over its mean before; NaN without a deceleration before it.

    Parameters
    ----------
    time, size : (N,) arrays
        s, and length of the specific force, m/s².
    at : float
        s.
    """
    before = size[(time > at - INFLATION) & (time <= at)]
    after = size[(time > at) & (time <= at + INFLATION)]
    if not len(before) or not len(after) or np.mean(before) < _LEAST_DECELERATION:
        return float("nan")
    return float(np.max(after) / np.mean(before))


def _unresolved_swing(reconstruction: Reconstruction) -> str | None:
    """That the vehicle swings under its parachute faster than its IMU resolves, as words; None if it does not.

    A body of mass m on which the parachute pulls with the specific force f at a distance l from its centre of mass is a
    pendulum with ω² = m f l / I. Half a diameter is a small value of l. Above half of the sampling frequency the
    readings show the swinging at another frequency: neither its coning nor its noise are known
    (`navigation.unresolved`).
    """
    r = reconstruction
    deployment, vehicle = r.event_times.get("parachute_deploy"), r.mission.vehicle
    if deployment is None or vehicle.inertia is None:
        return None
    samples = r.problem.samples
    inflating = (samples.time > deployment) & (samples.time <= deployment + INFLATION) & ~samples.filled
    if not inflating.any():
        return None
    force = float(np.max(np.linalg.norm(samples.mean_force[inflating], axis=1)))
    inertia = 0.5 * (vehicle.inertia.yy + vehicle.inertia.zz)
    frequency = float(np.sqrt(vehicle.mass * force * 0.5 * vehicle.diameter / inertia)) / (2.0 * np.pi)
    sampling = 1.0 / float(np.median(r.telemetry.driving.interval))
    if frequency <= 0.5 * sampling:
        return None
    return (
        f"IMU {r.telemetry.driving.name} samples at {sampling:.3g} Hz and does not resolve the swinging of the vehicle "
        f"under its parachute, up to about {frequency:.1f} Hz: errors of attitude and velocity may exceed their sigmas"
    )


def _unknown_clock(reconstruction: Reconstruction) -> str | None:
    """That a single IMU's clock leaves its rotation or velocity unknown, as words; None if it does not.

    The lengths of its samples may be off by the ratio of its times to its stated interval. The rotation is off by as
    much, and the linear error model does not hold for attitude errors beyond `_LARGEST_ERROR`. The velocity that
    gravity gives is off by as much too, which no scale error of the instruments contains: at the deployment of the
    parachute it is compared with the sigma of the velocity.
    """
    r, t = reconstruction, reconstruction.telemetry
    if t.checking or not any(f.kind == "clock_drift" for f in t.findings):
        return None
    record, ratio = t.driving, drift_ratio(t.driving)
    until = record.time <= reconstruction.event_times.get("parachute_deploy", np.inf)
    angle = abs(ratio) * float(np.sum(np.linalg.norm(record.angular_rate[until], axis=1) * record.interval[until]))
    node = int(np.argmin(np.abs(r.smoothed.time - record.time[until][-1])))
    gravity = float(np.linalg.norm(r.planet.gravity(r.smoothed.states[node].nav[:3])))
    speed = abs(ratio) * gravity * float(r.smoothed.time[node] - r.smoothed.time[0])
    sigma = float(np.sqrt(np.trace(r.smoothed.covariance[node][3:6, 3:6])))
    if angle > _LARGEST_ERROR:
        unknown = f"the attitude is uncertain by {np.degrees(angle):.0f} degrees"
    elif speed > _NEGLIGIBLE_PART * sigma:
        unknown = f"the velocity is uncertain by {speed:.2g} m/s, which its sigma of {sigma:.2g} m/s does not contain"
    else:
        return None
    return (
        f"the times of IMU {record.name} differ by {100.0 * ratio:+.2g} % from its stated sampling interval, no other "
        f"IMU shows which is wrong, and {unknown}"
    )


def _not_on_the_ground(reconstruction: Reconstruction) -> str | None:
    """How far from the surface of the altimeter's heights the vehicle touched down, as words; None if it is on it."""
    ground = ground_height(reconstruction)
    if ground is None or not ground.significant:
        return None
    side, error, clock = ("above", "high", "late") if ground.height > 0.0 else ("below", "low", "early")
    return (
        f"by the altimeter the vehicle touched down {abs(ground.height):.0f} m {side} the surface to which its heights "
        f"refer (sigma {ground.sigma:.0f} m); they are too {error}, or their times are too {clock}, or the ground at "
        "the landing is not that surface ('constraints.altimeter.relief_sigma')"
    )


def _disagreement(telemetry: Telemetry) -> str | None:
    """Where two IMUs disagree without a sign of the one at fault, as words; None if they do not."""
    findings = undecided(telemetry)
    if not findings:
        return None
    channels = " and ".join(sorted({f.channel for f in findings}))
    return (
        f"two IMUs disagree in their {channels} between {min(f.start for f in findings):.1f} and "
        f"{max(f.end for f in findings):.1f} s, no constant error explains it, and nothing shows which one is at fault"
    )


def _contradiction(rejected: dict[str, tuple[int, int]]) -> str:
    names = [
        name.replace("_", " ") + (f" ({count} of {uses} readings)" if uses > 1 else "")
        for name, (count, uses) in rejected.items()
    ]
    return f"{enumerated(names)} contradict{'s' * (len(names) == 1)} all other data"


def _divergence(recovery: Recovery | None) -> str:
    assert recovery is not None
    names = enumerated([name.replace("_", " ") for name in recovery.divergence.names])
    return f"its state contradicted {names} at {recovery.divergence.time:.1f} s and was estimated again with more noise"


def cause_sentence(causes: list[Cause]) -> str:
    """The likeliest cause as a sentence; that there is none among those that were tested."""
    if not causes or not causes[0].consistent:
        tested = "units, axes, signs, clocks, lost samples, entry state, each measurement"
        return f"No single cause explains it (tested: {tested})."
    sentence = f"Likeliest cause: {causes[0].sentence}"
    if causes[0].kind == "measurement":
        sentence += ", or an effect that the model lacks ('edl-filter diagnose')"
    return f"{sentence}."
