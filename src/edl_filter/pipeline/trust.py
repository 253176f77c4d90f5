"""Whether a reconstruction may be trusted, and the likeliest cause if not.

A reconstruction is not trustworthy if the landing, the rest on the surface or most readings of the altimeter were
rejected: they are independent of the IMU and none of them is rejected by chance (`filter.gate_probability`). It is not
either if its state contradicted its measurements and no lost samples explain that (`navigation.recovery`), if the
attitude after lost samples is not known at all, or if two IMUs disagree and the other measurements do not decide
between them (`redundancy`), or if the path about which the flight is linearised does not settle
(`navigation.iterated`), or if most of the parachute's inflation is among lost samples that no other IMU covers: neither
side of them shows its force. A few rejected readings of an altimeter are outliers, and no reason against
the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.navigation.filter import Problem
from edl_filter.navigation.recovery import Recovery
from edl_filter.pipeline.causes import Cause, rank_causes, record_cause
from edl_filter.pipeline.load import read_atmosphere, read_telemetry
from edl_filter.pipeline.plausibility import find_violation
from edl_filter.pipeline.reconstruct import Reconstruction, assemble, first_run
from edl_filter.pipeline.redundancy import UNDECIDED, contradicting
from edl_filter.planet import Planet
from edl_filter.planet.atmosphere import Atmosphere
from edl_filter.telemetry.record import SampleFinding, Telemetry
from edl_filter.telemetry.sample_repair import INFLATION, filled_by_dynamics

#: Kinds of causes that are wrong statements about a whole record.
_RECORD = ("units", "axes", "sign")
#: Causes in the summary.
CAUSES = 5
#: Sigma of an angle of which nothing is known, uniform between -π and π, rad.
UNKNOWN_ANGLE = float(np.pi / np.sqrt(3.0))


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
        The likeliest first; empty for a trustworthy one.
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
    lost = lost_motion(r) or _undecided(r.telemetry)
    if lost is not None:
        return Trust(False, f"Do not trust this result: {lost}.", rejected, ())
    if not rejected and not diverged:
        return Trust(True, None, {}, ())
    recovered = r.problem, not rejected
    causes = rank_causes(r.mission, r.telemetry, r.planet, r.atmosphere, r.effects, r.recovery, recovered)
    reason = _contradiction(rejected) if rejected else _divergence(r.recovery)
    headline = f"Do not trust this result: {reason}. {cause_sentence(causes)}"
    return Trust(False, headline, rejected, tuple(causes[:CAUSES]))


def check_record(
    mission: Mission,
    telemetry: Telemetry,
    planet: Planet,
    atmosphere: Atmosphere,
    problem: Problem,
) -> Telemetry:
    """Refuse a record that violates the physics of an entry (`plausibility`), with the likeliest cause.

    A fault in a part of the flight is no reason for that if another IMU is consistent with all other measurements.
    Wrong units, axes or signs of a whole record are.

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
        Without an IMU that is at fault.

    Raises
    ------
    InputError
        A law is violated; the message names the record, what was found, and the cause.
    """
    if not mission.filter.sanity_check:
        return telemetry
    violation = find_violation(mission, telemetry, problem)
    parted = next((f for f in telemetry.findings if f.kind == "disagreement"), None)
    if violation is None and parted is None:
        return telemetry
    effects = mission.active_effects()
    cause, sound = None if violation is None else violation.cause, None
    if cause is None and telemetry.checking:
        run = first_run(mission, telemetry, planet, atmosphere, effects)
        if run.consistent and find_violation(mission, run.telemetry, run.problem) is None:
            sound = run.telemetry
            cause = record_cause(mission, telemetry, sound)
    if cause is None and sound is None:
        causes = rank_causes(mission, telemetry, planet, atmosphere, effects)
        named = causes and causes[0].consistent and (violation is not None or causes[0].kind in _RECORD)
        cause = causes[0].sentence if named else None
    if cause is None and (sound is not None or violation is None):
        return telemetry if sound is None else sound
    advice = f"Likeliest cause: {cause}." if cause else "'filter.sanity_check: false' turns this check off."
    raise InputError(f"{_disagreement(mission, parted) if violation is None else violation.finding} {advice}")


def checked_telemetry(mission: Mission) -> Telemetry | None:
    """Telemetry of a mission, checked as `check_record` does; None where the mission turns the check off."""
    if not mission.filter.sanity_check:
        return None
    telemetry, atmosphere = read_telemetry(mission), read_atmosphere(mission)
    planet = mission.planet_model(telemetry.prime_meridian_at_epoch)
    return check_record(mission, telemetry, planet, atmosphere, assemble(mission, telemetry, planet, atmosphere))


def _disagreement(mission: Mission, parted: SampleFinding | None) -> str:
    assert parted is not None
    return (
        f"{mission.telemetry_path() or mission.source or mission.name}: the {parted.channel} of IMU {parted.imu} and "
        f"that of another one disagree from {parted.start:.1f} to {parted.end:.1f} s; both are fixed to one rigid body."
    )


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
    for start, end in filled_by_dynamics(r.telemetry):
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


def _undecided(telemetry: Telemetry) -> str | None:
    """Which IMUs disagree without another measurement that shows the one at fault, as words; None if there are none."""
    parted = next((f for f in telemetry.findings if f.kind == "disagreement" and f.repair == UNDECIDED), None)
    if parted is None:
        return None
    return (
        f"two IMUs disagree in their {parted.channel} from {parted.start:.1f} to {parted.end:.1f} s, and the other "
        "measurements agree with each of them"
    )


def _contradiction(rejected: dict[str, tuple[int, int]]) -> str:
    names = [
        name.replace("_", " ") + (f" ({count} of {uses} readings)" if uses > 1 else "")
        for name, (count, uses) in rejected.items()
    ]
    listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{listed} contradict{'s' * (len(names) == 1)} all other data"


def _divergence(recovery: Recovery | None) -> str:
    assert recovery is not None
    names = " and ".join(name.replace("_", " ") for name in recovery.divergence.names)
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
