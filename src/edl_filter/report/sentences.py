"""Sentences about a run, for the terminal, the report and notebook cards."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from edl_filter.errors import enumerated
from edl_filter.report.text import number, with_sigma, words
from edl_filter.results.schema import Summary
from edl_filter.results.schema.summary import (
    EffectParameter,
    EntryState,
    EventState,
    GasSummary,
    Landing,
    ModelEffect,
    PostflightSummary,
    RecoverySummary,
    SampleFindingSummary,
    Smoothing,
)
from edl_filter.telemetry.record import KINDS

#: Share of a constraint's uses that may fail the gate before a run warns.
_USUAL_REJECTIONS = 0.05


def finding_sentences(findings: Sequence[SampleFindingSummary], most: int | None = None) -> list[str]:
    """Missing and bad samples and what was done, one sentence each; beyond `most` only their number."""
    listed = findings if most is None else findings[:most]
    sentences = [
        f"{f.imu} {f.channel}, {f.start_s:.3f} to {f.end_s:.3f} s: {KINDS[f.kind]}; {f.repair}" for f in listed
    ]
    if len(listed) < len(findings):
        sentences.append(f"and {len(findings) - len(listed)} more in summary.json and in the report")
    return sentences


def peak_sentence(peak: EventState) -> str:
    """Largest deceleration before the parachute; empty if the event does not state it."""
    if peak.acceleration_m_s2 is None or peak.acceleration_single_m_s2 is None:
        return ""
    return (
        f"Peak deceleration: {peak.acceleration_m_s2:.1f} m/s² as the mean of two samples, "
        f"{peak.acceleration_single_m_s2:.1f} m/s² in one."
    )


def warnings(summary: Summary) -> list[str]:
    """Why a result is not to be trusted, alone; otherwise what contradicts it without a doubt about the result.

    Parameters
    ----------
    summary : Summary
        Of a run.

    Returns
    -------
    list of str
        The headline of an untrustworthy result; of a trustworthy one a recovery of the filter, the parachute where it
        was rejected, and every constraint of which one use of twenty was.
    """
    if summary.headline is not None:
        return [summary.headline]
    sentences = [] if summary.recovery is None else [recovery_sentence(summary.recovery)]
    for name, c in summary.constraints.items():
        rejected = c.uses - c.accepted_uses
        if rejected > (0 if name == "parachute" else _USUAL_REJECTIONS * c.uses):
            sentences.append(
                f"{words(name).capitalize()}: {rejected} of {c.uses} uses contradict all other data and were left out."
            )
    return sentences


def recovery_sentence(recovery: RecoverySummary) -> str:
    """The contradiction of state and measurements, and what removed it."""
    names = enumerated([words(name) for name in recovery.constraints])
    sentence = f"At {recovery.time_s:.1f} s {names} contradicted the state of the filter"
    if recovery.cause == "gap":
        return (
            f"{sentence}; more noise of the samples that stand for lost ones between {_time(recovery.start_s)} and "
            f"{_time(recovery.end_s)} s ({number(recovery.force_noise_m_s2)} m/s², {number(recovery.rate_noise_rad_s)} "
            "rad/s) explains it."
        )
    if recovery.cause == "entry_state":
        return f"{sentence}; {number(recovery.size)} times the stated sigmas of the entry state explain it."
    if recovery.cause == "process_noise":
        return (
            f"{sentence}; more noise of all samples before that ({number(recovery.force_noise_m_s2)} m/s², "
            f"{number(recovery.rate_noise_rad_s)} rad/s) explains it."
        )
    return f"{sentence}, and no additional noise explains it."


def entry_sentence(entry: EntryState) -> str:
    """Correction of the entry state."""
    sentence = (
        f"Entry state: moved by {_length(entry.position_change_m) / 1e3:.2f} km and "
        f"{_length(entry.velocity_change_m_s):.2f} m/s"
    )
    if "entry_frame" in entry.states and entry.rotation_deg is not None:
        remaining = _length(entry.rotation_leaves_m) / 1e3
        sentence += f"; a rotation of its frame by {entry.rotation_deg:.3f} deg explains all but {remaining:.2f} km"
    epoch = entry.states.get("entry_epoch")
    if epoch is not None and epoch.estimate[0] is not None and epoch.sigma[0] is not None:
        sentence += f", with its epoch off by {epoch.estimate[0]:+.2f} ± {epoch.sigma[0]:.2f} s"
    return sentence + "."


def _length(vector: tuple[float | None, ...]) -> float:
    return math.hypot(*(math.nan if v is None else v for v in vector))


def landing_sentence(landing: Landing) -> str:
    """Landing position, and its prediction without the landing constraint; or the end of a record without a landing."""
    latitude, miss, sigma = landing.lat_deg, landing.miss_m, landing.sigma_m
    if latitude is None or landing.lon_deg is None or sigma is None:
        return ""
    place = f"{abs(latitude):.4f} {'S' if latitude < 0.0 else 'N'} {landing.lon_deg:.4f} E"
    if not landing.landed:
        return f"The record ends at {landing.time_s:.2f} s, before the landing, over {place} (± {sigma:.0f} m)."
    if miss is None:
        return f"Landing: {place} (± {sigma:.0f} m)."
    sentence = f"Landing: {place}, {miss:.0f} ± {sigma:.0f} m from the site"
    if (out := landing.left_out) is not None and out.miss_m is not None and out.sigma_m is not None:
        sentence += f"; predicted without it {out.miss_m / 1e3:.2f} ± {out.sigma_m / 1e3:.2f} km away"
    return sentence + "."


def effect_lines(effects: Mapping[str, ModelEffect]) -> list[str]:
    """One line for each effect in the model, with the parameters that are not zero and their sigmas."""
    from edl_filter.effects.instances import lookup
    from edl_filter.effects.registry import catalogue

    lines = []
    for key, effect in effects.items():
        name = key.split(" in ")[0]
        values = {q: p for q, p in effect.parameters.items() if p.estimate and math.isfinite(p.estimate)}
        declared = lookup(catalogue(), name)
        off = declared is not None and not any(q.name in values for q in declared.sizes)
        text = "off" if off else ", ".join(f"{q} {_estimate(p)}" for q, p in values.items())
        imu = f" in {effect.imu}" if effect.imu else ""
        lines.append(f"Effect in the model: {name}{imu} ({text}).")
    return lines


def _estimate(parameter: EffectParameter) -> str:
    unit = f" {parameter.unit}" if parameter.unit and parameter.sigma else ""
    return f"{with_sigma(parameter.estimate, parameter.sigma)}{unit}"


def gas_sentence(gas: GasSummary) -> str:
    """Gas in which Mach numbers and temperatures are meant."""
    return f"Mach numbers and temperatures are those of this gas: {gas.description}."


def smoothing_sentence(s: Smoothing) -> str:
    """Batch, low-pass and bandwidths of forces, rates and angular accelerations."""
    low_pass = "" if s.low_pass_hz is None else f"a low-pass at {s.low_pass_hz:g} Hz and "
    return (
        f"Forces and rates are smoothed by {low_pass}batches of {s.batch_points} samples: bandwidth "
        f"{_frequency(s.bandwidth_hz)}, of the angular accelerations {_frequency(s.acceleration_bandwidth_hz)}."
    )


def _frequency(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.2f} Hz"


def postflight_lines(postflight: PostflightSummary | None) -> list[str]:
    """Validation domain, instabilities, and the largest difference of the force coefficients."""
    if postflight is None:
        return []
    domain, instabilities = postflight.domain_s, postflight.instabilities_s
    named = {"first": instabilities.first, "second": instabilities.second}
    intervals = [f"{name} {_time(span[0])}-{_time(span[1])} s" for name, span in named.items() if span]
    useful = "" if _time(domain.useful) == "–" else f" (forces from {_time(domain.useful)} s)"
    lines = [
        f"Aerodynamics from {_time(domain.start)} s{useful}; instabilities: {', '.join(intervals) or 'none found'}."
    ]
    if postflight.smoothing is not None:
        lines.append(smoothing_sentence(postflight.smoothing))
    forces = [a for a in postflight.averages if a.pair == "IMU-accels" and a.percent is not None]
    if forces:
        worst = max(forces, key=lambda a: abs(a.percent or 0.0))
        lines.append(
            f"Database minus flight, forces: at most {number(abs(round(worst.percent or 0.0)))} % of the database's "
            f"3 sigma ({worst.coefficient}, {worst.window})."
        )
    return lines


def _time(value: float | None) -> str:
    return "–" if value is None or not math.isfinite(value) else f"{value:.0f}"
